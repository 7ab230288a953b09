//! The height of a pulse's peak.

/// Fraction of the peak above which samples enter the polynomial.
const POLYNOMIAL_LEVEL: f64 = 0.7;
/// Order of the polynomial.
const ORDER: usize = 4;
/// Fewest samples for which the polynomial is fitted.
const POLYNOMIAL_SAMPLES_MIN: usize = 9;

/// Height of the parabola through the sample at `peak_at` and its two neighbours. It is the sample itself at the
/// record's edge, and where the three lie on a line.
pub(super) fn vertex(value: impl Fn(usize) -> f64, count: usize, peak_at: usize) -> f64 {
    let b = value(peak_at);
    if peak_at == 0 || peak_at + 1 >= count {
        return b;
    }
    let (a, c) = (value(peak_at - 1), value(peak_at + 1));
    let curvature = a - 2.0 * b + c;
    if curvature < 0.0 { b - (a - c).powi(2) / (8.0 * curvature) } else { b }
}

/// Maximum of the quartic fitted to the samples around `peak_at` above 70 % of the parabola's vertex, between the first
/// and the last of them. `None` with fewer than nine samples, and if the fit has no maximum there.
pub(super) fn polynomial(value: impl Fn(usize) -> f64, count: usize, peak_at: usize) -> Option<f64> {
    let level = POLYNOMIAL_LEVEL * vertex(&value, count, peak_at);
    let above = |i: &usize| value(*i) > level;
    let before = (0..peak_at).rev().take_while(above).count();
    let after = (peak_at + 1..count).take_while(above).count();
    if before + 1 + after < POLYNOMIAL_SAMPLES_MIN {
        return None;
    }
    let first = peak_at - before;
    let fit = Quartic::fit(|i| value(first + i), before + 1 + after);
    Some(fit.maximum()).filter(|height| height.is_finite())
}

/// A least-squares quartic over -1 to 1, as a sum of polynomials that are orthogonal on the samples (Forsythe 1957), so
/// that no system of equations must be solved.
#[derive(Debug, Clone, Copy)]
struct Quartic {
    alpha: [f64; ORDER + 1],
    beta: [f64; ORDER + 1],
    weight: [f64; ORDER + 1],
}

impl Quartic {
    /// Fits `count` samples, spread evenly from -1 to 1; there must be more than `ORDER`.
    fn fit(value: impl Fn(usize) -> f64, count: usize) -> Self {
        let half = (count - 1) as f64 / 2.0;
        let mut fit = Self { alpha: [0.0; ORDER + 1], beta: [0.0; ORDER + 1], weight: [0.0; ORDER + 1] };
        let mut last_norm = 1.0;
        for k in 0..=ORDER {
            let (mut norm, mut moment, mut product) = (0.0, 0.0, 0.0);
            for i in 0..count {
                let x = (i as f64 - half) / half;
                let p = fit.basis(x)[k];
                norm += p * p;
                moment += x * p * p;
                product += p * value(i);
            }
            fit.weight[k] = product / norm;
            fit.alpha[k] = moment / norm;
            fit.beta[k] = norm / last_norm;
            last_norm = norm;
        }
        fit
    }

    /// p_0 to p_4 at `x`: p_(k+1) = (x - alpha_k) p_k - beta_k p_(k-1).
    fn basis(&self, x: f64) -> [f64; ORDER + 1] {
        let mut p = [1.0; ORDER + 1];
        p[1] = x - self.alpha[0];
        for k in 1..ORDER {
            p[k + 1] = (x - self.alpha[k]) * p[k] - self.beta[k] * p[k - 1];
        }
        p
    }

    fn at(&self, x: f64) -> f64 {
        self.basis(x).iter().zip(&self.weight).map(|(p, w)| p * w).sum()
    }

    /// Largest value from -1 to 1. Around each top of a grid, the two neighbouring cells are searched by ternary
    /// search. A quartic has at most two tops, and the grid may order them wrongly.
    fn maximum(&self) -> f64 {
        const CELLS: u32 = 64;
        let grid = |i: u32| f64::from(i) * 2.0 / f64::from(CELLS) - 1.0;
        let at = |i: u32| self.at(grid(i));
        let is_top = |&i: &u32| at(i) >= at(i.saturating_sub(1)) && at(i) >= at(if i < CELLS { i + 1 } else { i });
        let tops = (0..=CELLS).filter(is_top).map(|i| {
            let (low, high) = (grid(i.saturating_sub(1)), grid(if i < CELLS { i + 1 } else { i }));
            self.top_between(low, high)
        });
        tops.max_by(f64::total_cmp).unwrap_or(f64::NAN)
    }

    /// Largest value from `low` to `high`, where the quartic has one top.
    fn top_between(&self, mut low: f64, mut high: f64) -> f64 {
        const THIRDS: u32 = 40; // (2/3)^40 of a cell is 1e-9, and the value's error goes with its square
        for _ in 0..THIRDS {
            let third = (high - low) / 3.0;
            if self.at(low + third) < self.at(high - third) { low += third } else { high -= third }
        }
        self.at(f64::midpoint(low, high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a parabola through the wrong samples or with a wrong sign: any parabola returns its own vertex.
    #[test]
    fn parabola_returns_its_vertex() {
        for shift in [-0.49, -0.2, 0.0, 0.3, 0.5] {
            let value = |i: usize| 9.0 - 2.0 * (i as f64 - 3.0 - shift).powi(2);
            assert!((vertex(value, 7, 3) - 9.0).abs() < 1e-12, "{shift}");
        }
        assert!((vertex(|_| 4.0, 7, 3) - 4.0).abs() < 1e-15);
        assert!((vertex(|i| i as f64, 7, 6) - 6.0).abs() < 1e-15);
        assert!((vertex(|i| -(i as f64), 7, 0)).abs() < 1e-15);
    }

    /// Catches a wrong recurrence, and a search in too coarse a grid: any quartic returns its own top, known where its
    /// derivative -4 (x - r) ((x - s)^2 + t) vanishes.
    #[test]
    fn quartic_returns_its_top() {
        for (r, s, t) in [(0.0, 0.3, 0.5), (0.37, -0.2, 0.1), (-0.71, 0.9, 2.0)] {
            // The integral of -4 (x - r)((x - s)^2 + t) from r on.
            let quartic = |x: f64| {
                let u = x - r;
                let d = r - s;
                7.0 - 4.0 * (u.powi(4) / 4.0 + 2.0 * d * u.powi(3) / 3.0 + (d * d + t) * u * u / 2.0)
            };
            for count in [9, 10, 15, 200] {
                let half = f64::from(count - 1) / 2.0;
                let fit = Quartic::fit(|i| quartic((i as f64 - half) / half), count as usize);
                assert!((fit.maximum() - 7.0).abs() < 1e-12, "{r} {count}: {}", fit.maximum());
            }
        }
    }

    /// Catches the lower of two tops, chosen because the grid shows it higher.
    #[test]
    fn quartic_with_two_tops_returns_the_higher() {
        // Tops at -0.5 and 0.5 + shift, of nearly equal height; a top that falls on the grid of 1/32 looks higher.
        for (shift, tilt) in [(0.015, 1e-4), (0.0, 1e-4), (0.015, -1e-4), (0.008, 2e-4)] {
            let quartic = |x: f64| 1.0 - 16.0 * (x + 0.5).powi(2) * (x - 0.5 - shift).powi(2) + tilt * x;
            let fit = Quartic::fit(|i| quartic((i as f64 - 20.0) / 20.0), 41);
            let on_grid =
                (0..=200_000).map(|i| quartic(f64::from(i) / 100_000.0 - 1.0)).max_by(f64::total_cmp).unwrap();
            assert!((fit.maximum() - on_grid).abs() < 1e-8, "{shift} {tilt}: {} {on_grid}", fit.maximum());
        }
    }

    /// Catches a fit to samples of another pulse, of the flanks, or to too few samples.
    #[test]
    fn polynomial_takes_the_top_of_the_pulse_only() {
        let top = |i: usize, at: f64, width: f64| 10.0 - 3.0 * ((i as f64 - at) / width).powi(2);
        let value = |i: usize| match i {
            20..=30 => top(i, 25.2, 6.0),
            40..=50 => 9.9,
            _ => 0.0,
        };
        assert!((polynomial(value, 60, 25).unwrap() - 10.0).abs() < 1e-12);
        assert_eq!(polynomial(|i| top(i, 25.0, 4.0), 60, 25), None); // seven samples above 70 %
        assert_eq!(polynomial(|_| f64::NAN, 60, 25), None);
    }
}
