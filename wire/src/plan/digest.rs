//! Digests that identify plans and parts of plans.

use sha2::{Digest, Sha256};

use crate::{Geometry, PlannedTap, Recording, SampleFormat, TapId};

/// The first 64 bits of the SHA-256 of `parts`, each with its length: a number that differs for different input.
pub fn digest_of_parts<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> u64 {
    let mut hasher = Sha256::new();
    for part in parts {
        hasher.update((part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    first_bits(hasher)
}

/// The digest of a plan: fields in a fixed order, each with a fixed number of bytes, and never the names of types.
pub(crate) fn digest_of(geometry: Geometry, recording: &Recording, taps: &[PlannedTap], source_digest: u64) -> u64 {
    let mut hasher = Sha256::new();
    let geometry: u8 = match geometry {
        Geometry::Ring => 1,
        Geometry::Line => 2,
    };
    let format: u8 = match recording.sample_format {
        SampleFormat::I16 => 1,
        SampleFormat::F32 => 2,
    };
    hasher.update([geometry, format]);
    hasher.update(recording.sample_rate_hz.to_bits().to_le_bytes());
    hasher.update(recording.pre_trigger_samples.to_le_bytes());
    hasher.update(recording.sample_count_max.to_le_bytes());
    hasher.update((recording.channels.len() as u64).to_le_bytes());
    for &channel in &recording.channels {
        hasher.update(channel.code().to_le_bytes());
        hasher.update([recording.calibration.unit(channel) as u8]);
    }
    hasher.update(source_digest.to_le_bytes());
    for tap in taps {
        let mut row = [0; TAP_BYTES];
        row[..ID_BYTES].copy_from_slice(bytemuck::bytes_of(&tap.id));
        let angle = tap.angle_deg.map_or(u64::MAX, f64::to_bits);
        row[ID_BYTES..ID_BYTES + 8].copy_from_slice(&angle.to_le_bytes());
        row[ID_BYTES + 8..].copy_from_slice(&tap.purpose.code().to_le_bytes());
        hasher.update(row);
    }
    first_bits(hasher)
}

const ID_BYTES: usize = size_of::<TapId>();

/// Bytes of a tap in the digest: its name, its angle, and what it is for.
const TAP_BYTES: usize = ID_BYTES + 8 + 2;

fn first_bits(hasher: Sha256) -> u64 {
    hasher.finalize().iter().take(8).fold(0, |number, &byte| (number << 8) | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::parts::recording;
    use crate::{Calibration, Channel, Purpose, Serial};

    /// Catches a field that the digest leaves out.
    #[test]
    fn whatever_differs_has_another_digest() {
        let recording = recording();
        let tap = PlannedTap {
            id: TapId::new(1, Serial::new("A").unwrap(), 1, 5),
            angle_deg: Some(18.0),
            purpose: Purpose::Scan,
        };
        let named = |rename: fn(&mut TapId)| {
            let mut other = tap;
            rename(&mut other.id);
            other
        };
        let of = |recording: &Recording, tap: PlannedTap| digest_of(Geometry::Ring, recording, &[tap], 7);
        let next = named(|id| id.location = 6);
        let digests = [
            of(&recording, tap),
            digest_of(Geometry::Line, &recording, &[tap], 7),
            digest_of(Geometry::Ring, &recording, &[tap], 8),
            digest_of(Geometry::Ring, &recording, &[], 7),
            digest_of(Geometry::Ring, &recording, &[tap, next], 7),
            digest_of(Geometry::Ring, &recording, &[next, tap], 7),
            of(&Recording { sample_rate_hz: 41.1e3, ..recording.clone() }, tap),
            of(&Recording { pre_trigger_samples: 65, ..recording.clone() }, tap),
            of(&Recording { sample_count_max: 1025, ..recording.clone() }, tap),
            of(&Recording { sample_format: SampleFormat::F32, ..recording.clone() }, tap),
            of(&Recording { calibration: Calibration::default(), ..recording.clone() }, tap),
            of(&Recording { channels: vec![Channel::Sound], ..recording.clone() }, tap),
            of(&recording, named(|id| id.station = 2)),
            of(&recording, next),
            of(&recording, named(|id| *id = id.with_offset_mm(Some(0.0)).unwrap())),
            of(&recording, named(|id| id.repetition = 1)),
            of(&recording, PlannedTap { angle_deg: None, ..tap }),
            of(&recording, PlannedTap { purpose: Purpose::Closing, ..tap }),
        ];
        for (k, digest) in digests.iter().enumerate() {
            assert!(!digests[..k].contains(digest), "{k}");
        }
    }
}
