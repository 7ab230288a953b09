//! How much a line has room for.

use serde::{Deserialize, Serialize};

use crate::Plan;

/// What a line has room for: the sizes of its topics follow from it, so all its processes must agree on it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Processes that acquire, each for several stations.
    pub acquire_count: u16,
    /// The stations, ascending.
    pub stations: Vec<u16>,
    /// Bytes of the longest record's samples.
    pub record_bytes_max: usize,
    /// Taps of the largest casing, those that may be asked for while it is open included.
    pub taps_max: usize,
    /// Scans of the largest casing.
    pub scans_max: usize,
    /// Locations of the largest scan.
    pub locations_max: usize,
}

impl Default for Limits {
    /// Two shoulders of 100 locations, four offsets, three velocities, two repetitions; records of two channels of 16384
    /// samples of 16 bits.
    fn default() -> Self {
        Self {
            acquire_count: 1,
            stations: vec![1],
            record_bytes_max: 2 * 16_384 * 2,
            taps_max: 2 * 4 * 3 * 2 * 101,
            scans_max: 2,
            locations_max: 100,
        }
    }
}

impl Limits {
    /// Limits that have room for `plan` and nothing else.
    pub fn of(plan: &Plan) -> Self {
        let stations = plan.stations();
        let none =
            Self { acquire_count: 1, stations, record_bytes_max: 0, taps_max: 0, scans_max: 0, locations_max: 0 };
        none.including(plan)
    }

    /// These limits, raised where `plan` needs more.
    pub fn including(mut self, plan: &Plan) -> Self {
        let raise = |limit: &mut usize, to: usize| *limit = (*limit).max(to);
        raise(&mut self.record_bytes_max, plan.recording.payload_bytes_max());
        raise(&mut self.taps_max, plan.taps().len());
        raise(&mut self.scans_max, plan.scans().len());
        plan.scans().iter().for_each(|scan| raise(&mut self.locations_max, scan.locations.len()));
        self
    }

    /// Number of the `acquire` process that serves `station`: they take turns; `None` for a station
    /// that the line does not have.
    pub fn acquire_of(&self, station: u16) -> Option<u16> {
        let place = self.stations.iter().position(|&known| known == station)?;
        u16::try_from(place % usize::from(self.acquire_count.max(1))).ok()
    }

    /// What of `plan` is beyond these limits, with both numbers; `None` where there is room.
    pub fn exceeded_by(&self, plan: &Plan) -> Option<String> {
        let need = Self::of(plan);
        [
            ("bytes a record", need.record_bytes_max, self.record_bytes_max),
            ("taps", need.taps_max, self.taps_max),
            ("scans", need.scans_max, self.scans_max),
            ("locations a scan", need.locations_max, self.locations_max),
        ]
        .into_iter()
        .find(|&(_, need, most)| need > most)
        .map(|(what, need, most)| format!("it has {need} {what}; this line has room for {most}"))
    }
}
