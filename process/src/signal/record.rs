//! The channels of one record, located in its samples and checked once.

use std::ops::AddAssign;

use bytemuck::Pod;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;
use tapline_wire::{CHANNELS_MAX, Channel, TapHeader};

use crate::Real;

/// A sample as the converter gave it.
pub(crate) trait Count: Copy + PartialOrd + Into<f64> {
    /// Standard deviation of the converter's own rounding, in counts; 0 if it is not known.
    const ROUNDING_COUNTS: f64;
    /// Whether samples need a gain lest their squares overflow or underflow in `f32`.
    const NEEDS_GAIN: bool;
    /// Whether the sample is a number.
    fn is_number(self) -> bool;
    /// Whether the sample is at the end of the converter's range, as far as the format shows.
    fn is_rail(self) -> bool;
    /// The mean of eight samples, in single precision.
    fn mean_of(eight: [Self; 8]) -> f32;
    /// Whether four samples are one value.
    fn are_equal(four: [Self; 4]) -> bool;
    /// Integers that order as samples do, and as their distances from a base do; what is not a number is the least or the largest.
    type Key: Key;
    /// The key of the sample.
    fn key(self) -> Self::Key;
    /// The sample that has the key `key`.
    fn from_key(key: Self::Key) -> Self;
    /// The key of |sample - `base`|, `base` being a median of samples.
    fn distance_key(self, base: f64) -> Self::Key;
    /// The distance from `base` that has the key `key`.
    fn from_distance_key(key: Self::Key, base: f64) -> f64;
    /// (sample - `base`) * `gain`, rounded once; `gain` is a power of two, and 1 if none is needed.
    fn centred<T: Real>(self, base: f64, gain: f64) -> T;
}

/// An integer type of keys, and how many keys one of its kind can count.
pub(crate) trait Key: Copy + Ord + Pod + From<bool> + AddAssign + Into<i64> + TryFrom<i64> {
    /// The greatest of its kind.
    const MAX: usize;
    /// For each of the values `at`, how many `keys` do not exceed it.
    ///
    /// A mask has a bit for each key of a vector, and one instruction counts them, where lanes have to be added up.
    #[cfg(target_arch = "x86_64")]
    fn counts(simd: V4, keys: &[Self], at: [Self; 3]) -> [usize; 3];
}

macro_rules! key {
    ($key:ty, $lanes:literal, $splat:ident, $is_at_most:ident) => {
        impl Key for $key {
            const MAX: usize = <$key>::MAX as usize;
            #[cfg(target_arch = "x86_64")]
            #[inline(always)]
            fn counts(simd: V4, keys: &[Self], at: [Self; 3]) -> [usize; 3] {
                let (rows, rest) = keys.as_chunks::<$lanes>();
                let mut counts = at.map(|at| rest.iter().map(|&key| usize::from(key <= at)).sum());
                let at = at.map(|at| simd.$splat(at));
                for &row in rows {
                    for (count, at) in counts.iter_mut().zip(at) {
                        *count += simd.$is_at_most(bytemuck::cast(row), at).0.count_ones() as usize;
                    }
                }
                counts
            }
        }
    };
}

key!(i16, 32, splat_i16x32, cmp_le_i16x32);
key!(i32, 16, splat_i32x16, cmp_le_i32x16);

impl Count for i16 {
    type Key = i16;
    const ROUNDING_COUNTS: f64 = 0.288_675_134_594_812_9; // 1/sqrt(12)
    const NEEDS_GAIN: bool = false;
    fn is_number(self) -> bool {
        true
    }
    fn is_rail(self) -> bool {
        // Twelve bits, left-justified, end at 32752.
        self >= i16::MAX - 15 || self <= i16::MIN + 15
    }
    #[inline(always)]
    fn mean_of(eight: [Self; 8]) -> f32 {
        // Exact. Counts are shifted to 0..=65535, so that no sum carries into the other half of its word.
        let words: [u64; 2] = bytemuck::cast(eight);
        let [a, b] = words.map(|word| {
            let word = word ^ 0x8000_8000_8000_8000;
            (word & 0x0000_FFFF_0000_FFFF) + ((word >> 16) & 0x0000_FFFF_0000_FFFF)
        });
        let sum = a + b;
        let sum = (sum as u32 + (sum >> 32) as u32) as i32 - 8 * 0x8000;
        sum as f32 / 8.0
    }
    fn are_equal(four: [Self; 4]) -> bool {
        let word: u64 = bytemuck::cast(four);
        word == word.rotate_left(Self::BITS)
    }
    fn key(self) -> i16 {
        self
    }
    fn from_key(key: i16) -> Self {
        key
    }
    fn distance_key(self, base: f64) -> i16 {
        // A base of half a count is half a count from every sample; the key is the distance without it. From 0 to 65535, so
        // that no distance overflows; one of the differences is 0.
        let unsigned = |count: i16| count.cast_unsigned() ^ 0x8000;
        let floor = base.floor();
        let (count, floor, half) = (unsigned(self), unsigned(floor as i16), u16::from(base > floor));
        let distance = count.saturating_sub(floor + half) | floor.saturating_sub(count);
        (distance ^ 0x8000).cast_signed()
    }
    fn from_distance_key(key: i16, base: f64) -> f64 {
        f64::from(key.cast_unsigned() ^ 0x8000) + base.fract().abs()
    }
    fn centred<T: Real>(self, base: f64, _gain: f64) -> T {
        // The median of 16-bit counts is a whole or half count, so this is exact in f32 too.
        T::rounded(f64::from(self)) - T::rounded(base)
    }
}

impl Count for f32 {
    type Key = i32;
    const ROUNDING_COUNTS: f64 = 0.0;
    const NEEDS_GAIN: bool = true;
    fn is_number(self) -> bool {
        self.is_finite()
    }
    fn is_rail(self) -> bool {
        false
    }
    #[inline(always)]
    fn mean_of([a, b, c, d, e, f, g, h]: [Self; 8]) -> f32 {
        (((a + e) + (b + f)) + ((c + g) + (d + h))) / 8.0
    }
    fn are_equal([a, b, c, d]: [Self; 4]) -> bool {
        // As bits, which a channel that stands still repeats.
        (a.to_bits() == b.to_bits()) & (b.to_bits() == c.to_bits()) & (c.to_bits() == d.to_bits())
    }
    fn key(self) -> i32 {
        in_order(self.to_bits() as i32)
    }
    fn distance_key(self, base: f64) -> i32 {
        ((f64::from(self) - base).abs() as f32).key()
    }
    fn from_key(key: i32) -> Self {
        Self::from_bits(in_order(key) as u32)
    }
    fn from_distance_key(key: i32, _base: f64) -> f64 {
        f64::from(Self::from_key(key))
    }
    fn centred<T: Real>(self, base: f64, gain: f64) -> T {
        // In double precision, because an offset of many times the signal would cost it digits.
        T::rounded((f64::from(self) - base) * gain)
    }
}

/// The bits of an `f32`, changed so that they are ordered as `f32::total_cmp` orders; applying it twice gives them
/// back.
fn in_order(bits: i32) -> i32 {
    // Flips all bits but the sign of a negative number.
    bits ^ ((bits >> 31) as u32 >> 1) as i32
}

/// Samples of one channel with their scale: newtons or volts per count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Track<'a, C> {
    pub samples: &'a [C],
    pub unit_per_count: f64,
}

/// A record whose header and samples agree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Record<'a, C> {
    pub sample_rate_hz: f64,
    pub pre_trigger_samples: usize,
    pub force: Option<Track<'a, C>>,
    pub sound: Option<Track<'a, C>>,
}

impl<'a, C: Count> Record<'a, C> {
    /// The first `used` samples of the first force channel and of the first sound channel of `samples`, which are
    /// planar as `header` says. `None` if the header does not describe these samples or gives no rate.
    pub(crate) fn new(header: &TapHeader, used: u32, samples: &'a [C]) -> Option<Self> {
        let count = header.sample_count as usize;
        let is_whole = header.channel_count as usize <= CHANNELS_MAX
            && count > 0
            && samples.len() == header.channel_count as usize * count;
        let has_rate = header.sample_rate_hz.is_finite() && header.sample_rate_hz > 0.0;
        if !is_whole || !has_rate {
            return None;
        }
        let used = count.min(used as usize);
        let track = |which| {
            let of_channel = header.channels().zip(samples.chunks_exact(count).map(|samples| &samples[..used]));
            of_channel
                .filter(|((kind, _), _)| *kind == which)
                .map(|((_, unit_per_count), samples)| Track { samples, unit_per_count })
                .next()
        };
        Some(Self {
            sample_rate_hz: header.sample_rate_hz,
            pre_trigger_samples: header.pre_trigger_samples as usize,
            force: track(Channel::Force),
            sound: track(Channel::Sound),
        })
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::ChannelHeader;

    use super::*;

    fn header(codes: &[u32], sample_count: u32) -> TapHeader {
        let mut header =
            TapHeader { sample_rate_hz: 1.0, sample_count, channel_count: codes.len() as u32, ..TapHeader::default() };
        for (slot, &code) in header.channels.iter_mut().zip(codes) {
            *slot = ChannelHeader { code, unit_per_count: 2.0, reserved: 0 };
        }
        header
    }

    /// Catches a channel found by position instead of by kind, and a wrong stride.
    #[test]
    fn channels_by_kind() {
        let samples = [1_i16, 2, 3, 4, 5, 6];
        let record = Record::new(&header(&[2, 1], 3), 3, &samples).unwrap();
        assert_eq!(record.sound.unwrap().samples, [1, 2, 3]);
        assert_eq!(record.force.unwrap().samples, [4, 5, 6]);
        let short = Record::new(&header(&[2, 1], 3), 2, &samples).unwrap();
        assert_eq!((short.sound.unwrap().samples, short.force.unwrap().samples), (&[1_i16, 2][..], &[4_i16, 5][..]));
        let silent = Record::new(&header(&[1], 6), 6, &samples).unwrap();
        assert!(silent.sound.is_none() && silent.force.is_some());
    }

    /// Catches a slice that trusts the header.
    #[test]
    fn mismatch_is_refused() {
        let samples = [0_i16; 6];
        assert!(Record::new(&header(&[1, 2], 4), 4, &samples).is_none());
        assert!(Record::new(&header(&[1], 4), 4, &samples).is_none());
        assert!(Record::new(&header(&[1, 2], 0), 0, &[] as &[i16]).is_none());
        let many = TapHeader { channel_count: 6, sample_count: 1, ..header(&[], 1) };
        assert!(Record::new(&many, 1, &samples).is_none());
        for sample_rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Record::new(&TapHeader { sample_rate_hz, ..header(&[1], 6) }, 6, &samples).is_none());
        }
    }
}
