//! One tap as it crosses shared memory: a header, and samples in place behind it.

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::{RecordKind, Stamp, Stamped, TapId};

/// Most channels a record can have.
pub const CHANNELS_MAX: usize = 4;

/// Bytes of a [`CacheLine`].
pub const CACHE_LINE_BYTES: usize = 64;

/// The unit of sample memory, one cache line: samples start aligned for SIMD loads.
#[repr(C)]
#[repr(align(64))]
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable, ZeroCopySend)]
pub struct CacheLine([u8; CACHE_LINE_BYTES]);

impl Default for CacheLine {
    fn default() -> Self {
        Self([0; CACHE_LINE_BYTES])
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

coded!(Channel: u32, Force = 1, Sound = 2);
named!(Channel, Force = "force", Sound = "sound");

impl Channel {
    /// Both of them.
    pub const BOTH: [Self; 2] = [Self::Force, Self::Sound];
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

coded!(SampleFormat: u32, I16 = 1, F32 = 2);
named!(SampleFormat, I16 = "i16", F32 = "f32");

impl SampleFormat {
    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::F32 => 4,
        }
    }
}

/// Where a tap came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SourceKind {
    /// The simulated tyre.
    Simulated,
    /// A folder of recordings.
    TapSet,
    /// A device that records live.
    Captured,
}

coded!(SourceKind: u32, Simulated = 1, TapSet = 2, Captured = 3);
named!(SourceKind, Simulated = "simulated", TapSet = "tap set", Captured = "captured");

/// Kind and scale of one channel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
pub struct ChannelHeader {
    /// [`Channel::code`], 0 where there is no channel.
    pub code: u32,
    /// Keeps the layout free of padding.
    pub reserved: u32,
    /// The value of a count in the unit of the channel, such as N, V or Pa: a stored sample times this is the physical value.
    pub unit_per_count: f64,
}

/// Everything about a tap except its samples.
///
/// Samples are planar, `[channel][sample]`, `channel_count * sample_count` of them, as the converter gave them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("tapline.TapHeader.v3")]
pub struct TapHeader {
    /// Which record of which publisher this is; `stamp.kind` says whether it is a tap at all.
    pub stamp: Stamp,
    /// Name of the tap.
    pub id: TapId,
    /// Row of the tap in the scan plan.
    pub plan_index: u32,
    /// When the impact happened, ns since the Unix epoch.
    pub tap_time_ns: i64,
    /// When the record was sent, ns on [`crate::monotonic_ns`]'s clock; telemetry, not part of any result.
    pub sent_ns: i64,
    /// Samples per second and channel.
    pub sample_rate_hz: f64,
    /// Impact velocity as measured in m/s, NaN where it was not.
    pub velocity_measured_m_per_s: f64,
    /// Nominal impact velocity, [`crate::Plan::velocity_nominal_m_per_s`]; NaN where the plan has none.
    pub velocity_nominal_m_per_s: f64,
    /// Distance D from impact to microphone in m, 0 where it was not given.
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
    /// How many more times the source can take this tap again if the record is unusable.
    pub retakes_left: u32,
    /// Planned samples per channel, 0 if that is not known.
    pub planned_sample_count: u32,
    /// Kinds and scales of the channels in use.
    pub channels: [ChannelHeader; CHANNELS_MAX],
}

impl TapHeader {
    /// The header of a tap of so many floating-point samples of each of `channels`, in their units. Its name and plan row are to be filled in.
    pub fn in_units(sample_rate_hz: f64, pre_trigger_samples: u32, sample_count: u32, channels: &[Channel]) -> Self {
        let mut header = Self {
            sample_rate_hz,
            pre_trigger_samples,
            sample_count,
            sample_format: SampleFormat::F32.code(),
            channel_count: u32::try_from(channels.len()).unwrap_or(u32::MAX),
            stamp: Stamp { kind: RecordKind::Data.code(), ..Stamp::default() },
            ..Self::default()
        };
        for (slot, channel) in header.channels.iter_mut().zip(channels) {
            *slot = ChannelHeader { code: channel.code(), unit_per_count: 1.0, ..ChannelHeader::default() };
        }
        header
    }

    /// Bytes of samples behind this header.
    pub fn payload_bytes(&self) -> usize {
        let format = SampleFormat::from_code(self.sample_format).map_or(0, SampleFormat::bytes);
        (self.channel_count as usize).saturating_mul(self.sample_count as usize).saturating_mul(format)
    }

    /// The channels in use, in the order of the samples; an unknown code ends the list.
    pub fn channels(&self) -> impl Iterator<Item = (Channel, f64)> + '_ {
        self.channels[..(self.channel_count as usize).min(CHANNELS_MAX)]
            .iter()
            .map_while(|c| Channel::from_code(c.code).map(|kind| (kind, c.unit_per_count)))
    }
}

/// Cache lines needed to hold `bytes` bytes.
pub fn cache_lines_for(bytes: usize) -> usize {
    bytes.div_ceil(CACHE_LINE_BYTES)
}

/// The samples of a record, in the format of the converter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples<'a> {
    /// Converter counts, planar.
    I16(&'a [i16]),
    /// Floating point, planar.
    F32(&'a [f32]),
}

impl<'a> Samples<'a> {
    /// The samples that `header` describes, in place in `buffer`.
    ///
    /// `None` if the header names an unknown format, or more bytes than `buffer` holds.
    pub fn view(header: &TapHeader, buffer: &'a [CacheLine]) -> Option<Self> {
        let bytes = bytes_of(buffer).get(..header.payload_bytes())?;
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

/// `buffer` as bytes.
pub fn bytes_of(buffer: &[CacheLine]) -> &[u8] {
    bytemuck::cast_slice(buffer)
}

/// `buffer` as writable bytes.
pub fn bytes_of_mut(buffer: &mut [CacheLine]) -> &mut [u8] {
    bytemuck::cast_slice_mut(buffer)
}

/// `buffer` as writable 16-bit samples.
pub fn i16_of_mut(buffer: &mut [CacheLine]) -> &mut [i16] {
    bytemuck::cast_slice_mut(buffer)
}

/// `buffer` as writable floating-point samples.
pub fn f32_of_mut(buffer: &mut [CacheLine]) -> &mut [f32] {
    bytemuck::cast_slice_mut(buffer)
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
    fn samples_are_viewed_in_place() {
        let mut buffer = vec![CacheLine::default(); cache_lines_for(2 * 33 * 2)];
        i16_of_mut(&mut buffer)[..66].copy_from_slice(&(0..66).collect::<Vec<i16>>());
        let Some(Samples::I16(samples)) = Samples::view(&header(SampleFormat::I16, 2, 33), &buffer) else {
            panic!("no view")
        };
        assert_eq!(samples, (0..66).collect::<Vec<i16>>());
        assert_eq!(samples.as_ptr().cast::<CacheLine>(), buffer.as_ptr());
        let Some(Samples::F32(samples)) = Samples::view(&header(SampleFormat::F32, 1, 3), &buffer) else {
            panic!("no view")
        };
        assert_eq!(samples.len(), 3);
    }

    #[test]
    fn a_header_that_promises_too_much_shows_nothing() {
        let buffer = vec![CacheLine::default(); 2];
        assert_eq!(Samples::view(&header(SampleFormat::I16, 2, 33), &buffer), None);
        assert_eq!(Samples::view(&TapHeader { sample_format: 9, ..header(SampleFormat::I16, 1, 1) }, &buffer), None);
        let huge = header(SampleFormat::F32, u32::MAX, u32::MAX);
        assert_eq!(Samples::view(&huge, &buffer), None, "and does not overflow");
        assert_eq!(huge.channels().count(), 0);
    }

    /// Catches samples that do not begin at the start of a cache line.
    #[test]
    fn a_cache_line_has_its_size_and_alignment() {
        assert_eq!((size_of::<CacheLine>(), align_of::<CacheLine>()), (CACHE_LINE_BYTES, CACHE_LINE_BYTES));
        assert_eq!((cache_lines_for(0), cache_lines_for(1), cache_lines_for(64), cache_lines_for(65)), (0, 1, 1, 2));
    }
}
