//! One tap as it crosses shared memory: a header, and samples in place behind it.

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::{Stamp, Stamped, TapId};

/// Most channels a record can have.
pub const CHANNELS_MAX: usize = 4;

/// Bytes of one [`Lane`].
pub const LANE_BYTES: usize = 64;

/// The unit of sample memory: one cache line, so that samples start aligned for SIMD loads.
#[repr(C)]
#[repr(align(64))]
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable, ZeroCopySend)]
pub struct Lane([u8; LANE_BYTES]);

impl Default for Lane {
    fn default() -> Self {
        Self([0; LANE_BYTES])
    }
}

/// What one channel of a record measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// Impact force, in newtons after scaling.
    Force,
    /// Microphone or receiver voltage, in volts after scaling.
    Sound,
}

impl Channel {
    /// The channel's name in configurations, archives and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Force => "force",
            Self::Sound => "sound",
        }
    }

    /// Number that stands for the channel in a [`ChannelHeader`].
    pub fn code(self) -> u32 {
        match self {
            Self::Force => 1,
            Self::Sound => 2,
        }
    }

    /// The channel that `code` stands for.
    pub fn from_code(code: u32) -> Option<Self> {
        [Self::Force, Self::Sound].into_iter().find(|c| c.code() == code)
    }
}

/// How the converter gave its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SampleFormat {
    /// Signed 16-bit counts.
    I16,
    /// 32-bit floating point.
    F32,
}

impl SampleFormat {
    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::F32 => 4,
        }
    }

    /// Number that stands for the format in a [`TapHeader`].
    pub fn code(self) -> u32 {
        match self {
            Self::I16 => 1,
            Self::F32 => 2,
        }
    }

    /// The format that `code` stands for.
    pub fn from_code(code: u32) -> Option<Self> {
        [Self::I16, Self::F32].into_iter().find(|c| c.code() == code)
    }
}

/// Where a tap came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SourceKind {
    /// The simulated tyre.
    Simulated,
    /// A folder of recordings.
    TapSet,
}

impl SourceKind {
    /// Number that stands for the source in a [`TapHeader`].
    pub fn code(self) -> u32 {
        match self {
            Self::Simulated => 1,
            Self::TapSet => 2,
        }
    }

    /// The source's name in archives.
    pub fn name(self) -> &'static str {
        match self {
            Self::Simulated => "simulated",
            Self::TapSet => "tap set",
        }
    }

    /// The source that `code` stands for.
    pub fn from_code(code: u32) -> Option<Self> {
        [Self::Simulated, Self::TapSet].into_iter().find(|c| c.code() == code)
    }
}

/// Kind and scale of one channel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
pub struct ChannelHeader {
    /// [`Channel::code`], 0 where there is no channel.
    pub code: u32,
    /// Keeps the layout free of padding.
    pub reserved: u32,
    /// Newtons or volts per count: a stored sample times this is the physical value.
    pub unit_per_count: f64,
}

/// All that is known of a tap beside its samples.
///
/// Samples are planar, `[channel][sample]`, `channel_count * sample_count` of them, as the converter gave them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("tapline.TapHeader.v2")]
pub struct TapHeader {
    /// Which record of which publisher this is; `stamp.kind` says whether it is a tap at all.
    pub stamp: Stamp,
    /// Name of the tap.
    pub id: TapId,
    /// Row of the tap in the scan plan.
    pub plan_index: u32,
    /// When the impact happened, ns since the Unix epoch.
    pub tap_time_ns: i64,
    /// When the record was sent, ns on [`crate::monotonic_ns`]'s clock; telemetry, in no result.
    pub sent_ns: i64,
    /// Samples per second and channel.
    pub sample_rate_hz: f64,
    /// Impact velocity as measured in m/s, NaN where it was not.
    pub velocity_measured_m_per_s: f64,
    /// Impact velocity that was meant, [`crate::Plan::velocity_nominal_m_per_s`]; NaN where the plan names none.
    pub velocity_nominal_m_per_s: f64,
    /// Distance D from impact to microphone in m, 0 where it does not matter.
    pub microphone_distance_m: f64,
    /// Samples before the trigger, p.
    pub pre_trigger_samples: u32,
    /// Samples of one channel.
    pub sample_count: u32,
    /// Bytes of text behind the header of a [`crate::RecordKind::Refusal`].
    pub text_bytes: u32,
    /// [`SampleFormat::code`].
    pub sample_format: u32,
    /// Channels in use.
    pub channel_count: u32,
    /// [`SourceKind::code`].
    pub source: u32,
    /// How often its source would still take this tap again, should this record be of no use.
    pub retakes_left: u32,
    /// Keeps the layout free of padding.
    pub reserved: u32,
    /// Kinds and scales of the channels in use.
    pub channels: [ChannelHeader; CHANNELS_MAX],
}

impl TapHeader {
    /// Bytes of samples behind this header.
    pub fn payload_bytes(&self) -> usize {
        let format = SampleFormat::from_code(self.sample_format).map_or(0, SampleFormat::bytes);
        (self.channel_count as usize).saturating_mul(self.sample_count as usize).saturating_mul(format)
    }

    /// The channels in use, in the order of the samples; a code nobody knows ends the list.
    pub fn channels(&self) -> impl Iterator<Item = (Channel, f64)> + '_ {
        self.channels[..(self.channel_count as usize).min(CHANNELS_MAX)]
            .iter()
            .map_while(|c| Channel::from_code(c.code).map(|kind| (kind, c.unit_per_count)))
    }
}

/// Lanes needed to hold `bytes` bytes.
pub fn lanes_for(bytes: usize) -> usize {
    bytes.div_ceil(LANE_BYTES)
}

/// The samples of a record, in the format in which they lie in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples<'a> {
    /// Converter counts, planar.
    I16(&'a [i16]),
    /// Floating point, planar.
    F32(&'a [f32]),
}

impl<'a> Samples<'a> {
    /// The samples that `header` describes, seen in `lanes` without a copy.
    ///
    /// `None` when the header names an unknown format or more bytes than there are lanes.
    pub fn view(header: &TapHeader, lanes: &'a [Lane]) -> Option<Self> {
        let bytes = bytes_of(lanes).get(..header.payload_bytes())?;
        match SampleFormat::from_code(header.sample_format)? {
            SampleFormat::I16 => bytemuck::try_cast_slice(bytes).ok().map(Self::I16),
            SampleFormat::F32 => bytemuck::try_cast_slice(bytes).ok().map(Self::F32),
        }
    }

    /// The samples as bytes, in the machine's order.
    pub fn as_bytes(&self) -> &'a [u8] {
        match *self {
            Self::I16(s) => bytemuck::cast_slice(s),
            Self::F32(s) => bytemuck::cast_slice(s),
        }
    }
}

/// The bytes of `lanes`.
pub fn bytes_of(lanes: &[Lane]) -> &[u8] {
    bytemuck::cast_slice(lanes)
}

/// The bytes of `lanes`, writable.
pub fn bytes_of_mut(lanes: &mut [Lane]) -> &mut [u8] {
    bytemuck::cast_slice_mut(lanes)
}

/// The lanes as 16-bit samples, writable.
pub fn i16_of_mut(lanes: &mut [Lane]) -> &mut [i16] {
    bytemuck::cast_slice_mut(lanes)
}

/// The lanes as floating-point samples, writable.
pub fn f32_of_mut(lanes: &mut [Lane]) -> &mut [f32] {
    bytemuck::cast_slice_mut(lanes)
}

impl Stamped for TapHeader {
    fn stamp(&self) -> &Stamp {
        &self.stamp
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        &mut self.stamp
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(format: SampleFormat, channel_count: u32, sample_count: u32) -> TapHeader {
        TapHeader { sample_format: format.code(), channel_count, sample_count, ..TapHeader::default() }
    }

    /// Law 3. Catches a view that copies, starts elsewhere, or takes the padding for samples.
    #[test]
    fn samples_are_seen_where_they_lie() {
        let mut lanes = vec![Lane::default(); lanes_for(2 * 33 * 2)];
        i16_of_mut(&mut lanes)[..66].copy_from_slice(&(0..66).collect::<Vec<i16>>());
        let Some(Samples::I16(samples)) = Samples::view(&header(SampleFormat::I16, 2, 33), &lanes) else {
            panic!("no view")
        };
        assert_eq!(samples, (0..66).collect::<Vec<i16>>());
        assert_eq!(samples.as_ptr().cast::<Lane>(), lanes.as_ptr());
        let Some(Samples::F32(samples)) = Samples::view(&header(SampleFormat::F32, 1, 3), &lanes) else {
            panic!("no view")
        };
        assert_eq!(samples.len(), 3);
    }

    #[test]
    fn a_header_that_promises_too_much_shows_nothing() {
        let lanes = vec![Lane::default(); 2];
        assert_eq!(Samples::view(&header(SampleFormat::I16, 2, 33), &lanes), None);
        assert_eq!(Samples::view(&TapHeader { sample_format: 9, ..header(SampleFormat::I16, 1, 1) }, &lanes), None);
        let huge = header(SampleFormat::F32, u32::MAX, u32::MAX);
        assert_eq!(Samples::view(&huge, &lanes), None, "and does not overflow");
        assert_eq!(huge.channels().count(), 0);
    }

    /// Samples must begin at the start of a cache line, and a lane must be one.
    #[test]
    fn a_lane_is_a_cache_line() {
        assert_eq!((size_of::<Lane>(), align_of::<Lane>()), (LANE_BYTES, LANE_BYTES));
        assert_eq!((lanes_for(0), lanes_for(1), lanes_for(64), lanes_for(65)), (0, 1, 1, 2));
    }
}
