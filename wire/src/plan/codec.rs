//! A plan as bytes, to cross shared memory: it is proposed by a station and told to `fuse`.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use crate::{
    CasingLimits, Channel, Geometry, Plan, PlanError, PlannedTap, Recording, SampleFormat, Serial, TapId, Truth,
};

/// What is not a row: few values, written as JSON.
#[derive(Serialize, Deserialize)]
struct Head {
    is_ring: bool,
    sample_rate_hz: f64,
    pre_trigger_samples: u32,
    sample_count_max: u32,
    sample_format: SampleFormat,
    channels: Vec<Channel>,
    source_digest: u64,
    truth_count: usize,
    tap_count: usize,
}

/// Bytes that a head needs at most.
const HEAD_BYTES_MAX: usize = 1024;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct TapRow {
    id: TapId,
    is_closing: u32,
    /// NaN where the angle is unknown.
    angle_deg: f64,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct TruthRow {
    tyre: Serial,
    location: u32,
    shoulder: u16,
    is_cracked: u16,
}

impl Plan {
    /// The plan as bytes for [`Plan::decode`].
    pub fn encode(&self) -> Vec<u8> {
        let recording = &self.recording;
        let head = Head {
            is_ring: self.geometry == Geometry::Ring,
            sample_rate_hz: recording.sample_rate_hz,
            pre_trigger_samples: recording.pre_trigger_samples,
            sample_count_max: recording.sample_count_max,
            sample_format: recording.sample_format,
            channels: recording.channels.clone(),
            source_digest: self.source_digest(),
            truth_count: self.truth().len(),
            tap_count: self.taps().len(),
        };
        let head = serde_json::to_vec(&head).unwrap_or_default(); // numbers and lists of them cannot fail
        let mut bytes = Vec::with_capacity(4 + head.len() + self.taps().len() * size_of::<TapRow>());
        bytes.extend((head.len() as u32).to_le_bytes());
        bytes.extend(head);
        for (&(tyre, shoulder, location), &is_cracked) in self.truth() {
            let row = TruthRow { tyre, location, shoulder, is_cracked: is_cracked.into() };
            bytes.extend(bytemuck::bytes_of(&row));
        }
        for tap in self.taps() {
            let angle_deg = tap.angle_deg.unwrap_or(f64::NAN);
            let row = TapRow { id: tap.id, is_closing: tap.is_closing.into(), angle_deg };
            bytes.extend(bytemuck::bytes_of(&row));
        }
        bytes
    }

    /// The plan that [`Plan::encode`] wrote.
    ///
    /// # Errors
    /// [`PlanError::Encoding`] for bytes that it did not write, and as [`Plan::new`].
    pub fn decode(bytes: &[u8]) -> Result<Self, PlanError> {
        let cut = || PlanError::Encoding { what: "it is cut" };
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or_else(cut)?;
        let (head, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or_else(cut)?;
        let head: Head =
            serde_json::from_slice(head).map_err(|_error| PlanError::Encoding { what: "its head is none" })?;
        let truth_bytes = head.truth_count.checked_mul(size_of::<TruthRow>()).ok_or_else(cut)?;
        let (truth_rows, tap_rows) = rest.split_at_checked(truth_bytes).ok_or_else(cut)?;
        if head.tap_count.checked_mul(size_of::<TapRow>()) != Some(tap_rows.len()) {
            return Err(cut());
        }
        let mut truth = Truth::new();
        for row in truth_rows.chunks_exact(size_of::<TruthRow>()) {
            let row: TruthRow = bytemuck::pod_read_unaligned(row);
            truth.insert((row.tyre, row.shoulder, row.location), row.is_cracked != 0);
        }
        let taps = tap_rows.chunks_exact(size_of::<TapRow>()).map(|row| {
            let row: TapRow = bytemuck::pod_read_unaligned(row);
            let angle_deg = Some(row.angle_deg).filter(|angle| !angle.is_nan());
            PlannedTap { id: row.id, angle_deg, is_closing: row.is_closing != 0 }
        });
        let recording = Recording {
            sample_rate_hz: head.sample_rate_hz,
            pre_trigger_samples: head.pre_trigger_samples,
            sample_count_max: head.sample_count_max,
            sample_format: head.sample_format,
            channels: head.channels,
        };
        let geometry = if head.is_ring { Geometry::Ring } else { Geometry::Line };
        Self::from_source(geometry, recording, taps.collect(), truth, head.source_digest)
    }

    /// Bytes of the longest plan within `limits`.
    pub(crate) fn encoded_bytes_max(limits: &CasingLimits) -> usize {
        // Of no more locations than have taps, or than a scan may have, the truth is known.
        4 + HEAD_BYTES_MAX + limits.taps * size_of::<TapRow>() + limits.scans * limits.locations * size_of::<TruthRow>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Plan {
        let tyre = Serial::new("A-17").unwrap();
        let taps = (0..7).map(|location| PlannedTap {
            id: TapId::new(3, tyre, 1 + (location / 4) as u16, location).with_offset_mm(Some(5.0)).unwrap(),
            angle_deg: (location != 2).then_some(f64::from(location) * 3.6),
            is_closing: location == 6,
        });
        let recording = Recording {
            sample_rate_hz: 40_960.5,
            pre_trigger_samples: 64,
            sample_count_max: 4096,
            sample_format: SampleFormat::F32,
            channels: vec![Channel::Force, Channel::Sound],
        };
        let truth = Truth::from([((tyre, 1, 3), true), ((tyre, 2, 4), false)]);
        Plan::from_source(Geometry::Ring, recording, taps.collect(), truth, 99).unwrap()
    }

    #[test]
    fn a_plan_that_crossed_is_the_same_plan() {
        let plan = plan();
        let bytes = plan.encode();
        let there = Plan::decode(&bytes).unwrap();
        assert_eq!((&there, there.digest()), (&plan, plan.digest()));
        assert!(bytes.len() <= Plan::encoded_bytes_max(&CasingLimits::from_plan(&plan)));
    }

    #[test]
    fn bytes_that_are_no_plan_are_refused() {
        let bytes = plan().encode();
        for end in 0..bytes.len() {
            assert!(Plan::decode(&bytes[..end]).is_err(), "cut at {end}");
        }
        assert!(Plan::decode(&[&bytes[..], &[0]].concat()).is_err());
    }
}
