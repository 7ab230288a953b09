//! Words for verdicts, reasons and what was tapped on the pages, as the shop floor uses them.

use jiff::Timestamp;
use jiff::tz::TimeZone;
use tapline_wire::{Geometry, Reasons, Verdict};

/// What the limits apply to, for the captions of curves of the index.
pub(crate) const LIMITS: &str = "The dotted lines are the limits for the strongest arc: black to reject, orange to re-inspect. The index combines a \
     location with its two neighbours, so a longer arc may reach a limit that no location reaches.";

/// What one scan covers.
pub(crate) fn side(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => "shoulder",
        Geometry::Line => "line",
    }
}

/// What has the serial number.
pub(crate) fn body(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => "Tyre",
        Geometry::Line => "Piece",
    }
}

/// The same of several.
pub(crate) fn bodies(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => "tyres",
        Geometry::Line => "pieces",
    }
}

/// What `reasons` mean, in words that suit what was tapped.
pub(crate) fn reasons(geometry: Geometry, reasons: Reasons) -> String {
    let meaning = reasons.meaning();
    match geometry {
        Geometry::Ring => meaning,
        // Slabs have lines, and no way round.
        Geometry::Line => meaning
            .replace("casings", "pieces")
            .replace("casing", "piece")
            .replace("a part of the ring", "a part of the line")
            .replace("all round", "everywhere")
            .replace("sound shoulders", "sound lines"),
    }
}

/// What a verdict means, in a sentence.
pub(crate) fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "No damage was found, and every planned tap was available.",
        Verdict::ReInspect => "Something is doubtful or missing: a person must look, or the scan must be repeated.",
        Verdict::Reject => "Damage was found. Mark the regions below.",
    }
}

/// The local time `ns` after the Unix epoch, to the second, with its offset: of a file from elsewhere, or in the night in which clocks are set
/// back, the time alone says too little.
pub(crate) fn moment(ns: i64) -> String {
    moment_in(ns, TimeZone::system())
}

fn moment_in(ns: i64, zone: TimeZone) -> String {
    let known = Timestamp::from_second(ns.div_euclid(1_000_000_000)).map(|time| time.to_zoned(zone));
    known.map_or_else(|_| "unknown".to_owned(), |time| time.strftime("%Y-%m-%d %H:%M:%S %:z").to_string())
}

#[cfg(test)]
mod tests {
    use jiff::tz::offset;

    use super::*;

    /// Catches a time that is off by a time zone or by its fraction.
    #[test]
    fn moments_have_their_offset() {
        let [west, utc] = [-5, 0].map(|hours| TimeZone::fixed(offset(hours)));
        assert_eq!(moment_in(1_767_225_600_000_000_000, west), "2025-12-31 19:00:00 -05:00");
        assert_eq!(moment_in(-1, utc), "1969-12-31 23:59:59 +00:00");
    }
}
