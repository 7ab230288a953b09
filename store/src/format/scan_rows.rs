//! The rows of a scan and of its damage map: from the records of the stream and back.

use tapline_wire::{DamageCell, Judgement, Plan, Reasons, RecordKind, Scan, ScanState, Serial, Stamp};

use crate::format::checksum::{ChecksummedRow as _, checksum};
use crate::format::fields::fixed;
use crate::format::layout::{CellRow, ScanRow, UNWRITTEN};

/// Copies the fields that a row has in common with its record, either way; the record has those in parentheses besides.
macro_rules! in_common {
    ($row:ident, $record:ident($($own:ident: $type:ty),*), $($field:ident)+) => {
        impl $row {
            fn with(self, record: &$record) -> Self {
                Self { $($field: record.$field,)+ ..self }
            }

            fn record(self, $($own: $type),*) -> $record {
                $record { $($own,)* $($field: self.$field,)+ }
            }
        }
    };
}

in_common!(ScanRow, Judgement(stamp: Stamp, reasons: Reasons),
    verdict limit_re_inspect limit_reject strongest_arc first_strongest_arc re_inspect_rate reject_rate p_value
    evidence scatter level drift planned_count received_count refused_count absent_count
);

in_common!(CellRow, DamageCell(),
    location angle_deg damage_index first_index p_value region_index region_p_value
    offset_best_mm offset_low_mm offset_high_mm region tap_count absent_count
);

impl ScanRow {
    /// The row of an open scan.
    pub(crate) fn open(scan: &Scan, first_cell: u32) -> Self {
        let row = Self {
            station: scan.station,
            tyre: fixed(scan.tyre.as_str()),
            shoulder: scan.shoulder,
            first_cell,
            cell_count: u32::try_from(scan.locations.len()).unwrap_or(u32::MAX),
            ..Self::default()
        };
        let planned_count = u32::try_from(scan.taps.len()).unwrap_or(u32::MAX);
        // A judgement that says nothing: what is not known is NaN.
        let row = row.judged(&Judgement { planned_count, ..Judgement::default() });
        Self { state: ScanState::Open.code().into(), ..row }
    }

    /// The state; `None` for an unknown code.
    pub(crate) fn state(&self) -> Option<ScanState> {
        ScanState::from_code(u8::try_from(self.state).ok()?)
    }

    /// The same row with `judgement`.
    pub(crate) fn judged(self, judgement: &Judgement) -> Self {
        Self { reasons: judgement.reasons.bits(), state: ScanState::Judged.code().into(), ..self.with(judgement) }
    }

    /// The judgement of scan `number`. Its stamp has only what does not depend on how it was sent.
    pub(crate) fn to_judgement(self, number: u32) -> Judgement {
        let stamp = Stamp { kind: RecordKind::Data.code(), mark: number.into(), ..Stamp::default() };
        self.record(stamp, Reasons::from_bits_retain(self.reasons))
    }
}

impl CellRow {
    /// A spare row, for a location that may be added.
    pub(crate) fn unwritten() -> Self {
        let cell = DamageCell { angle_deg: f64::NAN, ..DamageCell::default() };
        let scan = Scan { station: 0, tyre: Serial::default(), shoulder: 0, taps: Vec::new(), locations: Vec::new() };
        Self::new(UNWRITTEN, &scan, &cell)
    }

    /// The row of `cell` in the damage map of scan `number`.
    pub(crate) fn new(number: u32, scan: &Scan, cell: &DamageCell) -> Self {
        let tyre = fixed(scan.tyre.as_str());
        let row = Self { scan: number, tyre, station: scan.station, shoulder: scan.shoulder, ..Self::default() };
        row.with(cell)
    }

    /// The cell of this row.
    pub(crate) fn to_cell(self) -> DamageCell {
        self.record()
    }
}

/// A hash of the verdict on scan `number` and its map: over the checksums of their rows, cells from `first_cell` on.
pub(crate) fn fingerprint(number: usize, row: ScanRow, first_cell: usize, cells: &[CellRow]) -> u64 {
    let cells = (first_cell..).zip(cells).map(|(number, cell)| cell.with_checksum(number).checksum);
    let all: Vec<u8> =
        [row.with_checksum(number).checksum].into_iter().chain(cells).flat_map(u64::to_le_bytes).collect();
    checksum(&[&all])
}

/// For every scan of `begun`, the damage-table row of its first cell; at the end, the number of rows. Each scan has as
/// many spare rows as taps may be added.
pub(crate) fn first_cells(begun: &Plan, taps_max: usize) -> Vec<usize> {
    let spare = taps_max - begun.taps().len();
    let mut first_cells = vec![0];
    for scan in begun.scans() {
        first_cells.push(first_cells[first_cells.len() - 1] + scan.locations.len() + spare);
    }
    first_cells
}
