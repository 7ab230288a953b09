//! Progress of a casing: the counts of its taps, and where they are on its shoulders.

use serde::{Deserialize, Serialize};
use tapline_wire::{Ledger, PlannedTap, Scan, Serial, TapState};

/// The progress of a casing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct CasingStatus {
    pub name: String,
    pub planned: usize,
    pub archived: usize,
    pub refused: usize,
    /// How often one of its taps was taken again.
    pub retaken: u64,
    pub shoulders: Vec<ShoulderStatus>,
}

/// The progress around a shoulder, or along a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ShoulderStatus {
    pub tyre: String,
    pub shoulder: u16,
    /// Angle of each location in degrees, clockwise from the start mark; empty on a line, and where angles are unknown.
    pub angles_deg: Vec<f64>,
    /// One character per location, for how many of its taps are done: `0`, none, to `9`, all; `r` if one is refused.
    pub locations: String,
    /// Its planned taps.
    pub planned: usize,
    /// Of these, archived or refused.
    pub settled: usize,
}

/// Where the taps of a casing's plan lie.
#[derive(Debug, Default)]
pub(crate) struct Layout {
    shoulders: Vec<Shoulder>,
    /// For each row of the plan, its shoulder and its place among the locations; `None` for taps that close a ring.
    places: Vec<Option<(usize, usize)>>,
}

#[derive(Debug)]
struct Shoulder {
    tyre: Serial,
    number: u16,
    angles_deg: Vec<f64>,
    location_count: usize,
}

/// The taps at one location.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    planned: usize,
    settled: usize,
    refused: usize,
}

impl Layout {
    /// The layout of the `scans` of a plan's `taps`.
    pub(crate) fn new(taps: &[PlannedTap], scans: &[Scan]) -> Self {
        let mut places = vec![None; taps.len()];
        for (number, scan) in scans.iter().enumerate() {
            for &row in &scan.taps {
                let (row, tap) = (row as usize, &taps[row as usize]);
                let place = scan.locations.binary_search_by_key(&tap.id.location, |&(location, _)| location);
                places[row] = place.ok().filter(|_| !tap.is_closing()).map(|place| (number, place));
            }
        }
        // A tenth of a degree is finer than any picture shows.
        let shown_deg = |&(_, angle): &(u32, Option<f64>)| angle.map(|deg| (deg * 10.0).round() / 10.0);
        let shoulder = |scan: &Scan| Shoulder {
            tyre: scan.tyre,
            number: scan.shoulder,
            angles_deg: scan.locations.iter().map(shown_deg).collect::<Option<_>>().unwrap_or_default(),
            location_count: scan.locations.len(),
        };
        Self { shoulders: scans.iter().map(shoulder).collect(), places }
    }

    /// The shoulders with the states of their taps in `ledger`; without one all are missing.
    pub(crate) fn shoulders(&self, ledger: Option<&Ledger>) -> Vec<ShoulderStatus> {
        let mut counts: Vec<Vec<Count>> =
            self.shoulders.iter().map(|shoulder| vec![Count::default(); shoulder.location_count]).collect();
        for (row, place) in self.places.iter().enumerate() {
            let Some((shoulder, place)) = *place else { continue };
            let count = &mut counts[shoulder][place];
            // The plan may have grown since the ledger.
            let state = ledger.and_then(|ledger| ledger.taps().get(row)).copied().unwrap_or(TapState::Missing);
            count.planned += 1;
            count.settled += usize::from(state.is_settled());
            count.refused += usize::from(state == TapState::Refused);
        }
        let of = |(shoulder, counts): (&Shoulder, Vec<Count>)| ShoulderStatus {
            tyre: shoulder.tyre.to_string(),
            shoulder: shoulder.number,
            angles_deg: shoulder.angles_deg.clone(),
            planned: counts.iter().map(|count| count.planned).sum(),
            settled: counts.iter().map(|count| count.settled).sum(),
            locations: counts.into_iter().map(Count::character).collect(),
        };
        self.shoulders.iter().zip(counts).map(of).collect()
    }
}

impl Count {
    fn character(self) -> char {
        match self {
            Self { refused: 1.., .. } => 'r',
            Self { settled: 0, .. } => '0',
            Self { settled, planned, .. } if settled >= planned => '9',
            Self { settled, planned, .. } => char::from_digit((8 * settled / planned).max(1) as u32, 10).unwrap_or('1'),
        }
    }
}

/// How often the taps of `ledger` were taken again.
pub(crate) fn retaken(ledger: &Ledger) -> u64 {
    (0..ledger.taps().len()).map(|row| u64::from(ledger.attempt(row))).sum()
}

#[cfg(test)]
mod tests {
    use tapline_wire::{Purpose, TapId, scans_of};

    use super::*;

    fn tap(shoulder: u16, location: u32, repetition: u16, angle_deg: Option<f64>) -> PlannedTap {
        let mut id = TapId::new(1, Serial::new("A").unwrap(), shoulder, location);
        id.repetition = repetition;
        PlannedTap { id, angle_deg, purpose: Purpose::Scan }
    }

    /// Catches a location that looks done while one of its taps is missing, or that has a wrong angle or shoulder;
    /// a refused tap that looks done; and a closing tap of a ring that is shown as a location.
    #[test]
    fn each_location_shows_how_many_of_its_taps_there_are() {
        let mut taps = Vec::new();
        for repetition in 0..2 {
            taps.extend([2, 0, 1].map(|place| tap(1, place, repetition, Some(f64::from(place) * 120.04))));
        }
        taps.push(PlannedTap { purpose: Purpose::Closing, ..tap(1, 3, 0, Some(0.0)) });
        taps.push(tap(2, 7, 0, None));
        let layout_of = |taps: &[PlannedTap]| Layout::new(taps, &scans_of(taps).unwrap());
        let layout = layout_of(&taps);
        let mut ledger = Ledger::empty(taps.len(), 2);
        assert_eq!(layout.shoulders(None), layout.shoulders(Some(&ledger)));
        for (row, state) in
            [(0, TapState::Archived), (1, TapState::Archived), (4, TapState::Archived), (2, TapState::Refused)]
        {
            ledger.set_tap(row, state, 0);
        }
        ledger.set_tap(7, TapState::Archived, 3);
        let shown = layout.shoulders(Some(&ledger));
        assert_eq!((shown[0].locations.as_str(), &shown[0].angles_deg), ("9r4", &vec![0.0, 120.0, 240.1]));
        assert_eq!((shown[1].locations.as_str(), shown[1].angles_deg.len()), ("9", 0));
        assert_eq!((shown[0].planned, shown[0].settled, shown[1].settled), (6, 4, 1));
        assert_eq!(retaken(&ledger), 3);
        // A plan that has grown has taps that an old ledger does not know.
        let grown = layout_of(&[taps, vec![tap(2, 7, 1, None)]].concat());
        assert_eq!(grown.shoulders(Some(&ledger))[1].locations, "4");
    }
}
