//! Settings of the stage: the `[process]` table.

use serde::{Deserialize, Serialize};

use crate::{BandEdges, DurationEstimator, Error, PeakEstimator, QualityConfig, Subtraction};

/// Arithmetic of the long sums and the transform; all definitions are in `f64`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision: within 1e-4 of double precision, and faster.
    #[default]
    F32,
    /// Double precision.
    F64,
}

/// The `[process]` table: bands, estimators and arithmetic of the discriminators.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessConfig {
    /// Length of each record that is used, from its first sample on; the rest is ignored. 0 uses all of it.
    pub record_s: f64,
    /// Lower edge f_c of the flexural band, Hz.
    pub f_c_hz: f64,
    /// Upper edge of the flexural band, Hz.
    pub f_hi_hz: f64,
    /// Lower edge of PR's reference band, Hz.
    pub f_lo_hz: f64,
    /// Upper edge of PR's reference band, Hz.
    pub f_top_hz: f64,
    /// Whether f_c follows each tap as 1/(2 tau); a tap without tau keeps `f_c_hz` and has a flag that says why.
    pub f_c_follows_tau: bool,
    /// How F_max is found.
    pub f_max: PeakEstimator,
    /// How tau is found.
    pub tau: DurationEstimator,
    /// Time constant of the force sensor's coupling, whose droop is corrected; 0 if the sensor has none.
    pub droop_time_constant_s: f64,
    /// How bins at a band's edge count.
    pub band_edges: BandEdges,
    /// What is subtracted from the sound; it is estimated before the trigger.
    pub subtract: Subtraction,
    /// Frequency of the hum that `subtract` may remove, Hz.
    pub mains_hz: f64,
    /// Arithmetic.
    pub precision: Precision,
    /// Thresholds and policies of the quality flags.
    pub quality: QualityConfig,
}

impl Default for ProcessConfig {
    /// The method's own estimators, with bands for tyres.
    fn default() -> Self {
        Self {
            record_s: 0.0,
            f_c_hz: 550.0,
            f_hi_hz: 2000.0,
            f_lo_hz: 70.0,
            f_top_hz: 3000.0,
            f_c_follows_tau: false,
            f_max: PeakEstimator::Parabola,
            tau: DurationEstimator::HalfSine,
            droop_time_constant_s: 0.0,
            band_edges: BandEdges::Bins,
            subtract: Subtraction::None,
            mains_hz: 50.0,
            precision: Precision::F32,
            quality: QualityConfig::default(),
        }
    }
}

impl ProcessConfig {
    /// Checks every setting against its bounds.
    ///
    /// The flexural band lies inside the reference band; an f_c that follows tau is kept there tap by tap.
    ///
    /// # Errors
    /// [`Error`] with the key, its value and the bound that it breaks.
    pub fn validate(&self) -> Result<(), Error> {
        let check = |key, value: f64, unit, is_good: bool, bound| {
            let is_good = value.is_finite() && is_good;
            if is_good { Ok(()) } else { Err(Error::OutOfBounds { table: "process", key, value, unit, bound }) }
        };
        check("f_c_hz", self.f_c_hz, " Hz", self.f_c_hz > 0.0, "above 0")?;
        check("f_hi_hz", self.f_hi_hz, " Hz", self.f_hi_hz > 0.0, "above 0")?;
        check("f_lo_hz", self.f_lo_hz, " Hz", self.f_lo_hz >= 0.0, "not below 0")?;
        check("f_top_hz", self.f_top_hz, " Hz", self.f_top_hz > 0.0, "above 0")?;
        check("mains_hz", self.mains_hz, " Hz", self.mains_hz > 0.0, "above 0")?;
        check("record_s", self.record_s, " s", self.record_s >= 0.0, "not below 0")?;
        let droop_s = self.droop_time_constant_s;
        check("droop_time_constant_s", droop_s, " s", droop_s >= 0.0, "not below 0")?;
        let Self { f_c_hz, f_hi_hz, f_lo_hz, f_top_hz, .. } = *self;
        let band = |key, value, (is_good, relation), bound_key, bound| {
            if is_good { Ok(()) } else { Err(Error::Band { key, value, relation, bound_key, bound }) }
        };
        band("f_hi_hz", f_hi_hz, (f_hi_hz > f_c_hz, "above"), "f_c_hz", f_c_hz)?;
        band("f_top_hz", f_top_hz, (f_top_hz > f_lo_hz, "above"), "f_lo_hz", f_lo_hz)?;
        // PR is a part of a whole (Eq. 52). An f_c that follows tau never goes below f_lo.
        let is_within = f_c_hz >= f_lo_hz || self.f_c_follows_tau;
        band("f_c_hz", f_c_hz, (is_within, "at or above"), "f_lo_hz", f_lo_hz)?;
        band("f_hi_hz", f_hi_hz, (f_hi_hz <= f_top_hz, "at or below"), "f_top_hz", f_top_hz)?;
        self.quality.validate()
    }

    /// Samples of each channel that are used, from the first on, of a record of `sample_count` at `sample_rate_hz`.
    pub fn samples_looked_at(&self, sample_count: u32, sample_rate_hz: f64) -> u32 {
        let asked_for = (self.record_s * sample_rate_hz).ceil();
        // A record without a valid rate is refused anyway.
        let is_less = asked_for > 0.0 && asked_for < f64::from(sample_count);
        if is_less { asked_for as u32 } else { sample_count }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a default that does not pass its own checks, or a default other than the method's bands.
    #[test]
    fn default_is_the_tyre_bands() {
        let config = ProcessConfig::default();
        assert_eq!(config.validate(), Ok(()));
        let empty: ProcessConfig = toml::from_str("").unwrap();
        assert_eq!(empty, config);
        let edges = [config.f_lo_hz, config.f_c_hz, config.f_hi_hz, config.f_top_hz];
        assert_eq!(edges.map(|f_hz| f_hz as u32), [70, 550, 2000, 3000]);
    }

    /// Catches a key that is not read, and a precision spelt otherwise than documented.
    #[test]
    fn toml_keys() {
        let config: ProcessConfig =
            toml::from_str("f_lo_hz = 0.0\nprecision = \"f64\"\nf_c_follows_tau = true").unwrap();
        assert_eq!((config.f_lo_hz, config.precision, config.f_c_follows_tau), (0.0, Precision::F64, true));
        assert_eq!(config.validate(), Ok(()));
        assert!(toml::from_str::<ProcessConfig>("f_high_hz = 1.0").is_err());
        assert!(toml::from_str::<ProcessConfig>("precision = \"f16\"").is_err());
    }

    /// Catches an estimator that no name selects, or that another name selects.
    #[test]
    fn estimators_by_name() {
        let parsed = |text: &str| toml::from_str::<ProcessConfig>(text).unwrap();
        use {DurationEstimator as D, PeakEstimator as P, Subtraction as B};
        for (name, chosen) in [("raw", P::Raw), ("parabola", P::Parabola), ("polynomial", P::Polynomial)] {
            assert_eq!(parsed(&format!("f_max = \"{name}\"")).f_max, chosen);
        }
        for (name, chosen) in
            [("half_sine", D::HalfSine), ("width_02", D::Width02), ("width_50", D::Width50), ("impulse", D::Impulse)]
        {
            assert_eq!(parsed(&format!("tau = \"{name}\"")).tau, chosen);
        }
        for (name, chosen) in [("none", B::None), ("noise", B::Noise), ("hum", B::Hum), ("both", B::Both)] {
            assert_eq!(parsed(&format!("subtract = \"{name}\"")).subtract, chosen);
        }
        assert_eq!(parsed("band_edges = \"fractional\"").band_edges, BandEdges::Fractional);
        assert!(toml::from_str::<ProcessConfig>("tau = \"width_2\"").is_err());
    }

    /// Catches a check that accepts an empty band, or PR's beyond its reference, or that names the wrong key.
    #[test]
    fn refusals_name_key_value_and_bound() {
        let good = ProcessConfig::default();
        for (config, message) in [
            (ProcessConfig { f_hi_hz: 550.0, ..good }, "f_hi_hz = 550 Hz: must be above process.f_c_hz = 550 Hz"),
            (ProcessConfig { f_lo_hz: 5000.0, ..good }, "f_top_hz = 3000 Hz: must be above process.f_lo_hz = 5000 Hz"),
            (ProcessConfig { f_lo_hz: 600.0, ..good }, "f_c_hz = 550 Hz: must be at or above process.f_lo_hz = 600 Hz"),
            (
                ProcessConfig { f_hi_hz: 3001.0, ..good },
                "f_hi_hz = 3001 Hz: must be at or below process.f_top_hz = 3000 Hz",
            ),
            (ProcessConfig { f_c_hz: f64::NAN, ..good }, "f_c_hz = NaN Hz: must be finite and above 0"),
            (ProcessConfig { f_lo_hz: -1.0, ..good }, "f_lo_hz = -1 Hz: must be finite and not below 0"),
            (ProcessConfig { record_s: -0.1, ..good }, "record_s = -0.1 s: must be finite and not below 0"),
        ] {
            assert_eq!(config.validate().unwrap_err().to_string(), format!("process.{message}"));
        }
        let edges = ProcessConfig { f_lo_hz: 550.0, f_hi_hz: 3000.0, ..good };
        assert_eq!(edges.validate(), Ok(()));
        let following = ProcessConfig { f_lo_hz: 600.0, f_c_follows_tau: true, ..good };
        assert_eq!(following.validate(), Ok(()));
        assert!(ProcessConfig { f_top_hz: f64::INFINITY, ..good }.validate().is_err());
        assert!(ProcessConfig { droop_time_constant_s: -1.0, ..good }.validate().is_err());
        assert!(ProcessConfig { mains_hz: f64::NAN, ..good }.validate().is_err());
    }
}
