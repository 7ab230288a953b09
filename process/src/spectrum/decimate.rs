//! Every fourth sample of a low-passed record: the same bins, at a quarter of the transform.
//!
//! The filter goes round the record's end, so that its effect on a bin is a factor: after decimation bin k holds
//! (X_k H_k + what is folded upon it)/4, and |H_k|^2 is divided out. The pass band therefore need not be flat, and the
//! filter can be what folds least: a Dolph-Chebyshev window whose main lobe ends where frequencies begin that fold into
//! the bands. Of a tap at 40.96 kHz, what is folded upon 3 kHz comes 137 dB below what belongs there.

use std::f64::consts::{PI, TAU};

use crate::Real;
use crate::signal::real::sum_of;
use crate::signal::wide::Kernel;

/// Samples of which one is kept.
const FACTOR: usize = 4;
/// Taps of the filter; each phase of the record meets a quarter of them.
const TAPS: usize = 32;
/// Taps of each phase.
const ROUNDS: usize = TAPS / FACTOR;
/// Amplitude of what is folded upon the bands' highest frequency, beside what belongs there, above which a record is
/// not decimated. A flexural band of 1e-5 of the record's power (fainter ones are done again) is then 2e-7 sqrt(1e5), less
/// than 1e-4, off in amplitude at its worst bin, and far less in sums over bins.
const FOLDED_MOST: f64 = 2e-7;
/// Outputs made together, so that the compiler makes vectors of them.
const LANES: usize = 64;

/// The filter of records of one length whose bands end at one frequency.
#[derive(Debug)]
pub(super) struct Decimator<T> {
    count: usize,
    edge: f64,
    taps: [T; TAPS],
    /// 16/|H|^2 of the bins up to the edge.
    inverse: Vec<f64>,
    /// The record's samples 0, 4, 8, ..., then 1, 5, 9, ... and so on, each with its first few again at its end.
    phases: [Vec<T>; FACTOR],
}

impl<T: Real> Decimator<T> {
    /// For records of `count` samples and bands up to `edge`, in parts of the sample rate.
    ///
    /// `None` when four does not divide the count, or the filter could not keep the bands clean.
    pub(super) fn new(count: usize, edge: f64) -> Option<Self> {
        let is_long = count.is_multiple_of(FACTOR) && count / FACTOR >= TAPS;
        // What is folded upon the edge comes from here.
        let stop = 1.0 / FACTOR as f64 - edge;
        if !is_long || stop <= edge {
            return None;
        }
        let x_0 = 1.0 / (PI * stop).cos();
        let is_clean = 1.0 / chebyshev(x_0 * (PI * edge).cos()) <= FOLDED_MOST;
        if !is_clean {
            return None;
        }
        let taps = window(x_0).map(T::rounded);
        // Of the taps as they were rounded.
        let response = |bin: usize| {
            let angle = TAU * bin as f64 / count as f64;
            taps.iter().enumerate().map(|(j, h)| h.widened() * (angle * (j as f64 - MIDDLE)).cos()).sum::<f64>()
        };
        let inverse = |bin| (FACTOR as f64 / response(bin)).powi(2);
        let bins = (edge * count as f64) as usize + 2; // an edge bin may be the one beyond
        let phases = std::array::from_fn(|_| Vec::with_capacity(count / FACTOR + ROUNDS));
        Some(Self { count, edge, taps, inverse: (0..bins).map(inverse).collect(), phases })
    }

    /// Whether it is for records of `count` samples and bands up to `edge`.
    #[expect(clippy::float_cmp, reason = "another edge, however close, is another filter")]
    pub(super) fn is_for(&self, count: usize, edge: f64) -> bool {
        self.count == count && self.edge == edge
    }

    /// What brings |Y|^2 of a bin back to |X|^2, from 0 Hz to the edge.
    pub(super) fn inverse(&self) -> &[f64] {
        &self.inverse
    }

    /// Fills `decimated` with the filtered `signal` less its mean; returns the mean square of that before the filter.
    ///
    /// # Panics
    /// If `signal` does not have the length that the decimator is for.
    pub(super) fn decimate(&mut self, signal: &[T], decimated: &mut Vec<T>) -> f64 {
        assert_eq!(signal.len(), self.count, "a decimator is for one length");
        let mean = T::rounded(sum_of(signal, |x| x) / self.count as f64);
        let kept = self.count / FACTOR;
        for phase in &mut self.phases {
            phase.resize(kept + ROUNDS - 1, T::zero());
        }
        Split { signal, mean, phases: &mut self.phases }.wide();
        for phase in &mut self.phases {
            phase.copy_within(..ROUNDS - 1, kept);
        }
        let squares: f64 = self.phases.iter().map(|phase| sum_of(&phase[..kept], |x| x * x)).sum();
        decimated.clear();
        decimated.resize(kept, T::zero());
        Filter { phases: &self.phases, taps: &self.taps, filtered: decimated }.wide();
        squares / self.count as f64
    }
}

/// Deals the samples less their mean out to the phases, in one pass that the compiler makes shuffles of.
struct Split<'a, T> {
    signal: &'a [T],
    mean: T,
    phases: &'a mut [Vec<T>; FACTOR],
}

impl<T: Real> Kernel for Split<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { signal, mean, phases: [a, b, c, d] } = self;
        let places = a.iter_mut().zip(b).zip(c.iter_mut().zip(d));
        for (four, ((a, b), (c, d))) in signal.chunks_exact(FACTOR).zip(places) {
            (*a, *b, *c, *d) = (four[0] - mean, four[1] - mean, four[2] - mean, four[3] - mean);
        }
    }
}

/// Middle of the taps.
const MIDDLE: f64 = (TAPS - 1) as f64 / 2.0;

/// `y[m]` = sum over j of `h[j] x[4 m + j]`, going on at the record's beginning beyond its end.
struct Filter<'a, T> {
    phases: &'a [Vec<T>; FACTOR],
    taps: &'a [T; TAPS],
    filtered: &'a mut [T],
}

impl<T: Real> Kernel for Filter<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { phases, taps, filtered } = self;
        let mut blocks = filtered.chunks_exact_mut(LANES);
        let mut from = 0;
        for block in blocks.by_ref() {
            let mut sums = [T::zero(); LANES];
            for (r, phase) in phases.iter().enumerate() {
                let window = &phase[from..from + LANES + ROUNDS - 1];
                for round in 0..ROUNDS {
                    let tap = taps[FACTOR * round + r];
                    for (sum, &x) in sums.iter_mut().zip(&window[round..round + LANES]) {
                        *sum += tap * x;
                    }
                }
            }
            block.copy_from_slice(&sums);
            from += LANES;
        }
        for (m, y) in blocks.into_remainder().iter_mut().enumerate() {
            for (r, phase) in phases.iter().enumerate() {
                for round in 0..ROUNDS {
                    *y += taps[FACTOR * round + r] * phase[from + m + round];
                }
            }
        }
    }
}

/// T_31(x), the Chebyshev polynomial of as many taps less one.
fn chebyshev(x: f64) -> f64 {
    let order = (TAPS - 1) as f64;
    if x.abs() <= 1.0 { (order * x.acos()).cos() } else { x.signum() * (order * x.abs().acosh()).cosh() }
}

/// The Dolph-Chebyshev window of unit sum whose frequency response is T_31(x_0 cos(pi f)) over its value at 0.
fn window(x_0: f64) -> [f64; TAPS] {
    let response = |k: usize| chebyshev(x_0 * (PI * k as f64 / TAPS as f64).cos()) / chebyshev(x_0);
    std::array::from_fn(|j| {
        let at = |k: usize| response(k) * (TAU * k as f64 * (j as f64 - MIDDLE) / TAPS as f64).cos();
        // The response at half the rate, k = TAPS/2, is 0 of an even number of taps.
        (1.0 + 2.0 * (1..TAPS / 2).map(at).sum::<f64>()) / TAPS as f64
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const EDGE: f64 = 3000.0 / 40_960.0;

    fn noise(seed: u32, count: usize) -> Vec<f64> {
        let mut state = seed;
        std::iter::repeat_with(|| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / 4_294_967_296.0 - 0.5
        })
        .take(count)
        .collect()
    }

    /// |X_k|^2 by a sum over all samples.
    fn slow_power(x: &[f64], k: usize) -> f64 {
        let angle = |i: usize| TAU * ((i * k) % x.len()) as f64 / x.len() as f64;
        let re: f64 = x.iter().enumerate().map(|(i, x)| x * angle(i).cos()).sum();
        let im: f64 = x.iter().enumerate().map(|(i, x)| x * angle(i).sin()).sum();
        re * re + im * im
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

        /// Catches a phase, round or wrap at the record's end out of place: the slow twin is the circular convolution.
        #[test]
        fn like_a_circular_convolution(seed in any::<u32>(), kept in 32..200_usize, offset in -3.0..3.0_f64) {
            let count = FACTOR * kept;
            let x: Vec<f64> = noise(seed, count).iter().map(|x| x + offset).collect();
            let mut decimator = Decimator::new(count, EDGE).unwrap();
            let mut y = vec![9.0; 3];
            let mean_square = decimator.decimate(&x, &mut y);
            let mean = x.iter().sum::<f64>() / count as f64;
            let taps = decimator.taps;
            prop_assert_eq!(y.len(), kept);
            for (m, y) in y.iter().enumerate() {
                let slow: f64 = (0..TAPS).map(|j| taps[j] * (x[(FACTOR * m + j) % count] - mean)).sum();
                prop_assert!((y - slow).abs() < 1e-12, "{m}: {y} {slow}");
            }
            let slow = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64;
            prop_assert!((mean_square - slow).abs() < 1e-12);
        }

        /// Catches a bin that is not what it was: white noise, as loud above the bands as in them, bin by bin.
        #[test]
        fn bins_come_back(seed in any::<u32>(), kept in 100..400_usize) {
            let x = noise(seed, FACTOR * kept);
            let mut decimator = Decimator::new(x.len(), EDGE).unwrap();
            let mut y = Vec::new();
            decimator.decimate(&x, &mut y);
            for k in 1..(EDGE * x.len() as f64) as usize {
                let (fast, slow) = (slow_power(&y, k) * decimator.inverse()[k], slow_power(&x, k));
                // Relative to the mean power of a bin: one that happens to be empty still gets what is folded upon it.
                let mean = x.len() as f64 / 12.0;
                prop_assert!((fast - slow).abs() < 2e-6 * (slow + mean), "{k}: {fast} {slow}");
            }
        }
    }

    /// Catches a window that is not normalised, not symmetric, or lets through what folds into the bands.
    #[test]
    fn the_window_stops_what_would_fold() {
        let stop = 0.25 - EDGE;
        let taps = window(1.0 / (PI * stop).cos());
        assert!((taps.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((0..TAPS).all(|j| (taps[j] - taps[TAPS - 1 - j]).abs() < 1e-14));
        let response =
            |f: f64| taps.iter().enumerate().map(|(j, h)| h * (TAU * f * (j as f64 - MIDDLE)).cos()).sum::<f64>().abs();
        let worst = (0..1000).map(|i| response(stop + (0.5 - stop) * f64::from(i) / 999.0)).max_by(f64::total_cmp);
        assert!(worst.unwrap() / response(EDGE) < FOLDED_MOST, "{worst:?} beside {}", response(EDGE));
    }

    /// Catches a filter made for a record that it cannot serve.
    #[test]
    fn what_cannot_be_decimated() {
        assert!(Decimator::<f32>::new(16_384, EDGE).is_some());
        assert!(Decimator::<f32>::new(16_384, 3000.0 / 48_000.0).is_some());
        assert!(Decimator::<f32>::new(16_386, EDGE).is_none());
        assert!(Decimator::<f32>::new(124, EDGE).is_none());
        assert!(Decimator::<f32>::new(0, EDGE).is_none());
        for rate in [30_000.0, 10_000.0, 1000.0, 1e-300] {
            assert!(Decimator::<f32>::new(16_384, 3000.0 / rate).is_none());
        }
    }
}
