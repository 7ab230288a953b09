//! How force and duration depend on the impact velocity on this rig, and their values at the planned one.
//!
//! F_max goes as V^p and tau as V^-q. Hertz's contact has p = 1.2 and q = 0.2; hammer tips have been measured at 1.31 and
//! at 0.93, so the exponents are fitted to the taps themselves. Taps of several velocities meet only here, after the
//! stage that sees one tap at a time; the archive keeps the measured values.

use tapline_wire::{Discriminator, Values};

/// Greatest standard error of an exponent that is used. The error of measured velocities is not in it: it makes an exponent too small, by
/// the part of the velocities' variance that is error.
const STANDARD_ERROR_MOST: f64 = 0.1;

/// A quantity that goes as a power of the velocity, in each of several groups with a factor of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PowerLaw {
    /// The exponent.
    pub exponent: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// Standard deviation of the logarithm about the law.
    pub residual: f64,
}

impl PowerLaw {
    /// The least-squares line through ln value over ln velocity, of one slope for all groups; `points` are (group,
    /// velocity, value), groups numbered from 0. What has no logarithm is left out.
    ///
    /// `None` with fewer than two more points than groups, or if the velocity does not vary within any.
    pub fn fit(points: impl IntoIterator<Item = (usize, f64, f64)>) -> Option<Self> {
        let mut groups: Vec<Vec<(f64, f64)>> = Vec::new();
        for (group, velocity, value) in points {
            if velocity > 0.0 && value > 0.0 && velocity.is_finite() && value.is_finite() {
                groups.resize_with(groups.len().max(group + 1), Vec::new);
                groups[group].push((velocity.ln(), value.ln()));
            }
        }
        groups.retain(|group| !group.is_empty());
        let count: usize = groups.iter().map(Vec::len).sum();
        let free_count = count.checked_sub(groups.len() + 1).filter(|&free| free > 0)?;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for group in &groups {
            let n = group.len() as f64;
            let x_mean = group.iter().map(|(x, _)| x).sum::<f64>() / n;
            let y_mean = group.iter().map(|(_, y)| y).sum::<f64>() / n;
            for (x, y) in group {
                let (x, y) = (x - x_mean, y - y_mean);
                (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
            }
        }
        // Equal velocities differ by rounding at most.
        let varies = xx > 1e-20 * count as f64;
        if !varies {
            return None;
        }
        let exponent = xy / xx;
        let left = yy - exponent * xy;
        let variance = if left > 0.0 { left / free_count as f64 } else { 0.0 };
        Some(Self { exponent, standard_error: (variance / xx).sqrt(), residual: variance.sqrt() })
    }
}

/// A tap as the laws see it: group, measured velocity and values.
pub(crate) type Struck = (usize, f64, Values);

/// What brings F_max and tau from the measured to the planned velocity.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Normalisation {
    f_max: Option<f64>,
    tau: Option<f64>,
}

impl Normalisation {
    /// With exponents fitted to `taps`; a quantity whose exponent they do not determine stays as it is.
    pub(crate) fn fitted(taps: &[Struck]) -> Self {
        let exponent = |which| {
            let points = taps.iter().filter_map(|&(group, v, ref values)| Some((group, v, values.get(which)?)));
            PowerLaw::fit(points).filter(|law| law.standard_error <= STANDARD_ERROR_MOST).map(|law| law.exponent)
        };
        Self { f_max: exponent(Discriminator::FMax), tau: exponent(Discriminator::Tau) }
    }

    /// `values` as they would have been at the `planned` velocity; as they are when either velocity is unknown.
    pub(crate) fn applied(&self, mut values: Values, planned: Option<f64>, measured: f64) -> Values {
        let is_known = measured > 0.0 && measured.is_finite();
        let Some(ratio) = planned.filter(|&v| v > 0.0 && is_known).map(|planned| planned / measured) else {
            return values;
        };
        for (which, exponent) in [(Discriminator::FMax, self.f_max), (Discriminator::Tau, self.tau)] {
            if let (Some(exponent), Some(value)) = (exponent, values.get(which)) {
                values.set(which, Some(value * ratio.powf(exponent)));
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Catches a slope through all groups at once, which their own factors would tilt.
        #[test]
        fn a_power_law_returns_its_exponent(p in -2.0..2.0_f64, a in 0.1..50.0_f64, b in 0.1..50.0_f64, shift in 0.5..2.0_f64) {
            let points = (0..20).map(|i| {
                let v = 1.0 + 0.05 * f64::from(i / 2);
                let (group, factor, v) = if i % 2 == 0 { (0, a, v) } else { (1, b, v * shift) };
                (group, v, factor * v.powf(p))
            });
            let law = PowerLaw::fit(points).unwrap();
            prop_assert!((law.exponent - p).abs() < 1e-9 && law.residual < 1e-6, "{law:?}");
        }
    }

    /// Catches an error that is not that of the slope: of points with a known scatter, by its formula.
    #[test]
    fn the_standard_error_is_that_of_the_slope() {
        let e = [0.1, -0.1, -0.1, 0.1_f64]; // orthogonal to a line, so the slope is exact
        let points = e.iter().zip([-3.0, -1.0, 1.0, 3.0]).map(|(e, x): (&f64, f64)| (0, x.exp(), (2.0 * x + e).exp()));
        let law = PowerLaw::fit(points).unwrap();
        assert!((law.exponent - 2.0).abs() < 1e-12);
        assert!(
            (law.residual - 0.02_f64.sqrt()).abs() < 1e-12 && (law.standard_error - 0.001_f64.sqrt()).abs() < 1e-12
        );
    }

    /// Catches an exponent made up from one velocity, too few taps, or numbers without a logarithm.
    #[test]
    fn no_law_without_evidence() {
        assert_eq!(PowerLaw::fit([]), None);
        assert_eq!(PowerLaw::fit([(0, 1.0, 2.0), (0, 2.0, 4.0)]), None);
        assert_eq!(PowerLaw::fit((0..9).map(|i| (0, 1.85, 30.0 + f64::from(i)))), None);
        assert_eq!(PowerLaw::fit((0..9).map(|i| (0, f64::from(i), -1.0))), None);
        assert_eq!(PowerLaw::fit((0..9).map(|i| (0, f64::NAN, f64::from(i)))), None);
    }

    /// Catches a ratio upside down, and values changed without a law or a velocity.
    #[test]
    fn values_come_to_the_planned_velocity() {
        let mut values = Values::default();
        values.set(Discriminator::FMax, Some(30.0 * 1.05_f64.powf(1.2)));
        values.set(Discriminator::Pr, Some(0.3));
        let law = Normalisation { f_max: Some(1.2), tau: Some(-0.2) };
        let applied = law.applied(values, Some(1.0), 1.05);
        assert!((applied.get(Discriminator::FMax).unwrap() - 30.0).abs() < 1e-12);
        assert_eq!((applied.get(Discriminator::Pr), applied.get(Discriminator::Tau)), (Some(0.3), None));
        for (planned, measured) in [(None, 1.05), (Some(1.0), f64::NAN), (Some(1.0), 0.0), (Some(0.0), 1.0)] {
            assert_eq!(
                law.applied(values, planned, measured).get(Discriminator::FMax),
                values.get(Discriminator::FMax)
            );
        }
        assert_eq!(Normalisation::fitted(&[(0, 1.0, values); 40]), Normalisation::default());
    }

    /// Catches a slope that real hammers do not have: two tips of an automated hammer, whose exponents lie on either
    /// side of Hertz's 1.2. Forces up to 5 N are left out: they are whole newtons, and 3 N may be 3.5.
    #[test]
    fn exponents_of_recorded_hammer_tips() {
        for (tip, exponent, residual) in [("bluetip", 1.31, 0.11), ("whitetip", 0.93, 0.17)] {
            let Some(path) = tapline_testing::shared(&format!("amh-hammer-calibration/{tip}.csv")) else { return };
            let text = std::fs::read_to_string(path).unwrap();
            let points = text.lines().skip(1).filter_map(|line| {
                let (force, speed) = line.split_once(',')?;
                Some((0, speed.parse().ok()?, force.parse().ok()?))
            });
            let law = PowerLaw::fit(points.filter(|point: &(usize, f64, f64)| point.2 > 5.0)).unwrap();
            assert!((law.exponent - exponent).abs() < 0.005, "{tip}: {law:?}");
            assert!((law.residual - residual).abs() < 0.005, "{tip}: {law:?}");
        }
    }
}
