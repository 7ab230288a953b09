//! The flags of taps and of verdicts: one row per flag, with its bit, its name, and its meaning in words.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

/// Defines a set of flags. A row is the constant, its bit on the wire and in archives, its name in tables, and its meaning.
macro_rules! flags {
    ($(#[$doc:meta])* $set:ident { $($flag:ident = $bit:literal, $name:literal: $meaning:literal;)* }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, ZeroCopySend)]
        pub struct $set(u32);

        bitflags::bitflags! {
            impl $set: u32 {
                $(#[doc = $meaning] const $flag = 1 << $bit;)*
            }
        }

        impl $set {
            /// Every flag with its name, in the order of the bits.
            pub const ALL: &'static [(Self, &'static str)] = &[$((Self::$flag, $name),)*];

            /// The flags with these names, joined by `|`; unknown names are ignored.
            pub fn named(names: &str) -> Self {
                let named = Self::ALL.iter().filter(|(_, name)| names.split('|').any(|given| given == *name));
                named.fold(Self::default(), |all, &(flag, _)| all | flag)
            }

            /// The meanings of the flags that are set, as pages print them.
            pub fn meaning(self) -> String {
                let meanings = [$((Self::$flag, $meaning),)*].into_iter().filter(|&(flag, _)| self.contains(flag));
                meanings.map(|(_, meaning)| meaning).collect::<Vec<_>>().join(" ")
            }
        }

        impl fmt::Display for $set {
            /// The names of the flags that are set, joined by `|`.
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let set = Self::ALL.iter().filter(|(flag, _)| self.contains(*flag));
                f.write_str(&set.map(|(_, name)| *name).collect::<Vec<_>>().join("|"))
            }
        }

        impl fmt::Debug for $set {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({self})", stringify!($set))
            }
        }
    };
}

flags! {
    /// What is wrong with a tap: why discriminators may be absent or doubtful.
    Quality {
        REFUSED = 0, "refused": "refused before it was analysed";
        NON_FINITE = 1, "non_finite": "a sample is not a number";
        NO_FORCE = 2, "no_force": "no force channel, or a constant one";
        NO_SOUND = 3, "no_sound": "no sound channel, or a constant one";
        NO_BASELINE = 4, "no_baseline": "too few samples before the trigger";
        NO_PULSE = 5, "no_pulse": "no pulse stands out in the force";
        NO_ONSET = 6, "no_onset": "no onset stands out in the sound";
        NO_BAND = 7, "no_band": "the bands contain nothing of this record";
        RETAKE = 8, "retake": "set aside and asked for again";
        CLIPPED = 9, "clipped": "a channel reached the end of its range";
        LATE_TRIGGER = 10, "late_trigger": "the trigger came too late";
        DOUBLE_HIT = 11, "double_hit": "the impactor hit twice";
        UNDERSAMPLED = 12, "undersampled": "too few samples for the pulse or the bands";
        HUM = 13, "hum": "mains hum in the sound or the force";
        LOW_SNR = 14, "low_snr": "too little above the noise";
        NEIGHBOUR = 15, "neighbour": "another tap is heard in the record";
        VELOCITY_OFF = 16, "velocity_off": "struck at a velocity other than intended";
        RATE_IMPLAUSIBLE = 17, "rate_implausible": "a contact time or an impulse that no casing has";
        CUT = 18, "cut": "the record is shorter than planned";
        DROPOUT = 19, "dropout": "a channel with noise stays at one value";
        SWAPPED = 20, "swapped": "the channels look swapped";
        SOUND_LATE = 21, "sound_late": "the sound begins later than the force says";
        SPIKE = 22, "spike": "single samples stand out from the pulse";
    }
}

flags! {
    /// Why a verdict is not PASS, or how it was reached.
    Reasons {
        DAMAGE = 0, "damage": "The strongest arc of at least one region reaches the reject limit.";
        SUSPECT = 1, "suspect":
            "The strongest arc of at least one region lies between the re-inspect limit and the reject limit.";
        NOT_ENDED = 2, "not_ended": "The scan did not end: the results cover only the taps so far.";
        TAPS_REFUSED = 3, "taps_refused": "Planned taps were never made, or have no usable record.";
        TAPS_MISSING = 4, "taps_missing": "Planned taps are missing without a reason.";
        LOCATION_BLIND = 5, "location_blind":
            "At least one location has no usable value, or part of the ring was not tapped: damage there would not show.";
        NO_INDEX = 6, "no_index":
            "The damage index could not be formed: no usable discriminator or reference, or too few locations for limits.";
        SELF_REFERENCE = 7, "self_reference":
            "Compared with itself, not with a casing known to be sound: damage all round would not show.";
        DISCRIMINATORS_ABSENT = 8, "discriminators_absent":
            "A discriminator that the index needs is absent, or always the same, at most taps or at a location.";
        NO_SOUND_MAJORITY = 9, "no_sound_majority":
            "More than half of the locations are suspect: another kind of casing than the reference, or damage all round.";
        LEVEL_OFF = 10, "level_off":
            "The whole shoulder differs from the other side or the reference: other construction, a changed sensor, or damage all round.";
        CONDITION_UNKNOWN = 11, "condition_unknown":
            "The reference has no tap at an offset and velocity that was scanned: taps there are not judged.";
        EXTRAPOLATED = 12, "extrapolated":
            "The stated rates of false calls are lower than so few reference casings allow: they rest on an assumed distribution.";
        FORCE_OFF = 13, "force_off":
            "The force of part of the scan is off, and no crack or velocity explains it: the gain of its sensor changed.";
        VELOCITY_UNKNOWN = 14, "velocity_unknown":
            "No impact velocity was measured: a wrong one would not show.";
        NOT_CALIBRATED = 15, "not_calibrated":
            "There is no calibration of a channel: a changed sensor would not show.";
        CALIBRATION_OUT_OF_DATE = 16, "calibration_out_of_date":
            "The calibration of a channel is not known to be valid on the day of the taps: it is of a later day, expired, or that day is unknown.";
        CALIBRATION_REQUIRED = 17, "calibration_required":
            "This line does not pass casings without a valid calibration.";
        FLAGGED = 18, "flagged":
            "More than half of the taps have the same flag: its warning holds for the whole shoulder.";
        REFERENCE_INCOMPLETE = 19, "reference_incomplete":
            "A discriminator is absent from a shoulder that this one is compared with: that one has discriminators_absent.";
        LEVEL_UNKNOWN = 20, "level_unknown":
            "How the levels of sound shoulders differ is not known: the reference has too few casings, or a discriminator is absent. Damage all round would not show.";
        NOT_COMPARABLE = 21, "not_comparable":
            "The reference was tapped at other places, or recorded or analysed differently: this casing could not be compared with it.";
        ONE_SHOULDER = 22, "one_shoulder":
            "Only one shoulder of the casing was tapped: damage in another one would not show.";
        SCATTER_OFF = 23, "scatter_off":
            "Its locations differ from one another more than those of the reference: more noise, or another kind of casing.";
        SHOULDER_MISSING = 24, "shoulder_missing":
            "Only one shoulder of the casing was tapped, and most casings of the reference have two: damage in the other would not show.";
        REPEATED = 25, "repeated":
            "Two taps of the casing have the same values to the last digit: one recording is there twice, and another one lacks.";
        SCATTER_LOW = 26, "scatter_low":
            "Its locations differ from one another far less than those of the reference: the casing may not have turned, or is more even.";
    }
}

impl Reasons {
    /// Those that say how a verdict was reached but require nothing: PASS stays PASS.
    pub const REMARKS: Self = Self::SELF_REFERENCE
        .union(Self::EXTRAPOLATED)
        .union(Self::VELOCITY_UNKNOWN)
        .union(Self::NOT_CALIBRATED)
        .union(Self::CALIBRATION_OUT_OF_DATE)
        .union(Self::FLAGGED)
        .union(Self::LEVEL_UNKNOWN)
        .union(Self::ONE_SHOULDER);
}

impl Quality {
    /// The flags on more than half of the taps with these `qualities`, each with its share; refused taps do not count.
    pub fn on_most(qualities: impl IntoIterator<Item = Self>) -> Vec<(Self, f64)> {
        let qualities: Vec<Self> = qualities.into_iter().filter(|of| !of.contains(Self::REFUSED)).collect();
        let share = |flag: Self| {
            let flagged = qualities.iter().filter(|of| of.contains(flag)).count();
            (flag, flagged as f64 / qualities.len().max(1) as f64)
        };
        Self::ALL.iter().map(|&(flag, _)| share(flag)).filter(|&(_, share)| share > 0.5).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Archives hold the numbers and tables the names: neither may change.
    #[test]
    fn numbers_and_names_are_kept() {
        let quality = Quality::NO_FORCE | Quality::NON_FINITE;
        assert_eq!((quality.bits(), quality.to_string().as_str()), (6, "non_finite|no_force"));
        assert_eq!((Quality::NO_BAND.bits(), Quality::default().to_string().as_str()), (128, ""));
        assert_eq!((Quality::CLIPPED.bits(), Quality::RATE_IMPLAUSIBLE.bits()), (1 << 9, 1 << 17));
        let reasons = Reasons::from_bits_retain(1 | 128);
        assert_eq!(format!("{reasons:?}"), "Reasons(damage|self_reference)");
        assert_eq!(Reasons::EXTRAPOLATED.bits(), 1 << 12);
        assert_eq!((Reasons::named(&reasons.to_string()), Reasons::named("")), (reasons, Reasons::default()));
    }

    /// Catches two flags of one bit, a bit left out, a flag without a meaning, and a set that shows only one meaning.
    #[test]
    fn each_flag_has_a_bit_and_a_meaning_of_its_own() {
        let quality: Vec<_> = Quality::ALL.iter().map(|(flag, _)| (flag.bits(), flag.meaning())).collect();
        let reasons: Vec<_> = Reasons::ALL.iter().map(|(flag, _)| (flag.bits(), flag.meaning())).collect();
        for flags in [quality, reasons] {
            for (k, (bits, meaning)) in flags.iter().enumerate() {
                assert_eq!(*bits, 1 << k, "{meaning}");
                assert!(!meaning.is_empty() && flags[..k].iter().all(|(_, other)| other != meaning), "{meaning}");
            }
        }
        let both = Reasons::DAMAGE | Reasons::TAPS_MISSING;
        assert_eq!(both.meaning(), format!("{} {}", Reasons::DAMAGE.meaning(), Reasons::TAPS_MISSING.meaning()));
    }
}
