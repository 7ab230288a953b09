//! Records of the stream as rows of tables and back, and the fingerprints by which two takes are told apart.

use std::hash::{DefaultHasher, Hash, Hasher};

use hdf5::types::FixedUnicode;
use tapline_wire::{
    CHANNELS_MAX, ChannelHeader, DamageCell, Discriminator, Discriminators, IdError, Judgement, Plan, PlannedTap,
    Quality, Reasons, RecordKind, Scan, ScanState, Serial, Stamp, TapHeader, TapId, TapState, Values,
};

use crate::format::layout::{CellRow, DiscriminatorsRow, HeaderRow, LedgerRow, PlanRow, ReasonRow, ScanRow, UNWRITTEN};
use crate::format::lineage::Digest;
use crate::format::lost::Lost;

/// Stands at the end of a text that was cut.
const ELLIPSIS: &str = "\u{2026}";

/// `text` in at most `N` bytes, cut at the end of a character and marked when it is longer.
pub(crate) fn fixed<const N: usize>(text: &str) -> FixedUnicode<N> {
    if let Ok(whole) = text.parse() {
        return whole;
    }
    let cut = &text[..text.floor_char_boundary(N.saturating_sub(ELLIPSIS.len()))];
    format!("{cut}{ELLIPSIS}").parse().unwrap_or_default()
}

/// The text of a fixed field, `None` when it is not UTF-8.
pub(crate) fn text<const N: usize>(field: &FixedUnicode<N>) -> Option<&str> {
    std::str::from_utf8(field.as_bytes()).ok()
}

/// The serial number in a fixed field, empty for an empty field.
pub(crate) fn serial<const N: usize>(field: &FixedUnicode<N>) -> Option<Serial> {
    match text(field)? {
        "" => Some(Serial::default()),
        text => Serial::new(text).ok(),
    }
}

fn known(value: f64) -> Option<f64> {
    Some(value).filter(|v| !v.is_nan())
}

/// The tap `id` at `attempt`.
pub(crate) fn at_attempt(mut id: TapId, attempt: u16) -> TapId {
    id.attempt = attempt;
    id
}

/// The beginning of a plan, or what was added to it at once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Growth {
    /// Rows of the plan then.
    pub(crate) to: u32,
    /// Its digest then.
    pub(crate) plan_digest: u64,
    /// Why it was added, 0 for the beginning.
    pub(crate) why: u16,
}

impl PlanRow {
    /// A row that no tap was planned in.
    pub(crate) fn unwritten() -> Self {
        let tap = PlannedTap { id: TapId::default(), angle_deg: None, is_closing: false };
        Self::new(&tap, UNWRITTEN, Growth { to: 0, plan_digest: 0, why: 0 })
    }

    /// The row of `tap`, which belongs to scan `scan` and was planned with others by `growth`.
    pub(crate) fn new(tap: &PlannedTap, scan: u32, growth: Growth) -> Self {
        Self {
            tyre: fixed(tap.id.tyre.as_str()),
            station: tap.id.station,
            shoulder: tap.id.shoulder,
            scan,
            offset_mm: tap.id.offset_mm().unwrap_or(f64::NAN),
            velocity_m_per_s: tap.id.velocity_m_per_s().unwrap_or(f64::NAN),
            angle_deg: tap.angle_deg.unwrap_or(f64::NAN),
            location: tap.id.location,
            repetition: tap.id.repetition,
            is_closing: tap.is_closing.into(),
            grown_to: growth.to,
            why: growth.why.into(),
            plan_digest: growth.plan_digest,
            checksum: 0,
        }
    }

    /// The planned tap of this row; an error names what cannot be.
    pub(crate) fn to_tap(self) -> Result<PlannedTap, IdError> {
        let tyre = serial(&self.tyre).ok_or_else(|| IdError::Serial {
            text: String::from_utf8_lossy(self.tyre.as_bytes()).into_owned(),
            fault: "is no text".to_owned(),
        })?;
        let mut id = TapId::default()
            .with_offset_mm(known(self.offset_mm))?
            .with_velocity_m_per_s(known(self.velocity_m_per_s))?;
        (id.station, id.tyre, id.shoulder) = (self.station, tyre, self.shoulder);
        (id.location, id.repetition) = (self.location, self.repetition);
        Ok(PlannedTap { id, angle_deg: known(self.angle_deg), is_closing: self.is_closing != 0 })
    }
}

impl HeaderRow {
    /// A row that no tap was written to.
    pub(crate) fn unwritten() -> Self {
        Self {
            plan_index: UNWRITTEN,
            attempt: 0,
            channel_count: 0,
            source: 0,
            sample_rate_hz: 0.0,
            pre_trigger_samples: 0,
            sample_count: 0,
            velocity_measured_m_per_s: f64::NAN,
            microphone_distance_m: 0.0,
            unit_per_count: [0.0; CHANNELS_MAX],
            tap_time_ns: 0,
            sent_ns: 0,
            epoch_ns: 0,
            sequence: 0,
            sender: 0,
            mark: 0,
            samples_digest: Digest::default(),
            stored_checksum: 0,
            checksum: 0,
        }
    }

    /// The header of this row's tap, all that the plan and the recording say of it filled in.
    pub(crate) fn to_header(self, row: u32, plan: &Plan) -> TapHeader {
        let recording = &plan.recording;
        let mut channels = [ChannelHeader::default(); CHANNELS_MAX];
        for ((header, kind), unit_per_count) in channels.iter_mut().zip(&recording.channels).zip(self.unit_per_count) {
            *header = ChannelHeader { code: kind.code(), reserved: 0, unit_per_count };
        }
        TapHeader {
            stamp: Stamp {
                sequence: self.sequence,
                epoch_ns: self.epoch_ns,
                casing: 0,
                kind: RecordKind::Data.code(),
                source: self.sender,
                mark: self.mark,
            },
            id: at_attempt(plan.taps()[row as usize].id, self.attempt),
            plan_index: self.plan_index,
            tap_time_ns: self.tap_time_ns,
            sent_ns: self.sent_ns,
            sample_rate_hz: self.sample_rate_hz,
            velocity_measured_m_per_s: self.velocity_measured_m_per_s,
            velocity_nominal_m_per_s: plan.velocity_nominal_m_per_s(row).unwrap_or(f64::NAN),
            microphone_distance_m: self.microphone_distance_m,
            pre_trigger_samples: self.pre_trigger_samples,
            sample_count: self.sample_count,
            text_bytes: 0,
            sample_format: recording.sample_format.code(),
            channel_count: u32::try_from(recording.channels.len()).unwrap_or(u32::MAX),
            source: self.source,
            retakes_left: 0, // what is archived stands
            reserved: 0,
            channels,
        }
    }

    /// A number that differs for different taps; how and when a tap was sent does not enter it.
    pub(crate) fn fingerprint(&self) -> u64 {
        let floats = [self.sample_rate_hz, self.velocity_measured_m_per_s, self.microphone_distance_m];
        let mut hasher = DefaultHasher::new();
        (self.attempt, self.source, self.pre_trigger_samples, self.sample_count, self.tap_time_ns).hash(&mut hasher);
        floats.map(f64::to_bits).hash(&mut hasher);
        self.unit_per_count.map(f64::to_bits).hash(&mut hasher);
        hasher.finish()
    }
}

impl From<&TapHeader> for HeaderRow {
    fn from(header: &TapHeader) -> Self {
        Self {
            plan_index: header.plan_index,
            attempt: header.id.attempt,
            channel_count: u16::try_from(header.channel_count).unwrap_or(u16::MAX),
            source: header.source,
            sample_rate_hz: header.sample_rate_hz,
            pre_trigger_samples: header.pre_trigger_samples,
            sample_count: header.sample_count,
            velocity_measured_m_per_s: header.velocity_measured_m_per_s,
            microphone_distance_m: header.microphone_distance_m,
            unit_per_count: header.channels.map(|c| c.unit_per_count),
            tap_time_ns: header.tap_time_ns,
            sent_ns: header.sent_ns,
            epoch_ns: header.stamp.epoch_ns,
            sequence: header.stamp.sequence,
            sender: header.stamp.source,
            mark: header.stamp.mark,
            ..Self::unwritten()
        }
    }
}

impl DiscriminatorsRow {
    /// A row that nothing was written to.
    pub(crate) fn unwritten() -> Self {
        Self::from(&Discriminators {
            plan_index: UNWRITTEN,
            velocity_measured_m_per_s: f64::NAN,
            ..Discriminators::default()
        })
    }

    /// The record of this row's tap.
    pub(crate) fn to_discriminators(self, planned: &TapId) -> Discriminators {
        let mut values = Values::default();
        for (which, value) in Discriminator::ALL.into_iter().zip(self.values) {
            values.set(which, Some(value));
        }
        Discriminators {
            id: at_attempt(*planned, self.attempt),
            plan_index: self.plan_index,
            quality: Quality::from_bits(self.quality),
            velocity_measured_m_per_s: self.velocity_measured_m_per_s,
            values,
        }
    }

    /// A number that differs for different records.
    pub(crate) fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        (self.attempt, self.quality, self.velocity_measured_m_per_s.to_bits()).hash(&mut hasher);
        self.values.map(f64::to_bits).hash(&mut hasher);
        hasher.finish()
    }
}

impl From<&Discriminators> for DiscriminatorsRow {
    fn from(record: &Discriminators) -> Self {
        Self {
            plan_index: record.plan_index,
            attempt: record.id.attempt,
            shoulder: record.id.shoulder,
            location: record.id.location,
            quality: record.quality.bits(),
            velocity_measured_m_per_s: record.velocity_measured_m_per_s,
            values: Discriminator::ALL.map(|which| record.values.get(which).unwrap_or(f64::NAN)),
            checksum: 0,
        }
    }
}

impl LedgerRow {
    /// The row of a tap in `state` at `attempt`.
    pub(crate) fn new(state: TapState, attempt: u16) -> Self {
        let (lost_at, retaken_quality, retaken_count) = (Lost::Unknown.code(), 0, 0);
        Self { retaken_quality, retaken_count, attempt, lost_at, state: state.code().into(), checksum: 0 }
    }

    /// The state, `None` for a code nobody knows.
    pub(crate) fn state(&self) -> Option<TapState> {
        TapState::from_code(u8::try_from(self.state).ok()?)
    }
}

impl ScanRow {
    /// The row of a scan that is still open.
    pub(crate) fn open(scan: &Scan, first_cell: u32) -> Self {
        Self {
            station: scan.station,
            tyre: fixed(scan.tyre.as_str()),
            shoulder: scan.shoulder,
            verdict: 0,
            reasons: 0,
            limit_re_inspect: f64::NAN,
            limit_reject: f64::NAN,
            false_call_rate: f64::NAN,
            p_value: f64::NAN,
            evidence: [f64::NAN; Discriminator::COUNT],
            drift: [f64::NAN; Discriminator::COUNT],
            planned_count: u32::try_from(scan.taps.len()).unwrap_or(u32::MAX),
            received_count: 0,
            refused_count: 0,
            absent_count: 0,
            first_cell,
            cell_count: u32::try_from(scan.locations.len()).unwrap_or(u32::MAX),
            state: ScanState::Open.code().into(),
            checksum: 0,
        }
    }

    /// The state, `None` for a code nobody knows.
    pub(crate) fn state(&self) -> Option<ScanState> {
        ScanState::from_code(u8::try_from(self.state).ok()?)
    }

    /// The same row with `judgement` on it.
    pub(crate) fn judged(self, judgement: &Judgement) -> Self {
        Self {
            verdict: judgement.verdict,
            reasons: judgement.reasons.bits(),
            limit_re_inspect: judgement.limit_re_inspect,
            limit_reject: judgement.limit_reject,
            false_call_rate: judgement.false_call_rate,
            p_value: judgement.p_value,
            evidence: judgement.evidence,
            drift: judgement.drift,
            planned_count: judgement.planned_count,
            received_count: judgement.received_count,
            refused_count: judgement.refused_count,
            absent_count: judgement.absent_count,
            state: ScanState::Judged.code().into(),
            ..self
        }
    }

    /// The judgement of scan `number`; of its stamp, only what does not depend on how it was sent.
    pub(crate) fn to_judgement(self, number: u32) -> Judgement {
        Judgement {
            stamp: Stamp { kind: RecordKind::Data.code(), mark: number.into(), ..Stamp::default() },
            verdict: self.verdict,
            reasons: Reasons::from_bits(self.reasons),
            limit_re_inspect: self.limit_re_inspect,
            limit_reject: self.limit_reject,
            false_call_rate: self.false_call_rate,
            p_value: self.p_value,
            evidence: self.evidence,
            drift: self.drift,
            planned_count: self.planned_count,
            received_count: self.received_count,
            refused_count: self.refused_count,
            absent_count: self.absent_count,
        }
    }

    /// A number that differs for different judgements with `cells`.
    pub(crate) fn fingerprint(&self, cells: &[CellRow]) -> u64 {
        let mut hasher = DefaultHasher::new();
        (self.verdict, self.reasons).hash(&mut hasher);
        [self.limit_re_inspect, self.limit_reject, self.false_call_rate, self.p_value]
            .map(f64::to_bits)
            .hash(&mut hasher);
        [self.evidence, self.drift].map(|of| of.map(f64::to_bits)).hash(&mut hasher);
        (self.planned_count, self.received_count, self.refused_count, self.absent_count).hash(&mut hasher);
        for cell in cells {
            (cell.location, cell.region, cell.tap_count, cell.absent_count).hash(&mut hasher);
            [cell.angle_deg, cell.damage_index, cell.p_value, cell.guard, cell.region_p_value]
                .map(f64::to_bits)
                .hash(&mut hasher);
            [cell.offset_best_mm, cell.offset_low_mm, cell.offset_high_mm].map(f64::to_bits).hash(&mut hasher);
        }
        hasher.finish()
    }
}

impl CellRow {
    /// Room for a location that may be asked for yet.
    pub(crate) fn unwritten() -> Self {
        let cell = DamageCell { angle_deg: f64::NAN, ..DamageCell::default() };
        let scan = Scan { station: 0, tyre: Serial::default(), shoulder: 0, taps: Vec::new(), locations: Vec::new() };
        Self::new(UNWRITTEN, &scan, &cell)
    }

    /// The row of `cell` in the damage map of scan `number`.
    pub(crate) fn new(number: u32, scan: &Scan, cell: &DamageCell) -> Self {
        Self {
            scan: number,
            tyre: fixed(scan.tyre.as_str()),
            station: scan.station,
            shoulder: scan.shoulder,
            location: cell.location,
            angle_deg: cell.angle_deg,
            damage_index: cell.damage_index,
            p_value: cell.p_value,
            guard: cell.guard,
            region_p_value: cell.region_p_value,
            offset_best_mm: cell.offset_best_mm,
            offset_low_mm: cell.offset_low_mm,
            offset_high_mm: cell.offset_high_mm,
            region: cell.region,
            tap_count: cell.tap_count,
            absent_count: cell.absent_count,
            checksum: 0,
        }
    }

    /// The damage of this row.
    pub(crate) fn to_cell(self) -> DamageCell {
        DamageCell {
            location: self.location,
            region: self.region,
            angle_deg: self.angle_deg,
            damage_index: self.damage_index,
            p_value: self.p_value,
            guard: self.guard,
            region_p_value: self.region_p_value,
            offset_best_mm: self.offset_best_mm,
            offset_low_mm: self.offset_low_mm,
            offset_high_mm: self.offset_high_mm,
            tap_count: self.tap_count,
            absent_count: self.absent_count,
        }
    }
}

impl ReasonRow {
    /// The row of `reason`, which is cut where it is too long.
    pub(crate) fn new(reason: &str) -> Self {
        Self { reason: fixed(reason), checksum: 0 }
    }

    /// The reason of no refusal.
    pub(crate) fn none() -> Self {
        Self { reason: FixedUnicode::new(), checksum: 0 }
    }
}

/// Row in the damage table of the first cell of every scan of the plan that an archive is begun with, and of the end: each has
/// room for as many locations as taps may be added.
pub(crate) fn first_cells(begun: &Plan, taps_max: usize) -> Vec<usize> {
    let spare = taps_max - begun.taps().len();
    let mut first_cells = vec![0];
    for scan in begun.scans() {
        first_cells.push(first_cells[first_cells.len() - 1] + scan.locations.len() + spare);
    }
    first_cells
}

#[cfg(test)]
#[path = "convert_tests.rs"]
mod tests;
