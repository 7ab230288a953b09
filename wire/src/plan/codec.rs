//! A plan as bytes for shared memory: stations propose plans, and `store` sends them to `fuse`.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use crate::{CasingLimits, Geometry, Plan, PlanError, PlannedTap, Purpose, Recording, Serial, TapId, Truth};

/// All that is not a row: a few values, as JSON.
#[derive(Serialize, Deserialize)]
struct Head {
    geometry: Geometry,
    recording: Recording,
    source_digest: u64,
    truth_count: usize,
    /// Taps of the original plan; the others were added later.
    begun_count: usize,
}

/// Most bytes that a head needs.
const HEAD_BYTES_MAX: usize = 4096;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct TapRow {
    id: TapId,
    purpose: u32,
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

/// Bytes of one tap.
pub(crate) const TAP_BYTES: usize = size_of::<TapRow>();

/// Planned taps as bytes for [`decode_taps`].
pub fn encode_taps(taps: &[PlannedTap]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(taps.len() * TAP_BYTES);
    for tap in taps {
        let angle_deg = tap.angle_deg.unwrap_or(f64::NAN);
        let row = TapRow { id: tap.id, purpose: tap.purpose.code().into(), angle_deg };
        bytes.extend(bytemuck::bytes_of(&row));
    }
    bytes
}

/// The taps that [`encode_taps`] wrote.
///
/// # Errors
/// [`PlanError::Encoding`] for bytes that it did not write.
pub fn decode_taps(bytes: &[u8]) -> Result<Vec<PlannedTap>, PlanError> {
    let rows = bytes.chunks_exact(TAP_BYTES);
    if !rows.remainder().is_empty() {
        return Err(PlanError::Encoding { what: "it is cut short" });
    }
    let tap = |row: &[u8]| {
        let row: TapRow = bytemuck::pod_read_unaligned(row);
        let purpose = u16::try_from(row.purpose).ok().and_then(Purpose::from_code);
        let purpose = purpose.ok_or(PlanError::Encoding { what: "a tap has an unknown purpose" })?;
        Ok(PlannedTap { id: row.id, angle_deg: Some(row.angle_deg).filter(|angle| !angle.is_nan()), purpose })
    };
    rows.map(tap).collect()
}

impl Plan {
    /// The plan as bytes for [`Plan::decode`].
    pub fn encode(&self) -> Vec<u8> {
        let head = Head {
            geometry: self.geometry,
            recording: self.recording.clone(),
            source_digest: self.source_digest(),
            truth_count: self.truth().len(),
            begun_count: self.begun_count,
        };
        let head = serde_json::to_vec(&head).unwrap_or_default(); // numbers and lists of them cannot fail
        let mut bytes = Vec::with_capacity(4 + head.len() + self.taps().len() * TAP_BYTES);
        bytes.extend((head.len() as u32).to_le_bytes());
        bytes.extend(head);
        for (&(tyre, shoulder, location), &is_cracked) in self.truth() {
            let row = TruthRow { tyre, location, shoulder, is_cracked: is_cracked.into() };
            bytes.extend(bytemuck::bytes_of(&row));
        }
        bytes.extend(encode_taps(self.taps()));
        bytes
    }

    /// The plan that [`Plan::encode`] wrote.
    ///
    /// # Errors
    /// [`PlanError::Encoding`] for bytes that it did not write, and as [`Plan::new`].
    pub fn decode(bytes: &[u8]) -> Result<Self, PlanError> {
        let cut = || PlanError::Encoding { what: "it is cut short" };
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or_else(cut)?;
        let (head, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or_else(cut)?;
        let head: Head =
            serde_json::from_slice(head).map_err(|_error| PlanError::Encoding { what: "its head is not valid" })?;
        let truth_bytes = head.truth_count.checked_mul(size_of::<TruthRow>()).ok_or_else(cut)?;
        let (truth_rows, tap_rows) = rest.split_at_checked(truth_bytes).ok_or_else(cut)?;
        let mut truth = Truth::new();
        for row in truth_rows.chunks_exact(size_of::<TruthRow>()) {
            let row: TruthRow = bytemuck::pod_read_unaligned(row);
            truth.insert((row.tyre, row.shoulder, row.location), row.is_cracked != 0);
        }
        let taps = decode_taps(tap_rows)?;
        let (begun, added) = taps.split_at_checked(head.begun_count).ok_or_else(cut)?;
        let begun = Self::from_source(head.geometry, head.recording, begun.to_vec(), truth, head.source_digest)?;
        if added.is_empty() { Ok(begun) } else { begun.grown(added) }
    }

    /// Bytes of the longest plan within `limits`.
    pub(crate) fn encoded_bytes_max(limits: &CasingLimits) -> usize {
        4 + HEAD_BYTES_MAX + limits.taps * TAP_BYTES + limits.known_locations * size_of::<TruthRow>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::parts::recording;
    use crate::{Calibration, SampleFormat};

    fn begun() -> Plan {
        let tyre = Serial::new("A-17").unwrap();
        let taps = (0..7).map(|location| PlannedTap {
            id: TapId::new(3, tyre, 1 + (location / 4) as u16, location).with_offset_mm(Some(5.0)).unwrap(),
            angle_deg: (location != 2).then_some(f64::from(location) * 3.6),
            purpose: Purpose::closing_if(location == 6),
        });
        let recording = Recording {
            sample_rate_hz: 40_960.5,
            sample_format: SampleFormat::F32,
            calibration: Calibration::computed(),
            ..recording()
        };
        let truth = Truth::from([((tyre, 1, 3), true), ((tyre, 2, 4), false)]);
        Plan::from_source(Geometry::Ring, recording, taps.collect(), truth, 99).unwrap()
    }

    #[test]
    fn a_plan_that_crossed_is_the_same_plan() {
        let mut again = begun().taps()[1];
        (again.id.repetition, again.purpose) = (1, Purpose::Suspect);
        for plan in [begun(), begun().grown(&[again]).unwrap()] {
            let bytes = plan.encode();
            let there = Plan::decode(&bytes).unwrap();
            assert_eq!((&there, there.digest()), (&plan, plan.digest()));
            assert_eq!(there.begun(), begun());
            assert!(bytes.len() <= Plan::encoded_bytes_max(&CasingLimits::from_plan(&plan)));
        }
    }

    #[test]
    fn bytes_that_are_no_plan_are_refused() {
        let bytes = begun().encode();
        for end in 0..bytes.len() {
            assert!(Plan::decode(&bytes[..end]).is_err(), "cut at {end}");
        }
        assert!(Plan::decode(&[&bytes[..], &[0]].concat()).is_err());
    }
}
