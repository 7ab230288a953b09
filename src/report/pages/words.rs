//! The words of the pages: verdicts, reasons, flags and quantities, in the words of the shop floor.

use tapline_wire::{Geometry, Quality, Reasons, Verdict};

/// What is scanned at once.
pub(crate) fn side(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => "shoulder",
        Geometry::Line => "line",
    }
}

/// What carries the serial number.
pub(crate) fn body(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => "Tyre",
        Geometry::Line => "Piece",
    }
}

/// What a verdict means, in a sentence.
pub(crate) fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "No damage was found, and every planned tap was there to find it.",
        Verdict::ReInspect => "Something is doubtful or missing: a person must look, or the scan must be repeated.",
        Verdict::Reject => "Damage was found. Mark the regions below.",
    }
}

/// Each reason in a sentence.
pub(crate) fn reasons(reasons: Reasons) -> Vec<&'static str> {
    let known = Reasons::ALL.iter().filter(|(flag, _)| reasons.contains(*flag));
    known.map(|&(flag, name)| reason(flag).unwrap_or(name)).collect()
}

fn reason(flag: Reasons) -> Option<&'static str> {
    let sentences = [
        (Reasons::DAMAGE, "The damage index of a region exceeds the reject limit."),
        (Reasons::SUSPECT, "The damage index of a region exceeds the re-inspect limit, but not the reject limit."),
        (Reasons::NOT_ENDED, "The scan did not end: what is shown is what there was by then."),
        (Reasons::TAPS_REFUSED, "Taps were refused: their records could not be used."),
        (Reasons::TAPS_MISSING, "Planned taps are missing without a reason."),
        (
            Reasons::LOCATION_BLIND,
            "At least one location has no usable value, or a part of the ring was not tapped: damage there would not show.",
        ),
        (
            Reasons::CONDITION_UNKNOWN,
            "The reference has no tap at an offset and velocity that was scanned: what was tapped there is not judged.",
        ),
        (Reasons::NO_INDEX, "The damage index could not be formed: no usable discriminator, or no usable reference."),
        (
            Reasons::SELF_REFERENCE,
            "Compared with itself, not with a casing known to be sound: damage all around would not show.",
        ),
        (
            Reasons::FEATURES_ABSENT,
            "A discriminator that the index asks for is absent, or always the same, at most taps or at a location.",
        ),
        (
            Reasons::NO_SOUND_MAJORITY,
            "More than half of the locations are suspect: another kind of casing than the reference, or damage all around.",
        ),
        (
            Reasons::LEVEL_OFF,
            "The whole shoulder differs from the other side or from the reference: another construction, a changed sensor, or damage all around.",
        ),
        (
            Reasons::FELL_BACK,
            "The index that was asked for could not be learned from the reference: the mean of robust z stands in its place.",
        ),
    ];
    sentences.into_iter().find(|&(known, _)| known == flag).map(|(_, sentence)| sentence)
}

/// What the flag called `name` means for a tap; the name itself where nothing is known of it.
pub(crate) fn flag(name: &'static str) -> &'static str {
    let sentences = [
        (Quality::REFUSED, "refused before it was looked at"),
        (Quality::NON_FINITE, "a sample is not a number"),
        (Quality::NO_FORCE, "no force channel, or a constant one"),
        (Quality::NO_SOUND, "no sound channel, or a constant one"),
        (Quality::NO_BASELINE, "too few samples before the trigger"),
        (Quality::NO_PULSE, "no pulse stands out of the force"),
        (Quality::NO_ONSET, "no onset stands out of the sound"),
        (Quality::NO_BAND, "the bands hold nothing of this record"),
        (Quality::RETAKE, "set aside and asked for again"),
        (Quality::CLIPPED, "a channel ran into the end of its range"),
        (Quality::LATE_TRIGGER, "the trigger came too late"),
        (Quality::DOUBLE_HIT, "the impactor hit twice"),
        (Quality::UNDERSAMPLED, "too few samples for the pulse or the bands"),
        (Quality::HUM, "mains hum in the sound"),
        (Quality::LOW_SNR, "not far enough out of the noise"),
        (Quality::NEIGHBOUR, "another tap is heard in the record"),
        (Quality::VELOCITY_OFF, "struck at another velocity than was meant"),
        (Quality::RATE_IMPLAUSIBLE, "a contact time that no casing has"),
    ];
    let known = Quality::ALL.iter().find(|(_, known)| *known == name).map(|(flag, _)| *flag);
    sentences.into_iter().find(|&(flag, _)| Some(flag) == known).map_or(name, |(_, sentence)| sentence)
}

/// `count` things called `one`, or `more` of them.
pub(crate) fn counted(count: usize, one: &str, more: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { more })
}

/// The moment `ns` after the Unix epoch, to the second.
pub(crate) fn moment(ns: i64) -> String {
    let seconds = ns.div_euclid(1_000_000_000);
    let known = jiff::Timestamp::from_second(seconds).ok();
    known.map_or_else(|| "unknown".to_owned(), |moment| moment.strftime("%Y-%m-%d %H:%M:%S UTC").to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a new reason or flag that a page would name in the program's own word.
    #[test]
    fn everything_has_words() {
        for &(flag, name) in Reasons::ALL {
            assert!(reason(flag).is_some(), "{name}");
        }
        for &(_, name) in Quality::ALL {
            assert_ne!(flag(name), name);
        }
    }

    /// Catches a moment that is off by a time zone or by its fraction.
    #[test]
    fn moments_are_utc() {
        assert_eq!(moment(1_767_225_600_000_000_000), "2026-01-01 00:00:00 UTC");
        assert_eq!(moment(-1), "1969-12-31 23:59:59 UTC");
    }
}
