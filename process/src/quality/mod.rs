//! Quality flags: what is wrong with a tap, and what happens to the affected discriminators.
//!
//! A rule is a pure function of one record, its header and the configuration, so flags do not depend on earlier taps.
//! Where a record breaks a rule, its flag is raised; the [`Policy`] of the flag decides whether the affected discriminators are
//! dropped, or kept with the flag, and whether the tap is taken again.

mod flat;
mod force;
mod report;
mod sound;
mod spike;
mod still;

pub(crate) use force::{ForceRecord, check_force, fill_means};
pub(crate) use report::QualityReport;
pub(crate) use sound::{SoundRecord, check_sound};
pub(crate) use still::stands_still;

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use tapline_wire::{Discriminator, Discriminators, Quality, RecordPart, TapHeader};

use crate::Error;
use crate::signal::extent::Extent;
use crate::signal::record::Count;

/// What happens to the discriminators that a flag affects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Policy {
    /// They are kept, with the flag.
    Keep,
    /// They are dropped.
    Drop,
    /// They are dropped, and the tap is taken again if its source can.
    Retake,
    /// The tap is taken again if its source can. If the flag is raised again, the discriminators are kept: a repeated effect
    /// is due to the casing.
    RetakeOrKeep,
}

impl Policy {
    fn drops(self) -> bool {
        matches!(self, Self::Drop | Self::Retake)
    }
}

/// Defines [`QualityConfig`]. A threshold has its default and its bound, in words and as a condition on its value and the whole table.
/// A policy has its default, its flags, and the discriminators that are absent if the policy has dropped something for the flag.
macro_rules! quality_config {
    (
        thresholds { $($(#[$threshold_doc:meta])* $threshold:ident = $value:literal, $bound:literal: $is_good:expr;)* }
        policies { $($(#[$policy_doc:meta])* $policy:ident = $default:ident, $($flag:ident drops $discriminators:expr),+;)* }
    ) => {
        /// The `[process.quality]` table: thresholds of the flags, and their policies.
        ///
        /// By default a flag drops a discriminator whose value would be wrong, and keeps one that is only less certain.
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct QualityConfig {
            $($(#[$threshold_doc])* pub $threshold: f64,)*
            $($(#[$policy_doc])* pub $policy: Policy,)*
        }

        impl Default for QualityConfig {
            fn default() -> Self {
                Self { $($threshold: $value,)* $($policy: Policy::$default,)* }
            }
        }

        impl QualityConfig {
            /// The default thresholds with every policy [`Policy::Keep`]: shows the values that flags would drop.
            pub fn keeping() -> Self {
                Self { $($policy: Policy::Keep,)* ..Self::default() }
            }

            /// Checks every threshold against its bound.
            ///
            /// # Errors
            /// [`Error::OutOfBounds`] with the key, its value and the bound that it breaks.
            pub fn validate(&self) -> Result<(), Error> {
                $({
                    let is_good: fn(f64, &Self) -> bool = $is_good;
                    let (key, value, bound) = (stringify!($threshold), self.$threshold, $bound);
                    if !(value.is_finite() && is_good(value, self)) {
                        return Err(Error::OutOfBounds { table: "process.quality", key, value, unit: "", bound });
                    }
                })*
                Ok(())
            }

            /// Each flag with its policy, and the discriminators that show whether the policy has dropped something.
            fn policies(&self) -> impl Iterator<Item = (Quality, Policy, &'static [Discriminator])> {
                use Discriminator::{A2, FMax, Pr};
                [$($((Quality::$flag, self.$policy, &$discriminators as &[_])),+),*].into_iter()
            }
        }
    };
}

quality_config! {
    thresholds {
        /// Mass of the impactor, which distinguishes a second hit from the layer over a crack swinging back. 0 if it, or the
        /// scale of the force, is not known: then every second pulse is a second hit.
        impactor_mass_kg = 0.0045, "not below 0": |x, _| x >= 0.0;
        /// Largest second pulse of one hit, as a ratio to F_max.
        double_hit_ratio_max = 0.02, "above 0": |x, _| x > 0.0;
        /// Largest deviation of a single sample of the pulse from those beside it, as a ratio to F_max.
        spike_ratio_max = 0.03, "above 0": |x, _| x > 0.0;
        /// Smallest impulse of an impact, 2/pi F_max tau, as a ratio to mass times velocity of the impactor. It is 1 + e, and a fifth
        /// more for the shape of the pulse, e being the restitution.
        impulse_ratio_min = 1.1, "not below 0": |x, _| x >= 0.0;
        /// Largest impulse of an impact, likewise.
        impulse_ratio_max = 2.6, "above impulse_ratio_min": |x, all| x > all.impulse_ratio_min;
        /// Shortest contact time of a casing.
        tau_min_s = 0.35e-3, "not below 0": |x, _| x >= 0.0;
        /// Longest contact time of a casing.
        tau_max_s = 4e-3, "above tau_min_s": |x, all| x > all.tau_min_s;
        /// Smallest ratio of a channel's peak to the standard deviation of its noise.
        snr_min = 50.0, "not below 0": |x, _| x >= 0.0;
        /// Largest amplitude of hum, as a ratio to the peak of its channel.
        hum_ratio_max = 0.02, "above 0": |x, _| x > 0.0;
        /// Largest rise of the sound's envelope that is not another tap, as a ratio to the sound's peak.
        neighbour_ratio_max = 0.1, "above 0": |x, _| x > 0.0;
        /// Largest difference between measured and planned velocity, as a ratio to the planned one.
        velocity_error_max = 0.03, "not below 0": |x, _| x >= 0.0;
        /// Shortest record, as a ratio to the planned one: the sound's powers are averages over the record.
        record_ratio_min = 0.98, "from 0 to 1": |x, _| (0.0..=1.0).contains(&x);
        /// Longest time from when the force says that the sound begins until it is heard.
        sound_delay_max_s = 0.45e-3, "above 0": |x, _| x > 0.0;
    }
    policies {
        /// A clipped force affects F_max and tau, and with them A_1 and A_2.
        clipped_force = Retake, CLIPPED drops [FMax];
        /// A clipped sound affects the six discriminators of the sound; kept, because the power ratio still separated cracked from sound slabs.
        clipped_sound = Keep, CLIPPED drops [Pr];
        /// A late trigger affects F_max, tau, A_1 and A_2, and the powers if the record begins within the pulse.
        late_trigger = Retake, LATE_TRIGGER drops [FMax, A2];
        /// A second hit affects every discriminator: which hit a value belongs to is not known.
        double_hit = Retake, DOUBLE_HIT drops [FMax];
        /// Too few samples of the pulse affect F_max, tau, A_1 and A_2; too low a rate for the bands affects those of the spectrum.
        undersampled = Drop, UNDERSAMPLED drops [FMax, Pr];
        /// Hum affects the discriminators of its channel.
        hum = Keep, HUM drops [FMax, Pr];
        /// Noise affects the discriminators of its channel.
        low_snr = Keep, LOW_SNR drops [FMax, Pr];
        /// Another station's tap affects A_2 and the powers, and A_1 too if it came first.
        neighbour = RetakeOrKeep, NEIGHBOUR drops [Pr];
        /// A velocity that is off affects every discriminator that depends on it: all but PR.
        velocity_off = Keep, VELOCITY_OFF drops [FMax, A2];
        /// A record that is cut affects A_2 and the powers.
        cut = Retake, CUT drops [Pr];
        /// A dropout affects the discriminators of its channel.
        dropout = Retake, DROPOUT drops [FMax, Pr];
        /// Swapped channels affect every discriminator.
        swapped = Retake, SWAPPED drops [Pr];
        /// A sound that does not belong to the force's clock affects the areas.
        sound_late = Retake, SOUND_LATE drops [A2];
        /// A spike affects F_max and tau, and with them A_1 and A_2.
        spike = Retake, SPIKE drops [FMax];
        /// A wrong sample rate affects all but F_max.
        rate_implausible = Keep, RATE_IMPLAUSIBLE drops [Pr];
        /// No pulse, no onset or a sample that is not a number: the discriminators that need it are absent under any policy.
        no_signal = Retake, NON_FINITE drops Discriminator::ALL, NO_PULSE drops [FMax], NO_ONSET drops [A2];
    }
}

impl QualityConfig {
    /// Whether the tap that gave `found` is to be taken again: one of its flags has the policy [`Policy::RetakeOrKeep`], or
    /// has [`Policy::Retake`] and has dropped a discriminator. A trigger that is late only by its mark, for example, drops nothing.
    pub fn wants_retake(&self, found: &Discriminators) -> bool {
        self.policies().any(|(flag, policy, discriminators)| {
            let has_dropped = || discriminators.iter().any(|&which| found.values.get(which).is_none());
            let is_wanted = policy == Policy::RetakeOrKeep || (policy == Policy::Retake && has_dropped());
            is_wanted && found.quality.contains(flag)
        })
    }
}

/// The discriminators of the sound.
pub(crate) static OF_SOUND: LazyLock<Vec<Discriminator>> = LazyLock::new(|| all_with(|of| of != RecordPart::Pulse));
/// The powers: the discriminators of the spectrum of the sound.
pub(crate) static OF_SPECTRUM: LazyLock<Vec<Discriminator>> =
    LazyLock::new(|| all_with(|of| of == RecordPart::SoundSpectrum));

fn all_with(is_wanted: impl Fn(RecordPart) -> bool) -> Vec<Discriminator> {
    Discriminator::ALL.into_iter().filter(|which| is_wanted(which.part())).collect()
}

/// Smallest [`balance`] of a channel that rings, and greatest of a pulse.
const RINGING_BALANCE: f64 = 0.05;
const PULSE_BALANCE: f64 = 0.1;
/// Factor by which the balance of a ringing exceeds that of the pulse beside it.
const BALANCE_RATIO: f64 = 2.0;

/// How evenly a channel swings around `base`: 0 for a pulse to one side, 1 for equal ways to both.
pub(crate) fn balance<C: Count>(extent: Extent<C>, base: f64) -> f64 {
    let (above, below) = (extent.largest.into() - base, base - extent.least.into());
    if above > below { below / above } else { above / below }
}

/// Whether force and sound look swapped, by their balances: a force is a pulse to one side, and a sound swings to both.
pub(crate) fn are_swapped(of_force: f64, of_sound: f64) -> bool {
    of_sound < PULSE_BALANCE && of_force > RINGING_BALANCE && of_force > BALANCE_RATIO * of_sound
}

/// Checks the length of a record: `used` samples of it are looked at, and of a whole one `planned` would be; 0 if that is not known.
pub(crate) fn check_length(used: u32, planned: u32, config: &QualityConfig) -> QualityReport {
    let mut report = QualityReport::default();
    if f64::from(used) < config.record_ratio_min * f64::from(planned) {
        report.raise(Quality::CUT, config.cut, &[Discriminator::A2]);
        report.raise(Quality::CUT, config.cut, &OF_SPECTRUM);
    }
    report
}

/// Checks the velocity; no flag is raised if the measured or the planned one is not known.
pub(crate) fn check_velocity(header: &TapHeader, config: &QualityConfig) -> QualityReport {
    let mut report = QualityReport::default();
    let planned = Some(header.velocity_nominal_m_per_s).filter(|&v| v > 0.0);
    let error = planned.map_or(0.0, |v| (header.velocity_measured_m_per_s / v - 1.0).abs());
    if error > config.velocity_error_max {
        let all_but_pr = Discriminator::ALL.into_iter().filter(|&which| which != Discriminator::Pr);
        report.raise(Quality::VELOCITY_OFF, config.velocity_off, &all_but_pr.collect::<Vec<_>>());
    }
    report
}

/// Velocity of the impact in m/s: the measured one, or the planned one if that is not known.
pub(crate) fn velocity_m_per_s(header: &TapHeader) -> Option<f64> {
    let measured = Some(header.velocity_measured_m_per_s).filter(|&v| v > 0.0 && v.is_finite());
    measured.or_else(|| header.id.velocity_m_per_s().filter(|&v| v > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a default that fails its own checks, and a key that is not read or not checked.
    #[test]
    fn thresholds_are_read_and_checked() {
        assert_eq!(QualityConfig::default().validate(), Ok(()));
        let config: QualityConfig = toml::from_str("double_hit = \"keep\"\nsnr_min = 10.0").unwrap();
        assert_eq!((config.double_hit, config.snr_min), (Policy::Keep, 10.0));
        assert!(toml::from_str::<QualityConfig>("duble_hit = \"keep\"").is_err());
        assert!(toml::from_str::<QualityConfig>("double_hit = \"refuse\"").is_err());
        let config: QualityConfig = toml::from_str("hum = \"retake\"").unwrap();
        assert_eq!((config.hum, config.double_hit), (Policy::Retake, Policy::Retake));
        let bad = QualityConfig { tau_max_s: 1e-4, ..QualityConfig::default() };
        let message = bad.validate().unwrap_err().to_string();
        assert_eq!(message, "process.quality.tau_max_s = 0.0001: must be finite and above tau_min_s");
        assert!(QualityConfig { hum_ratio_max: f64::NAN, ..QualityConfig::default() }.validate().is_err());
    }

    /// Catches a flag raised although the velocity was not measured or not planned, and a comparison in one direction
    /// only.
    #[test]
    fn velocity_off_needs_both_velocities() {
        let is_off = |meant, measured| {
            let header = TapHeader {
                velocity_nominal_m_per_s: meant,
                velocity_measured_m_per_s: measured,
                ..TapHeader::default()
            };
            !check_velocity(&header, &QualityConfig::default()).flags().is_empty()
        };
        assert!(is_off(1.85, 1.95) && is_off(1.85, 1.75) && is_off(1.85, 0.0));
        assert!(!is_off(1.85, 1.83) && !is_off(1.85, f64::NAN) && !is_off(f64::NAN, 1.2) && !is_off(0.0, 1.2));
    }

    /// Catches a retake against the policy, a missing retake, and a retake for a flag that has dropped nothing.
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
        assert!(
            config.wants_retake(&found(Quality::NEIGHBOUR, &[])),
            "retake_or_keep drops nothing, and still retakes"
        );
        let hum = QualityConfig { hum: Policy::Retake, ..config };
        assert!(hum.wants_retake(&found(Quality::HUM, &[Discriminator::Pr])));
    }
}
