//! How much a line has room for.

use serde::{Deserialize, Serialize};

use crate::Plan;

/// How large a casing is, or the largest of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CasingLimits {
    /// Taps, with those that may be added while it is open.
    pub taps: usize,
    /// Taps that may be added while it is open.
    pub room: usize,
    /// Scans: its shoulders, or the lines of a slab.
    pub scans: usize,
    /// Locations of the largest scan.
    pub locations: usize,
    /// Locations of which it is known whether they are cracked.
    pub known_locations: usize,
    /// Bytes of the longest record's samples.
    pub record_bytes: usize,
}

impl CasingLimits {
    /// What the casing with this `plan` needs.
    pub fn from_plan(plan: &Plan) -> Self {
        Self {
            taps: plan.taps().len(),
            room: plan.added().len(),
            scans: plan.scans().len(),
            locations: plan.scans().iter().map(|scan| scan.locations.len()).max().unwrap_or(0),
            known_locations: plan.truth().len(),
            record_bytes: plan.recording.payload_bytes_max(),
        }
    }

    /// Limits that are enough for both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            taps: self.taps.max(other.taps),
            room: self.room.max(other.room),
            scans: self.scans.max(other.scans),
            locations: self.locations.max(other.locations),
            known_locations: self.known_locations.max(other.known_locations),
            record_bytes: self.record_bytes.max(other.record_bytes),
        }
    }

    /// In what `plan`, to which `room` taps may be added, exceeds these limits, with both numbers and the key that sets the limit for
    /// a tap set; `None` where it fits.
    pub fn exceeded_by(&self, plan: &Plan, room: usize) -> Option<String> {
        let need = Self::from_plan(plan);
        [
            ("taps", need.taps + room, self.taps, "taps_max"),
            ("taps that may be added", room, self.room, "taps_max"),
            ("scans", need.scans, self.scans, "scans_max"),
            ("locations per scan", need.locations, self.locations, "taps_max"),
            ("locations in truth.csv", need.known_locations, self.known_locations, "taps_max"),
            ("bytes per record", need.record_bytes, self.record_bytes, "record_samples_max, 4 bytes each"),
        ]
        .into_iter()
        .find(|&(_, need, most, _)| need > most)
        .map(|(what, need, most, key)| format!("it has {need} {what}; this line has room for {most} ([line] {key})"))
    }
}

/// What a line has room for: the sizes of its topics follow from it, so all its processes must agree on it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// `acquire` processes, each for several stations.
    pub acquire_count: u16,
    /// The stations, ascending.
    pub stations: Vec<u16>,
    /// The largest casing.
    pub casing: CasingLimits,
}

impl Default for Limits {
    /// One station; two shoulders of 100 locations, four offsets, three velocities, two repetitions; records of two channels of
    /// 2048 samples of 16 bits.
    fn default() -> Self {
        let casing = CasingLimits {
            taps: 2 * 4 * 3 * 2 * 101,
            room: 0,
            scans: 2,
            locations: 100,
            known_locations: 200,
            record_bytes: 2 * 2048 * 2,
        };
        Self { acquire_count: 1, stations: vec![1], casing }
    }
}

impl Limits {
    /// Number of the `acquire` process that serves `station`, as they take turns; `None` for a station not on the line.
    pub fn acquire_of(&self, station: u16) -> Option<u16> {
        let place = self.stations.iter().position(|&known| known == station)?;
        u16::try_from(place % usize::from(self.acquire_count.max(1))).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::parts::recording;
    use crate::{Geometry, PlannedTap, Purpose, Recording, Serial, TapId};

    /// Catches a station that two processes serve, or none.
    #[test]
    fn every_station_has_one_process() {
        let limits = Limits { acquire_count: 3, stations: vec![2, 4, 5, 7, 30], ..Limits::default() };
        let served = limits.stations.iter().map(|&station| limits.acquire_of(station).unwrap());
        assert_eq!(served.collect::<Vec<_>>(), [0, 1, 2, 0, 1]);
        assert_eq!(limits.acquire_of(3), None);
    }

    /// Catches a line without room for what is known of locations that are not tapped, or for taps that are added.
    #[test]
    fn a_casing_needs_room_for_what_is_known_of_it() {
        let tyre = Serial::new("A").unwrap();
        let id = |location| TapId::new(0, tyre, 1, location);
        let tap = |location| PlannedTap { id: id(location), angle_deg: None, purpose: Purpose::Scan };
        let truth = (0..9).map(|location| ((tyre, 1, location), false)).collect();
        let recording = Recording { sample_count_max: 100, ..recording() };
        let plan = Plan::new(Geometry::Line, recording, vec![tap(2), tap(5)], truth).unwrap();
        let need = CasingLimits::from_plan(&plan);
        let expected = CasingLimits { taps: 2, room: 0, scans: 1, locations: 2, known_locations: 9, record_bytes: 400 };
        assert_eq!(need, expected);
        assert_eq!(need.exceeded_by(&plan, 0), None);
        assert!(need.exceeded_by(&plan, 1).unwrap().contains("3 taps; this line has room for 2 ([line] taps_max)"));
        let narrow = CasingLimits { known_locations: 8, ..need };
        assert!(narrow.exceeded_by(&plan, 0).unwrap().contains("9 locations in truth.csv"));
        // Catches a watched folder, for which each scan may be the largest, that reserves so much for each of them.
        let watched = CasingLimits { taps: 8192, scans: 64, locations: 8192, known_locations: 8192, ..need };
        assert!(Plan::encoded_bytes_max(&watched) < 1 << 20);
    }
}
