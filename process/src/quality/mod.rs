//! What is doubtful about a tap, and what becomes of the features that the doubt spoils.
//!
//! A rule is a pure function of one record and its threshold; a flag says that the rule is broken. Whether the spoilt
//! features are then absent, or kept beside the flag, is the [`Policy`] of the flag. A rule looks at nothing but the
//! record, its header and the configuration, so that flags do not depend on what came before.
//!
//! A tap that its policies do not want to stand is marked for retaking where its source can tap again.

mod flat;
mod force;
mod sound;

pub(crate) use force::{Force, of_force};
pub(crate) use sound::{Sound, of_sound};

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use tapline_wire::{Discriminator, Discriminators, Feature, Quality, TapHeader};

use crate::Error;

/// What becomes of features that a flag casts doubt on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Policy {
    /// They stay, and the flag says what to think of them.
    Keep,
    /// Those it spoils are absent.
    Drop,
    /// Those it spoils are absent, and the tap is taken again where its source can.
    Retake,
    /// The tap is taken again where its source can; if that does not help, they stay beside the flag: what shows again and
    /// again is the casing's own.
    RetakeOrKeep,
}

impl Policy {
    fn drops(self) -> bool {
        matches!(self, Self::Drop | Self::Retake)
    }
}

/// The `[process.quality]` table: thresholds of the flags, and a policy for each.
///
/// By default what falsifies a feature takes it away, and what only makes it less sure leaves it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct QualityConfig {
    /// Mass of the impactor, which tells a second hit from a layer that comes back; 0 when it or the force's scale is
    /// not known, and every second pulse is then a second hit.
    pub impactor_mass_kg: f64,
    /// Part of F_max that a second pulse exceeds.
    pub double_hit_share: f64,
    /// Shortest contact time of a casing.
    pub tau_least_s: f64,
    /// Longest contact time of a casing.
    pub tau_most_s: f64,
    /// Least peak of a channel over the standard deviation of its noise.
    pub snr_least: f64,
    /// Greatest amplitude of hum over the sound's peak.
    pub hum_share_most: f64,
    /// Part of the sound's peak that another tap exceeds.
    pub neighbour_share: f64,
    /// Greatest difference of measured and planned velocity over the planned one.
    pub velocity_error_most: f64,
    /// A clipped force spoils F_max and tau, and with them A_1 and A_2.
    pub clipped_force: Policy,
    /// A clipped sound spoils its five features; its power ratio has still told cracks from sound slabs.
    pub clipped_sound: Policy,
    /// A late trigger spoils F_max, tau, A_1 and A_2, and the powers when the record begins within the pulse.
    pub late_trigger: Policy,
    /// A second hit spoils everything: which hit a value is of is not known.
    pub double_hit: Policy,
    /// Too few samples of the pulse spoil F_max, tau, A_1 and A_2; too low a rate for the bands PR, P_f and E_f.
    pub undersampled: Policy,
    /// Hum spoils the sound's five features.
    pub hum: Policy,
    /// Noise spoils the features of its channel.
    pub low_snr: Policy,
    /// Another station's tap spoils A_2, PR, P_f and E_f, and A_1 when it came first.
    pub neighbour: Policy,
    /// Another velocity spoils what follows it: all but PR.
    pub velocity_off: Policy,
    /// Another sample rate spoils all but F_max.
    pub rate_implausible: Policy,
    /// No pulse, no onset or a sample that is not a number: what rests on it is absent under any policy.
    pub no_signal: Policy,
}

impl Default for QualityConfig {
    fn default() -> Self {
        Self {
            impactor_mass_kg: 0.0045,
            double_hit_share: 0.05,
            tau_least_s: 0.35e-3,
            tau_most_s: 4e-3,
            snr_least: 50.0,
            hum_share_most: 0.02,
            neighbour_share: 0.1,
            velocity_error_most: 0.03,
            clipped_force: Policy::Retake,
            clipped_sound: Policy::Keep,
            late_trigger: Policy::Retake,
            double_hit: Policy::Retake,
            undersampled: Policy::Drop,
            hum: Policy::Keep,
            low_snr: Policy::Keep,
            neighbour: Policy::RetakeOrKeep,
            velocity_off: Policy::Keep,
            rate_implausible: Policy::Keep,
            no_signal: Policy::Retake,
        }
    }
}

impl QualityConfig {
    /// The default thresholds with every value kept, whatever its flags say: for looking at what flags would hide.
    pub fn keeping() -> Self {
        Self {
            clipped_force: Policy::Keep,
            clipped_sound: Policy::Keep,
            late_trigger: Policy::Keep,
            double_hit: Policy::Keep,
            undersampled: Policy::Keep,
            hum: Policy::Keep,
            low_snr: Policy::Keep,
            neighbour: Policy::Keep,
            velocity_off: Policy::Keep,
            rate_implausible: Policy::Keep,
            no_signal: Policy::Keep,
            ..Self::default()
        }
    }

    /// Whether a tap that gave `found` had better be taken again: a flag with the policy [`Policy::Retake`] is set, and
    /// a feature is absent that it spoils. A trigger whose mark alone is late, for one, spoils nothing.
    pub fn wants_retake(&self, found: &Discriminators) -> bool {
        use Discriminator::{A2, FMax, Pr};
        let rules: [(Quality, Policy, &[Discriminator]); 13] = [
            (Quality::NON_FINITE, self.no_signal, &Discriminator::ALL),
            (Quality::NO_PULSE, self.no_signal, &[FMax]),
            (Quality::NO_ONSET, self.no_signal, &[A2]),
            (Quality::CLIPPED, self.clipped_force, &[FMax]),
            (Quality::CLIPPED, self.clipped_sound, &[Pr]),
            (Quality::LATE_TRIGGER, self.late_trigger, &[FMax, A2]),
            (Quality::DOUBLE_HIT, self.double_hit, &[FMax]),
            (Quality::UNDERSAMPLED, self.undersampled, &[FMax, Pr]),
            (Quality::HUM, self.hum, &[Pr]),
            (Quality::LOW_SNR, self.low_snr, &[FMax, Pr]),
            (Quality::NEIGHBOUR, self.neighbour, &[Pr]),
            (Quality::VELOCITY_OFF, self.velocity_off, &[FMax, A2]),
            (Quality::RATE_IMPLAUSIBLE, self.rate_implausible, &[Pr]),
        ];
        rules.into_iter().any(|(flag, policy, spoilt)| {
            let is_spoilt = || spoilt.iter().any(|&which| found.values.get(which).is_none());
            let is_wanted = policy == Policy::RetakeOrKeep || (policy == Policy::Retake && is_spoilt());
            is_wanted && found.quality.contains(flag)
        })
    }

    /// Whether the thresholds can be worked with.
    ///
    /// # Errors
    /// [`Error::Threshold`] with the key, its value and the bound that it breaks.
    pub fn validate(&self) -> Result<(), Error> {
        for (key, value, is_good, bound) in [
            ("impactor_mass_kg", self.impactor_mass_kg, self.impactor_mass_kg >= 0.0, "not below 0"),
            ("double_hit_share", self.double_hit_share, self.double_hit_share > 0.0, "above 0"),
            ("tau_least_s", self.tau_least_s, self.tau_least_s >= 0.0, "not below 0"),
            ("tau_most_s", self.tau_most_s, self.tau_most_s > self.tau_least_s, "above tau_least_s"),
            ("snr_least", self.snr_least, self.snr_least >= 0.0, "not below 0"),
            ("hum_share_most", self.hum_share_most, self.hum_share_most > 0.0, "above 0"),
            ("neighbour_share", self.neighbour_share, self.neighbour_share > 0.0, "above 0"),
            ("velocity_error_most", self.velocity_error_most, self.velocity_error_most >= 0.0, "not below 0"),
        ] {
            let is_good = value.is_finite() && is_good;
            if !is_good {
                return Err(Error::Threshold { key, value, bound });
            }
        }
        Ok(())
    }
}

/// The sound's features, as [`Doubts::spoils`] takes them.
pub(crate) static OF_SOUND: LazyLock<Vec<Discriminator>> = LazyLock::new(|| all_of(|of| of != Feature::Pulse));
/// Those of the sound's spectrum.
pub(crate) static OF_SPECTRUM: LazyLock<Vec<Discriminator>> =
    LazyLock::new(|| all_of(|of| of == Feature::SoundSpectrum));

fn all_of(is_wanted: impl Fn(Feature) -> bool) -> Vec<Discriminator> {
    Discriminator::ALL.into_iter().filter(|which| is_wanted(which.feature())).collect()
}

/// Flags raised by a record, and the features that are absent because of them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Doubts {
    /// Flags.
    pub(crate) flags: Quality,
    /// Why the pulse, and all that rests on it, must not be used.
    pub(crate) pulse_spoilt_by: Option<Quality>,
    dropped: [bool; Discriminator::COUNT],
}

impl Doubts {
    /// Raises `flag`, which spoils `which` if the `policy` is to drop them.
    pub(crate) fn spoils(&mut self, flag: Quality, policy: Policy, which: &[Discriminator]) {
        self.flags.insert(flag);
        if policy.drops() {
            which.iter().for_each(|&which| self.dropped[which as usize] = true);
        }
    }

    /// Raises `flag`, which spoils the pulse if the `policy` is to drop what rests on it.
    pub(crate) fn spoils_pulse(&mut self, flag: Quality, policy: Policy) {
        self.flags.insert(flag);
        if policy.drops() && self.pulse_spoilt_by.is_none() {
            self.pulse_spoilt_by = Some(flag);
        }
    }

    /// Takes the spoilt features out of `found` and adds the flags.
    pub(crate) fn settle(&self, found: &mut Discriminators) {
        found.quality.insert(self.flags);
        for which in Discriminator::ALL.into_iter().filter(|&which| self.dropped[which as usize]) {
            found.values.set(which, None);
        }
    }
}

/// What is doubtful about the velocity: nothing when the measured or the meant one is not known.
pub(crate) fn of_velocity(header: &TapHeader, config: &QualityConfig) -> Doubts {
    let mut doubts = Doubts::default();
    let meant = Some(header.velocity_nominal_m_per_s).filter(|&v| v > 0.0);
    let error = meant.map_or(0.0, |v| (header.velocity_measured_m_per_s / v - 1.0).abs());
    if error > config.velocity_error_most {
        let all_but_pr = Discriminator::ALL.into_iter().filter(|&which| which != Discriminator::Pr);
        doubts.spoils(Quality::VELOCITY_OFF, config.velocity_off, &all_but_pr.collect::<Vec<_>>());
    }
    doubts
}

/// Velocity of the impact, m/s, as measured or else as planned.
pub(crate) fn velocity_m_per_s(header: &TapHeader) -> Option<f64> {
    let measured = Some(header.velocity_measured_m_per_s).filter(|&v| v > 0.0 && v.is_finite());
    measured.or_else(|| header.id.velocity_m_per_s().filter(|&v| v > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a default that does not pass its own checks, a key that is not read, and one that is not checked.
    #[test]
    fn thresholds_are_read_and_checked() {
        assert_eq!(QualityConfig::default().validate(), Ok(()));
        let config: QualityConfig = toml::from_str("double_hit = \"keep\"\nsnr_least = 10.0").unwrap();
        assert_eq!((config.double_hit, config.snr_least), (Policy::Keep, 10.0));
        assert!(toml::from_str::<QualityConfig>("duble_hit = \"keep\"").is_err());
        assert!(toml::from_str::<QualityConfig>("double_hit = \"refuse\"").is_err());
        let config: QualityConfig = toml::from_str("hum = \"retake\"").unwrap();
        assert_eq!((config.hum, config.double_hit), (Policy::Retake, Policy::Retake));
        let bad = QualityConfig { tau_most_s: 1e-4, ..QualityConfig::default() };
        let message = bad.validate().unwrap_err().to_string();
        assert_eq!(message, "process.quality.tau_most_s = 0.0001: must be finite and above tau_least_s");
        assert!(QualityConfig { hum_share_most: f64::NAN, ..QualityConfig::default() }.validate().is_err());
    }

    /// Catches a flag raised for want of a measurement or of a plan, and a comparison in one direction only.
    #[test]
    fn velocity_off_needs_both_velocities() {
        let is_off = |meant, measured| {
            let header = TapHeader {
                velocity_nominal_m_per_s: meant,
                velocity_measured_m_per_s: measured,
                ..TapHeader::default()
            };
            !of_velocity(&header, &QualityConfig::default()).flags.is_clean()
        };
        assert!(is_off(1.85, 1.95) && is_off(1.85, 1.75) && is_off(1.85, 0.0));
        assert!(!is_off(1.85, 1.83) && !is_off(1.85, f64::NAN) && !is_off(f64::NAN, 1.2) && !is_off(0.0, 1.2));
    }

    /// Catches features dropped under `keep`, and a first reason that a later one replaces.
    #[test]
    fn policies_are_heeded() {
        let mut doubts = Doubts::default();
        doubts.spoils(Quality::HUM, Policy::Keep, &OF_SOUND);
        doubts.spoils(Quality::NEIGHBOUR, Policy::Drop, &OF_SPECTRUM);
        doubts.spoils_pulse(Quality::LATE_TRIGGER, Policy::Keep);
        doubts.spoils_pulse(Quality::CLIPPED, Policy::Drop);
        doubts.spoils_pulse(Quality::DOUBLE_HIT, Policy::Drop);
        assert_eq!(doubts.pulse_spoilt_by, Some(Quality::CLIPPED));
        let mut found = Discriminators::default();
        Discriminator::ALL.iter().for_each(|&which| found.values.set(which, Some(1.0)));
        doubts.settle(&mut found);
        assert_eq!(
            Discriminator::ALL.map(|which| found.values.get(which).is_some()),
            Discriminator::ALL.map(|which| which.feature() != Feature::SoundSpectrum)
        );
        assert_eq!(found.quality.to_string(), "clipped|late_trigger|double_hit|hum|neighbour");
    }

    /// Catches a retake asked for though the policy does not, one not asked for though it does, and one for a flag that
    /// has taken nothing away.
    #[test]
    fn retakes_are_asked_for_by_policy() {
        let whole = || {
            let mut found = Discriminators::default();
            Discriminator::ALL.iter().for_each(|&which| found.values.set(which, Some(1.0)));
            found
        };
        let found = |flag, absent: &[Discriminator]| {
            let mut found = Discriminators { quality: flag, ..whole() };
            absent.iter().for_each(|&which| found.values.set(which, None));
            found
        };
        let config = QualityConfig::default();
        assert!(!config.wants_retake(&whole()));
        assert!(config.wants_retake(&found(Quality::CLIPPED, &[Discriminator::FMax])));
        assert!(!config.wants_retake(&found(Quality::CLIPPED, &[])), "a clipped sound is kept");
        assert!(!config.wants_retake(&found(Quality::LATE_TRIGGER, &[])), "only the mark is late");
        assert!(!config.wants_retake(&found(Quality::UNDERSAMPLED, &Discriminator::ALL)), "the next is as coarse");
        assert!(!config.wants_retake(&found(Quality::NO_FORCE, &[Discriminator::FMax])), "there is no force to have");
        for flag in
            [Quality::DOUBLE_HIT, Quality::NEIGHBOUR, Quality::LATE_TRIGGER, Quality::NO_PULSE, Quality::NON_FINITE]
        {
            assert!(config.wants_retake(&found(flag, &Discriminator::ALL)), "{flag}");
            let drop = Policy::Drop;
            let config =
                QualityConfig { double_hit: drop, neighbour: drop, late_trigger: drop, no_signal: drop, ..config };
            assert!(!config.wants_retake(&found(flag, &Discriminator::ALL)), "{flag}");
        }
        let hum = QualityConfig { hum: Policy::Retake, ..config };
        assert!(hum.wants_retake(&found(Quality::HUM, &[Discriminator::Pr])));
    }
}
