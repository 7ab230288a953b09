//! How large the casings of a source are at most: what the topics and files of a line have room for.

use tapline_wire::Plan;

/// The largest counts of any casing of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Limits {
    /// Taps of a casing.
    pub taps: usize,
    /// Scans of a casing: its shoulders, or the lines of a slab.
    pub scans: usize,
    /// Locations of a casing, over all its scans.
    pub cells: usize,
    /// Locations of one scan.
    pub locations: usize,
    /// Bytes of the samples of one tap.
    pub record_bytes: usize,
}

impl Limits {
    /// What a casing with this `plan` needs.
    pub fn of(plan: &Plan) -> Self {
        let of_scans = plan.scans().iter().map(|scan| scan.locations.len());
        Self {
            taps: plan.taps().len(),
            scans: plan.scans().len(),
            cells: of_scans.clone().sum(),
            locations: of_scans.max().unwrap_or(0),
            record_bytes: plan.recording.payload_bytes_max(),
        }
    }

    /// What is enough for both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            taps: self.taps.max(other.taps),
            scans: self.scans.max(other.scans),
            cells: self.cells.max(other.cells),
            locations: self.locations.max(other.locations),
            record_bytes: self.record_bytes.max(other.record_bytes),
        }
    }
}
