//! The limit of a shoulder's strongest arc for a stated rate of false calls.

use crate::arcs::white::White;
use crate::stats::{chi_squared_tail, f_tail, normal_quantile, t_quantile};

/// Euler's constant: the mean of the standard Gumbel distribution.
const EULER: f64 = 0.577_215_664_9;

/// Weight of the spread of white rings next to that of the reference's shoulders, in shoulders.
const PRIOR_COUNT: f64 = 8.0;

/// Strongest arcs of sound shoulders spread more than those of white rings by this factor: their scatter is estimated, that of white
/// rings is given. Found on sound casings of two simulators, smooth and rough: 0.49 to 0.38 standard deviations.
const ESTIMATED_SPREAD: f64 = 1.3;

/// A casing by itself has 1/(this + 2/n) degrees of freedom, where n values estimate its scatter: sound places have longer tails than
/// noise. Found on casings of two simulators with 20 to 100 places a shoulder (`docs/rates.md`).
const OWN_TAILS: f64 = 0.03;

/// Most degrees of freedom of a casing by itself: more places were not measured.
const OWN_DOF_MAX: f64 = 20.0;

/// Largest limit of a casing by itself.
const OWN_MAX: f64 = 1e3;

/// How the strongest arcs of sound shoulders are distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Limits {
    /// From the strongest arcs of the reference's shoulders, each judged by the other casings.
    File {
        /// Mean of those arcs.
        mean: f64,
        /// Their standard deviation, drawn towards that of white rings.
        sd: f64,
        /// Number of casings that they come from: the shoulders of one casing are alike.
        count: f64,
    },
    /// From rings of white noise, with a scatter that is as uncertain as that of the casing's own places.
    Own {
        /// How many discriminators each arc is the evidence of.
        width: f64,
        /// Number of independent arcs whose strongest has the same median as the strongest arc of such a ring.
        count: f64,
        /// Degrees of freedom of the scatter.
        dof: f64,
    },
}

impl Limits {
    /// The limits by the strongest arcs `found` on shoulders of `casing_count` casings, and those of `white` rings.
    pub(crate) fn by(found: &[f64], casing_count: usize, white: White) -> Self {
        let m = found.len() as f64;
        if found.len() < 2 {
            let width = white.width as f64;
            let tail = chi_squared_tail(white.median.powi(2), width);
            let dof = 1.0 / (OWN_TAILS + 2.0 / white.value_count as f64);
            let dof = if dof < OWN_DOF_MAX { dof } else { OWN_DOF_MAX };
            return Self::Own { width, count: 0.5_f64.ln() / (-tail).ln_1p(), dof };
        }
        let mean = found.iter().sum::<f64>() / m;
        let squares: f64 = found.iter().map(|x| (x - mean).powi(2)).sum();
        let prior = PRIOR_COUNT * (ESTIMATED_SPREAD * white.sd).powi(2);
        let sd = ((prior + squares) / (m + PRIOR_COUNT - 1.0)).sqrt();
        Self::File { mean, sd, count: casing_count as f64 }
    }

    /// The limits if the shoulders of `casing_count` casings, at least one, showed nothing but what `white` rings do.
    pub(crate) fn of_noise(casing_count: usize, white: White) -> Self {
        Self::File { mean: white.median, sd: ESTIMATED_SPREAD * white.sd, count: casing_count as f64 }
    }

    /// The value that the strongest arc of a sound shoulder reaches with probability `rate`.
    pub(crate) fn at(self, rate: f64) -> f64 {
        match self {
            Self::File { mean, sd, count } => {
                // Maxima are Gumbel distributed; mean and spread are known from `count` casings alone.
                let dof = count + PRIOR_COUNT - 1.0;
                let widened = (1.0 + 1.0 / count).sqrt() * t_quantile(rate, dof) / normal_quantile(rate);
                mean + gumbel(sd, rate) * widened
            }
            Self::Own { .. } => {
                let (mut low, mut high) = (0.0, OWN_MAX);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if self.probability(middle) > rate { low = middle } else { high = middle }
                }
                0.5 * (low + high)
            }
        }
    }

    /// The probability that the strongest arc of a sound shoulder reaches `value`.
    pub(crate) fn probability(self, value: f64) -> f64 {
        match self {
            Self::File { .. } => {
                // Above this the quotient of quantiles in the limit has no meaning. Most places of a sound shoulder are there.
                const MOST: f64 = 0.4;
                if self.at(MOST) > value {
                    return MOST;
                }
                // The limit falls with the rate, so halving the logarithm finds the rate whose limit the value is.
                let (mut low, mut high) = (1e-9_f64.ln(), MOST.ln());
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if self.at(middle.exp()) > value { low = middle } else { high = middle }
                }
                (0.5 * (low + high)).exp()
            }
            Self::Own { .. } if value.is_nan() || value <= 0.0 => 1.0,
            Self::Own { width, count, dof } => {
                let tail = f_tail(value.powi(2) / width, width, dof);
                -((-tail).ln_1p() * count).exp_m1()
            }
        }
    }
}

/// The strongest arc to expect of a whole ring, if that of a `part` of it is `strongest`, and rings of noise are as `white` says: of n times as
/// many arcs it lies ln n Gumbel scales higher.
pub(crate) fn of_whole_ring(strongest: f64, part: f64, white: White) -> f64 {
    strongest - gumbel_scale(ESTIMATED_SPREAD * white.sd) * part.ln()
}

/// The value above the mean that a Gumbel distributed one of standard deviation `sd` exceeds with probability `rate`.
fn gumbel(sd: f64, rate: f64) -> f64 {
    gumbel_scale(sd) * (-EULER - (-(-rate).ln_1p()).ln())
}

/// The scale of a Gumbel distribution of standard deviation `sd`.
fn gumbel_scale(sd: f64) -> f64 {
    sd * 6.0_f64.sqrt() / std::f64::consts::PI
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn limits_from_few_shoulders_are_exceeded_as_often_as_is_stated() {
        // Catches limits that forget how little a few shoulders show: Gumbel distributed arcs, references of 16, and as many
        // shoulders beyond the limit as the rate says.
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut arc = || 3.0 - 0.5 * (-rng.random_range(1e-12..1.0_f64).ln()).ln();
        let sd = 0.5 * std::f64::consts::PI / 6.0_f64.sqrt() / ESTIMATED_SPREAD;
        let white = White { median: 3.2, sd, width: 1, value_count: 100 };
        for (rate, count) in [(0.1, 4000), (0.02, 20_000)] {
            let mut exceeded = 0;
            for _ in 0..count {
                let reference: Vec<f64> = (0..16).map(|_| arc()).collect();
                exceeded += i32::from(arc() >= Limits::by(&reference, 16, white).at(rate));
            }
            let found = f64::from(exceeded) / f64::from(count);
            assert!((0.6 * rate..1.25 * rate).contains(&found), "{found} of {rate}");
        }
    }

    #[test]
    fn parts_of_rings_stand_for_whole_ones() {
        // Catches limits that are too low because half of each ring of the reference was left out as cracked: the mean of the strongest of 20
        // arcs, brought to 40, is that of the strongest of 40.
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut strongest = |count: usize| {
            let arc = |_| 3.0 - 0.5 * (-rng.random_range(1e-12..1.0_f64).ln()).ln();
            (0..count).map(arc).fold(0.0, |a: f64, b| if b > a { b } else { a })
        };
        let sd = 0.5 * std::f64::consts::PI / 6.0_f64.sqrt() / ESTIMATED_SPREAD;
        let white = White { median: 3.2, sd, width: 1, value_count: 100 };
        let mut mean = |count, part| (0..4000).map(|_| of_whole_ring(strongest(count), part, white)).sum::<f64>() / 4e3;
        let (of_parts, whole) = (mean(20, 0.5), mean(40, 1.0));
        assert!((of_parts - whole).abs() < 0.05, "{of_parts} {whole}");
    }

    #[test]
    fn a_probability_is_the_rate_of_its_limit() {
        // Catches a limit and a probability of two distributions, and one that rises with the value.
        let white = White { median: 3.0, sd: 0.5, width: 6, value_count: 100 };
        for limits in [Limits::by(&[2.5, 3.0, 3.5, 2.8, 3.1], 5, white), Limits::by(&[], 0, white)] {
            for rate in [0.2, 0.02, 1e-3, 1e-6] {
                let back = limits.probability(limits.at(rate));
                assert!((back / rate - 1.0).abs() < 1e-3, "{limits:?} {rate} {back}");
            }
            assert!(limits.at(1e-3) > limits.at(0.02) && limits.probability(1.0) > limits.probability(4.0));
        }
    }

    #[test]
    fn fewer_places_raise_the_limits_of_a_casing_by_itself() {
        // Catches a casing of a handful of places that is rejected for what they cannot show: the limit follows the number of values.
        let limit = |value_count| Limits::by(&[], 0, White { median: 3.6, sd: 0.4, width: 6, value_count }).at(1e-3);
        let limits: Vec<f64> = [1000, 100, 50, 20, 10].into_iter().map(limit).collect();
        assert!(limits.is_sorted(), "{limits:?}");
        assert!(limits[3] > 1.5 * limits[1] && limits[1].to_bits() == limits[0].to_bits(), "{limits:?}");
    }

    #[test]
    fn tails_are_those_of_tables() {
        // scipy.stats.t.isf and norm.isf; catches digits lost in the tail.
        for (rate, dof, expected) in [(0.02, 23.0, 2.176_958_1), (1e-3, 15.0, 3.732_834_4), (1e-5, 20.0, 5.542_2)] {
            let got = t_quantile(rate, dof);
            assert!((got / expected - 1.0).abs() < 1e-3, "{rate} {dof}: {got} {expected}");
        }
        assert!((normal_quantile(1e-3) - 3.090_232_3).abs() < 1e-6);
    }
}
