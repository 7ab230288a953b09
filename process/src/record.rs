//! The channels of one record, found in its samples and looked over once.

use tapline_wire::{CHANNELS_MAX, Channel, TapHeader};

use crate::Real;
use crate::wide::Kernel;

/// A sample as the converter gave it.
pub(crate) trait Count: Copy + PartialOrd + Into<f64> {
    /// Standard deviation of the converter's own rounding, in counts; 0 where it is not known.
    const ROUNDING_COUNTS: f64;
    /// Whether the sample is a number.
    fn is_number(self) -> bool;
    /// Whether the sample is at the end of the converter's range, as far as the format tells.
    fn is_rail(self) -> bool;
    /// The sample in single precision, which holds it exactly.
    fn exact_f32(self) -> f32;
    /// An integer that orders as samples do.
    fn key(self) -> i32;
    /// The key of |sample - `base`|, `base` being a median of samples.
    fn distance_key(self, base: f64) -> i32;
    /// The counts of which `key` is the key.
    fn of_key(key: i32) -> f64;
    /// (sample - `base`) * `gain`, rounded once; `gain` is a power of two.
    fn centred<T: Real>(self, base: f64, gain: f64) -> T;
}

impl Count for i16 {
    const ROUNDING_COUNTS: f64 = 0.288_675_134_594_812_9; // 1/sqrt(12)
    fn is_number(self) -> bool {
        true
    }
    fn is_rail(self) -> bool {
        // Twelve bits, left-justified, end at 32752.
        self >= i16::MAX - 15 || self <= i16::MIN + 15
    }
    fn exact_f32(self) -> f32 {
        f32::from(self)
    }
    fn key(self) -> i32 {
        2 * i32::from(self) // the median may be half a count
    }
    fn distance_key(self, base: f64) -> i32 {
        (self.key() - (2.0 * base) as i32).abs()
    }
    fn of_key(key: i32) -> f64 {
        f64::from(key) / 2.0
    }
    fn centred<T: Real>(self, base: f64, gain: f64) -> T {
        // The median of 16-bit counts is a whole or half count, so that this is exact in f32 too.
        (T::rounded(f64::from(self.exact_f32())) - T::rounded(base)) * T::rounded(gain)
    }
}

impl Count for f32 {
    const ROUNDING_COUNTS: f64 = 0.0;
    fn is_number(self) -> bool {
        self.is_finite()
    }
    fn is_rail(self) -> bool {
        false
    }
    fn exact_f32(self) -> f32 {
        self
    }
    fn key(self) -> i32 {
        in_order(self.to_bits() as i32)
    }
    fn distance_key(self, base: f64) -> i32 {
        ((f64::from(self) - base).abs() as f32).key()
    }
    fn of_key(key: i32) -> f64 {
        f64::from(f32::from_bits(in_order(key) as u32))
    }
    fn centred<T: Real>(self, base: f64, gain: f64) -> T {
        // In double precision, or an offset of many times the signal would cost the signal its digits.
        T::rounded((f64::from(self) - base) * gain)
    }
}

/// The bits of an `f32` turned so that they order as `f32::total_cmp` does, and back.
fn in_order(bits: i32) -> i32 {
    // Of a negative number, all but the sign are turned.
    bits ^ ((bits >> 31) as u32 >> 1) as i32
}

/// Samples of one channel with their scale: newtons or volts per count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Track<'a, C> {
    pub(crate) samples: &'a [C],
    pub(crate) unit_per_count: f64,
}

/// A record whose header and samples agree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Record<'a, C> {
    pub(crate) sample_rate_hz: f64,
    pub(crate) pre_trigger_samples: usize,
    pub(crate) force: Option<Track<'a, C>>,
    pub(crate) sound: Option<Track<'a, C>>,
}

impl<'a, C: Count> Record<'a, C> {
    /// The first force and the first sound channel of `samples`, planar as `header` says; `None` when the
    /// header describes other samples than these or gives no rate.
    pub(crate) fn new(header: &TapHeader, samples: &'a [C]) -> Option<Self> {
        let count = header.sample_count as usize;
        let is_whole = header.channel_count as usize <= CHANNELS_MAX
            && count > 0
            && samples.len() == header.channel_count as usize * count;
        let has_rate = header.sample_rate_hz.is_finite() && header.sample_rate_hz > 0.0;
        if !is_whole || !has_rate {
            return None;
        }
        let track = |which| {
            let of_channel = header.channels().zip(samples.chunks_exact(count));
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

/// Smallest and largest of the samples of a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Extent<C> {
    pub(crate) least: C,
    pub(crate) largest: C,
}

impl<C: Count> Extent<C> {
    /// The extent of `samples`; `None` when there is none or one is not a number.
    pub(crate) fn of(samples: &[C]) -> Option<Self> {
        Extremes { samples }.wide()
    }

    /// Whether all samples are the same.
    pub(crate) fn is_constant(&self) -> bool {
        self.least == self.largest
    }

    /// Power of two that brings every |sample - `base`| below 2 and the largest of them to 1 or more, so that
    /// no square overflows or vanishes in `f32`; 1 when no sample differs from `base`.
    pub(crate) fn gain(&self, base: f64) -> f64 {
        let (below, above) = (base - self.least.into(), self.largest.into() - base);
        let peak = if below > above { below } else { above };
        if !peak.is_normal() {
            return 1.0;
        }
        let exponent = (peak.abs().to_bits() >> 52) as i32 - 1023;
        2.0_f64.powi(-exponent)
    }
}

/// Place of the first of `samples` that is `level`.
pub(crate) fn position<C: Count>(samples: &[C], level: C) -> Option<usize> {
    let first = Touched { samples, level, from: 0 }.wide()?;
    samples[first..].iter().position(|&x| x == level).map(|at| first + at)
}

/// Samples that [`Touched`] looks at together.
pub(crate) const STRETCH: usize = 192;

/// Where the first stretch of `samples` begins, from the one that begins at `from` on, in which one is at `level`.
pub(crate) struct Touched<'a, C> {
    pub(crate) samples: &'a [C],
    pub(crate) level: C,
    pub(crate) from: usize,
}

impl<C: Count> Kernel for Touched<'_, C> {
    type Output = Option<usize>;

    #[inline(always)]
    fn run(self) -> Option<usize> {
        let Self { samples, level, from } = self;
        let (stretches, rest) = samples.get(from..)?.as_chunks::<STRETCH>();
        for (number, stretch) in stretches.iter().enumerate() {
            let mut touches = false;
            for &x in stretch {
                touches |= x == level;
            }
            if touches {
                return Some(from + number * STRETCH);
            }
        }
        rest.iter().any(|&x| x == level).then_some(samples.len() - rest.len())
    }
}

/// The extent of `samples`; `None` when there is none or one is not a number.
struct Extremes<'a, C> {
    samples: &'a [C],
}

impl<C: Count> Kernel for Extremes<'_, C> {
    type Output = Option<Extent<C>>;

    #[inline(always)]
    fn run(self) -> Option<Extent<C>> {
        let samples = self.samples;
        const LANES: usize = 32;
        let first = *samples.first()?;
        let (mut least, mut largest, mut is_number) = ([first; LANES], [first; LANES], [true; LANES]);
        let mut rows = samples.chunks_exact(LANES);
        // Lanes, because a minimum of floats in one variable may not be reordered into SIMD.
        for row in rows.by_ref() {
            for lane in 0..LANES {
                let x = row[lane];
                least[lane] = if x < least[lane] { x } else { least[lane] };
                largest[lane] = if x > largest[lane] { x } else { largest[lane] };
                is_number[lane] &= x.is_number();
            }
        }
        let mut extent = Extent { least: first, largest: first };
        let mut is_sound = is_number.into_iter().all(|good| good);
        for &x in rows.remainder().iter().chain(&least).chain(&largest) {
            extent.least = if x < extent.least { x } else { extent.least };
            extent.largest = if x > extent.largest { x } else { extent.largest };
            is_sound &= x.is_number();
        }
        is_sound.then_some(extent)
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

    /// Catches a channel looked for by place instead of by kind, and a wrong stride.
    #[test]
    fn channels_by_kind() {
        let samples = [1_i16, 2, 3, 4, 5, 6];
        let record = Record::new(&header(&[2, 1], 3), &samples).unwrap();
        assert_eq!(record.sound.unwrap().samples, [1, 2, 3]);
        assert_eq!(record.force.unwrap().samples, [4, 5, 6]);
        let silent = Record::new(&header(&[1], 6), &samples).unwrap();
        assert!(silent.sound.is_none() && silent.force.is_some());
    }

    /// Catches a slice taken on trust in the header.
    #[test]
    fn mismatch_is_refused() {
        let samples = [0_i16; 6];
        assert!(Record::new(&header(&[1, 2], 4), &samples).is_none());
        assert!(Record::new(&header(&[1], 4), &samples).is_none());
        assert!(Record::new(&header(&[1, 2], 0), &[] as &[i16]).is_none());
        let many = TapHeader { channel_count: 6, sample_count: 1, ..header(&[], 1) };
        assert!(Record::new(&many, &samples).is_none());
        for sample_rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Record::new(&TapHeader { sample_rate_hz, ..header(&[1], 6) }, &samples).is_none());
        }
    }

    /// Catches a lane or a remainder that is not looked at: the extreme at every place of every short length.
    #[test]
    fn extent_finds_every_place() {
        for count in 1..100 {
            for place in 0..count {
                let mut samples = vec![0.5_f32; count];
                let (least, largest) = if count > 1 { (0.5, 0.5) } else { (7.0, -7.0) };
                samples[place] = 7.0;
                assert_eq!(Extent::of(&samples), Some(Extent { least, largest: 7.0 }));
                samples[place] = -7.0;
                assert_eq!(Extent::of(&samples), Some(Extent { least: -7.0, largest }));
                samples[place] = f32::NAN;
                assert!(Extent::of(&samples).is_none());
                samples[place] = f32::NEG_INFINITY;
                assert!(Extent::of(&samples).is_none());
            }
        }
        assert!(Extent::<i16>::of(&[]).is_none());
    }

    /// Catches an exponent off by one, and a gain that overflows for the smallest and largest samples.
    #[test]
    fn gain_brings_the_peak_to_one() {
        for (least, largest, base) in [(-1.0_f32, 3.0, 0.5), (f32::MIN, f32::MAX, 0.0), (0.0, f32::from_bits(1), 0.0)] {
            let gain = Extent { least, largest }.gain(base);
            let peak = (f64::from(largest) - base) * gain;
            assert!((1.0..2.0).contains(&peak), "{largest}: {peak}");
        }
        assert!((Extent { least: 4_i16, largest: 4 }.gain(4.0) - 1.0).abs() < 1e-15);
    }
}
