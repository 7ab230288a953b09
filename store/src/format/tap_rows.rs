//! The rows of a tap: from the records of the stream and back, and the fingerprints by which two attempts differ.

use std::hash::{DefaultHasher, Hash, Hasher};

use hdf5::types::FixedUnicode;
use tapline_wire::{
    CHANNELS_MAX, ChannelHeader, Discriminator, Discriminators, IdError, Plan, PlannedTap, Purpose, Quality,
    RecordKind, Stamp, TapHeader, TapId, TapState, Values,
};

use crate::format::fields::{at_attempt, fixed, known, serial};
use crate::format::layout::{DiscriminatorsRow, HeaderRow, LedgerRow, PlanRow, ReasonRow, UNWRITTEN};
use crate::format::lost::Lost;

/// A state of the plan: as it was begun, or after taps were added.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Growth {
    /// Rows of the plan in that state.
    pub to: u32,
    /// Its digest in that state.
    pub plan_digest: u64,
}

impl PlanRow {
    /// A row without a tap.
    pub(crate) fn unwritten() -> Self {
        let tap = PlannedTap { id: TapId::default(), angle_deg: None, purpose: Purpose::Scan };
        Self::new(&tap, UNWRITTEN, Growth { to: 0, plan_digest: 0 })
    }

    /// The row of `tap` of scan `scan`, which was planned with `growth`.
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
            purpose: tap.purpose.code(),
            grown_to: growth.to.into(),
            plan_digest: growth.plan_digest,
            checksum: 0,
        }
    }

    /// The planned tap of this row.
    ///
    /// # Errors
    /// [`IdError`] for a value that no tap has.
    pub(crate) fn to_tap(self) -> Result<PlannedTap, IdError> {
        let tyre = serial(&self.tyre).ok_or_else(|| IdError::Serial {
            text: String::from_utf8_lossy(self.tyre.as_bytes()).into_owned(),
            fault: "is not text".to_owned(),
        })?;
        let mut id = TapId::default()
            .with_offset_mm(known(self.offset_mm))?
            .with_velocity_m_per_s(known(self.velocity_m_per_s))?;
        (id.station, id.tyre, id.shoulder) = (self.station, tyre, self.shoulder);
        (id.location, id.repetition) = (self.location, self.repetition);
        let purpose = Purpose::from_code(self.purpose);
        let value = f64::from(self.purpose);
        let purpose = purpose.ok_or(IdError::OutOfRange { name: "purpose", value, low: 0.0, high: 3.0 })?;
        Ok(PlannedTap { id, angle_deg: known(self.angle_deg), purpose })
    }
}

impl HeaderRow {
    /// A row that was never written.
    pub(crate) fn unwritten() -> Self {
        Self { plan_index: UNWRITTEN, velocity_measured_m_per_s: f64::NAN, ..Self::default() }
    }

    /// The header of this row's tap, completed from the plan and its recording.
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
            retakes_left: 0, // an archived tap is final
            planned_sample_count: recording.sample_count_max,
            channels,
        }
    }

    /// A hash that differs for different taps; how and when a tap was sent is not included.
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
    /// A row that was never written.
    pub(crate) fn unwritten() -> Self {
        Self::from(&Discriminators {
            plan_index: UNWRITTEN,
            velocity_measured_m_per_s: f64::NAN,
            ..Discriminators::default()
        })
    }

    /// The record of this row, of the tap `planned`.
    pub(crate) fn to_discriminators(self, planned: &TapId) -> Discriminators {
        let mut values = Values::default();
        for (which, value) in Discriminator::ALL.into_iter().zip(self.values) {
            values.set(which, Some(value));
        }
        Discriminators {
            id: at_attempt(*planned, self.attempt),
            plan_index: self.plan_index,
            quality: Quality::from_bits_retain(self.quality),
            velocity_measured_m_per_s: self.velocity_measured_m_per_s,
            values,
        }
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

    /// The state; `None` for an unknown code.
    pub(crate) fn state(&self) -> Option<TapState> {
        TapState::from_code(u8::try_from(self.state).ok()?)
    }
}

impl ReasonRow {
    /// The row of `reason`, which is cut if it is too long.
    pub(crate) fn new(reason: &str) -> Self {
        Self { reason: fixed(reason), checksum: 0 }
    }

    /// The row of a tap that was not refused.
    pub(crate) fn none() -> Self {
        Self { reason: FixedUnicode::new(), checksum: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a fingerprint that changes when a tap is sent again, and one that a field of the tap does not enter.
    #[test]
    fn fingerprints_differ_by_attempt_and_not_by_sending() {
        let row = HeaderRow::unwritten();
        let resent = HeaderRow { sequence: 9, epoch_ns: 9, sent_ns: 9, ..row };
        assert_eq!(row.fingerprint(), resent.fingerprint());
        let retaken = [
            HeaderRow { attempt: 1, ..row },
            HeaderRow { tap_time_ns: 1, ..row },
            HeaderRow { sample_count: 1, ..row },
            HeaderRow { velocity_measured_m_per_s: 1.0, ..row },
            HeaderRow { unit_per_count: [0.0, 1.0, 0.0, 0.0], ..row },
        ];
        assert!(retaken.iter().all(|other| other.fingerprint() != row.fingerprint()));
    }
}
