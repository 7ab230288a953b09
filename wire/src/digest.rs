//! Numbers that tell plans, and parts of them, from others.

use std::fmt::Write as _;

use rustc_hash::FxHashMap;
use sha2::{Digest, Sha256};

use crate::{Geometry, PlannedTap, Recording, TapId};

/// The first 64 bits of the SHA-256 of `parts`, each with its length: a number that differs for different input.
pub fn digest_of_parts<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> u64 {
    let mut hasher = Sha256::new();
    for part in parts {
        hasher.update((part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    first_bits(hasher)
}

/// What tells one plan from another.
pub(crate) fn digest_of(geometry: Geometry, recording: &Recording, taps: &[PlannedTap], source_digest: u64) -> u64 {
    let mut hasher = Sha256::new();
    hasher.update(format!("{geometry:?} {recording:?} {source_digest}"));
    let mut spelt = Spelt::default();
    for tap in taps {
        hasher.update(spelt.line(tap));
    }
    first_bits(hasher)
}

/// A line of text for every tap, as the digest has it: `\n{id} {angle:?} {is_closing}`.
///
/// To spell numbers would be a quarter of what opening an archive takes, and neighbours in a plan have most of them in common:
/// what stands before and behind a tap's location is kept from the tap before, and the angles of a ring come again and again.
#[derive(Default)]
struct Spelt {
    /// The tap before, at location 0.
    nowhere: Option<TapId>,
    /// Its name, in which the location lies at `at`.
    name: String,
    at: usize,
    angles: FxHashMap<Option<u64>, String>,
    line: String,
}

impl Spelt {
    fn line(&mut self, tap: &PlannedTap) -> &str {
        const LOCATION: &str = "location ";
        let Self { nowhere, name, at, angles, line } = self;
        let mut id = tap.id;
        id.location = 0;
        // Texts take all that is written to them.
        if *nowhere != Some(id) {
            name.clear();
            let is_spelt = write!(name, "{id}").is_ok();
            // A serial number may hold any text, so that the last place counts.
            *at = name.rfind(LOCATION).map_or(0, |place| place + LOCATION.len());
            *nowhere = is_spelt.then_some(id);
        }
        let (before, behind) = (&name[..*at], &name[*at + 1..]);
        let angle = angles.entry(tap.angle_deg.map(f64::to_bits)).or_insert_with(|| format!("{:?}", tap.angle_deg));
        line.clear();
        if write!(line, "\n{before}{}{behind} {angle} {}", tap.id.location, tap.is_closing).is_err() {
            line.clear();
        }
        line
    }
}

fn first_bits(hasher: Sha256) -> u64 {
    hasher.finalize().iter().take(8).fold(0, |number, &byte| (number << 8) | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Serial;

    /// Catches a text kept for another tap: the twin spells each by itself.
    #[test]
    fn lines_like_one_by_one() {
        let mut taps = Vec::new();
        for tyre in ["A", "location 7", "location "] {
            for (shoulder, offset_mm, velocity) in [(1, None, None), (1, Some(7.5), Some(1.85)), (2, Some(7.5), None)] {
                for (repetition, location) in
                    (0..2).flat_map(|k| [0, 7, 99, 100, u32::MAX].map(|location| (k, location)))
                {
                    let id = TapId::new(3, Serial::new(tyre).unwrap(), shoulder, location);
                    let mut id = id.with_offset_mm(offset_mm).unwrap().with_velocity_m_per_s(velocity).unwrap();
                    id.repetition = repetition;
                    let angle_deg = (location % 2 == 0).then_some(f64::from(location) * 3.6);
                    taps.push(PlannedTap { id, angle_deg, is_closing: location == 100 });
                }
            }
        }
        let mut spelt = Spelt::default();
        for tap in &taps {
            assert_eq!(spelt.line(tap), format!("\n{} {:?} {}", tap.id, tap.angle_deg, tap.is_closing));
        }
    }

    /// Catches another text than the digests of archives that are there were taken of.
    #[test]
    fn a_line_as_it_ever_was() {
        let id = TapId::new(3, Serial::new("A").unwrap(), 1, 99);
        let id = id.with_offset_mm(Some(7.5)).unwrap().with_velocity_m_per_s(Some(1.85)).unwrap();
        let tap = PlannedTap { id, angle_deg: Some(356.4), is_closing: false };
        let expected =
            "\nstation 3 tyre A shoulder 1 location 99 x 7.5 mm 1.85 m/s repetition 0 attempt 0 Some(356.4) false";
        assert_eq!(Spelt::default().line(&tap), expected);
    }
}
