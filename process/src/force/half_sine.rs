//! The half-sine that fits a pulse best.

use std::f64::consts::PI;

/// Fewest samples for the three numbers of a half-sine.
const SAMPLES_LEAST: usize = 5;
/// Samples in a row at the largest value that make it a clipped top.
const CLIPPED_RUN: usize = 3;
/// Rounds of the search; a dozen are enough where there is anything to be found.
const ROUNDS_MAX: usize = 50;

/// Amplitude of F sin(pi (t - t_0)/tau) with the least squared difference from the samples `first` to `last`, those left
/// out that lie at a clipped top; `base_samples` is a tau to begin with.
///
/// `None` of fewer than five samples, and when the search does not end between half and twice the tau it began with or
/// finds a pulse whose peak is not among the samples.
pub(super) fn amplitude(
    value: impl Fn(usize) -> f64 + Copy,
    (first, last): (usize, usize),
    base_samples: f64,
) -> Option<f64> {
    let clipped = clipped_top(value, first, last);
    let is_taken = |i: &usize| clipped.is_none_or(|top| value(*i) < top);
    let middle = f64::midpoint(first as f64, last as f64);
    let points = || (first..=last).filter(is_taken).map(|i| (i as f64 - middle, value(i)));
    if points().count() < SAMPLES_LEAST {
        return None;
    }
    let start = PI / base_samples;
    let mut omega = start;
    for _ in 0..ROUNDS_MAX {
        let wave = Wave::of(points(), omega)?;
        let step = wave.step(points());
        omega += step;
        if !(0.5 * start..=2.0 * start).contains(&omega) {
            return None;
        }
        if step.abs() <= 1e-13 * omega {
            let wave = Wave::of(points(), omega)?;
            let peak_at = wave.sine.atan2(wave.cosine) / omega;
            return Some(wave.sine.hypot(wave.cosine)).filter(|_| peak_at.abs() <= middle - first as f64);
        }
    }
    None
}

/// The largest value from `first` to `last`, if three samples in a row have it.
fn clipped_top(value: impl Fn(usize) -> f64, first: usize, last: usize) -> Option<f64> {
    let top = (first..=last).map(&value).max_by(f64::total_cmp)?;
    let mut run = 0;
    let is_clipped = (first..=last).any(|i| {
        run = if value(i) < top { 0 } else { run + 1 };
        run >= CLIPPED_RUN
    });
    is_clipped.then_some(top)
}

/// a sin(omega u) + b cos(omega u), with the a and b that fit best.
#[derive(Debug, Clone, Copy)]
struct Wave {
    omega: f64,
    sine: f64,
    cosine: f64,
    /// Sums of sin^2, sin cos and cos^2.
    gram: [f64; 3],
}

impl Wave {
    fn of(points: impl Iterator<Item = (f64, f64)>, omega: f64) -> Option<Self> {
        let (mut gram, mut product) = ([0.0; 3], [0.0; 2]);
        for (u, y) in points {
            let (s, c) = (omega * u).sin_cos();
            gram = [gram[0] + s * s, gram[1] + s * c, gram[2] + c * c];
            product = [product[0] + s * y, product[1] + c * y];
        }
        let [sine, cosine] = solved(gram, product)?;
        Some(Self { omega, sine, cosine, gram })
    }

    /// Newton's step of omega, the best a and b being known at any (variable projection, after Kaufman 1975).
    fn step(&self, points: impl Iterator<Item = (f64, f64)>) -> f64 {
        let (mut squares, mut product, mut shared) = (0.0, 0.0, [0.0; 2]);
        for (u, y) in points {
            let (s, c) = (self.omega * u).sin_cos();
            let slope = u * (self.sine * c - self.cosine * s);
            squares += slope * slope;
            product += slope * (y - self.sine * s - self.cosine * c);
            shared = [shared[0] + slope * s, shared[1] + slope * c];
        }
        // Of the slope, what sine and cosine themselves can do does not count.
        let explained = solved(self.gram, shared).map_or(f64::NAN, |[a, b]| a * shared[0] + b * shared[1]);
        product / (squares - explained)
    }
}

/// The x of G x = `right`, G = ((a, b), (b, c)).
fn solved([a, b, c]: [f64; 3], right: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = a * c - b * b;
    let is_solvable = determinant > 1e-12 * a * c;
    is_solvable.then(|| [(c * right[0] - b * right[1]) / determinant, (a * right[1] - b * right[0]) / determinant])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pulse(i: usize, f_max: f64, start: f64, tau: f64) -> f64 {
        let phase = (i as f64 - start) / tau;
        if (0.0..1.0).contains(&phase) { f_max * (PI * phase).sin() } else { 0.0 }
    }

    /// Catches clipped samples that enter the fit: a half-sine clipped to 60 % returns its own height.
    #[test]
    fn a_clipped_half_sine_returns_its_height() {
        for clip in [1.0, 0.9, 0.6] {
            let value = |i: usize| pulse(i, 80.0, 3.3, 40.0).clamp(0.0, clip * 80.0);
            let found = amplitude(value, (6, 41), 36.0).unwrap();
            assert!((found / 80.0 - 1.0).abs() < 1e-10, "{clip}: {found}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

        /// Catches a step that ends elsewhere than in the least squares: the slow twin tries every tau of a fine grid.
        #[test]
        fn like_a_search(
            seed in any::<u32>(), tau in 12.0..60.0_f64, start in 0.0..1.0_f64, noise in 0.0..0.03_f64, guess in 0.9..1.1_f64,
        ) {
            let mut state = seed;
            let samples: Vec<f64> = (0..64).map(|i| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                pulse(i, 1.0, start, tau) + noise * (f64::from(state) / 4_294_967_296.0 - 0.5)
            }).collect();
            let (first, last) = ((start + 0.05 * tau).ceil() as usize, (start + 0.95 * tau) as usize);
            let found = amplitude(|i| samples[i], (first, last), guess * tau).unwrap();
            let middle = f64::midpoint(first as f64, last as f64);
            let points = || (first..=last).map(|i| (i as f64 - middle, samples[i]));
            let loss = |w: &Wave| points().map(|(u, y)| {
                let (s, c) = (w.omega * u).sin_cos();
                (y - w.sine * s - w.cosine * c).powi(2)
            }).sum::<f64>();
            let best = (0..4000).filter_map(|k| Wave::of(points(), PI / (tau * (0.8 + 1e-4 * f64::from(k)))))
                .min_by(|a, b| loss(a).total_cmp(&loss(b))).unwrap();
            let slow = best.sine.hypot(best.cosine);
            prop_assert!((found / slow - 1.0).abs() < 1e-3, "{found} {slow}");
        }
    }

    /// Catches a number made up for what is no half-sine, and a search without end.
    #[test]
    fn what_is_no_half_sine_has_no_amplitude() {
        assert_eq!(amplitude(|_| 1.0, (0, 20), 20.0), None); // one clipped top
        assert_eq!(amplitude(|_| 0.0, (0, 20), 20.0), None);
        assert_eq!(amplitude(|i| i as f64, (0, 20), 20.0), None);
        assert_eq!(amplitude(|_| f64::NAN, (0, 20), 20.0), None);
        assert_eq!(amplitude(|i| pulse(i, 1.0, 0.0, 4.0), (0, 3), 4.0), None);
        assert_eq!(amplitude(|i| pulse(i, 1.0, 0.0, 40.0), (1, 39), 0.0), None);
        assert_eq!(amplitude(|i| pulse(i, 1.0, 0.0, 40.0), (1, 39), f64::NAN), None);
    }

    /// Catches a top taken for clipped that only has two equal samples, and one that is not at the top.
    #[test]
    fn three_in_a_row_at_the_top_are_clipped() {
        let top = |samples: &[f64]| clipped_top(|i| samples[i], 0, samples.len() - 1);
        assert_eq!(top(&[0.0, 2.0, 2.0, 0.0]), None);
        assert_eq!(top(&[0.0, 2.0, 2.0, 2.0, 0.0]), Some(2.0));
        assert_eq!(top(&[0.0, 2.0, 2.0, 1.0, 2.0, 0.0]), None);
        assert_eq!(top(&[1.0, 1.0, 1.0, 2.0, 0.0]), None);
    }
}
