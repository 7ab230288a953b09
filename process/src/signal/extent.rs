//! The smallest and the largest sample of a channel, and where they are.

use crate::signal::record::Count;
use crate::signal::wide::Kernel;

/// Smallest and largest of the samples of a channel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extent<C> {
    pub least: C,
    pub largest: C,
    /// Where every smallest sample lies, and every largest one.
    least_in: Span,
    largest_in: Span,
}

/// Samples from one number to before another.
#[derive(Debug, Clone, Copy)]
struct Span {
    from: usize,
    to: usize,
}

impl<C: Count> Extent<C> {
    /// The extent of `samples`; `None` when there is none or one is not a number.
    pub(crate) fn find(samples: &[C]) -> Option<Self> {
        Whole { samples }.wide()
    }

    /// Whether all samples are the same.
    pub(crate) fn is_constant(&self) -> bool {
        self.least == self.largest
    }

    /// Index of the first of `samples`, from number `from` on, that equals `level`: the smallest, or the largest.
    pub(crate) fn position(&self, samples: &[C], level: C, from: usize) -> Option<usize> {
        let Span { from: begin, to } = if level == self.largest { self.largest_in } else { self.least_in };
        let from = if from > begin { from } else { begin };
        First { samples: samples.get(from..to)?, level }.wide().map(|at| from + at)
    }

    /// Power of two that brings every |sample - `base`| below 2, and the largest of them to at least 1, so that no
    /// square overflows or underflows in `f32`. It is 1 if all samples equal `base`.
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

/// Samples that are compared together.
const STRETCH: usize = 96;

struct First<'a, C> {
    samples: &'a [C],
    level: C,
}

impl<C: Count> Kernel for First<'_, C> {
    type Output = Option<usize>;

    #[inline(always)]
    fn run(self) -> Option<usize> {
        let Self { samples, level } = self;
        let (stretches, rest) = samples.as_chunks::<STRETCH>();
        for (number, stretch) in stretches.iter().enumerate() {
            let mut touches = false;
            for &x in stretch {
                touches |= x == level;
            }
            if touches {
                // Without a branch, so that the compiler can use vectors.
                let mut first = STRETCH as u16;
                for (place, &x) in (0..).zip(stretch) {
                    let place = if x == level { place } else { STRETCH as u16 };
                    first = if place < first { place } else { first };
                }
                return Some(number * STRETCH + usize::from(first));
            }
        }
        rest.iter().position(|&x| x == level).map(|at| samples.len() - rest.len() + at)
    }
}

/// The least and the largest of the samples so far, by their keys: integers, of which the compiler finds the extremes in vectors. What
/// is not a number has the least key or the largest, and -0 is below 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extremes<C: Count> {
    least: C::Key,
    largest: C::Key,
    least_in: Span,
    largest_in: Span,
}

impl<C: Count> Extremes<C> {
    /// The extremes of a record's first sample.
    pub(crate) fn of(first: C) -> Self {
        let span = Span { from: 0, to: 1 };
        Self { least: first.key(), largest: first.key(), least_in: span, largest_in: span }
    }

    /// Looks at more `samples`, the first of which has number `from`.
    #[inline(always)]
    pub(crate) fn add(&mut self, from: usize, samples: &[C]) {
        let Some(first) = samples.first() else { return };
        let (mut least, mut largest) = (first.key(), first.key());
        for x in samples {
            least = least.min(x.key());
            largest = largest.max(x.key());
        }
        let to = from + samples.len();
        if least < self.least {
            (self.least, self.least_in) = (least, Span { from, to });
        } else if least == self.least {
            self.least_in.to = to;
        }
        if largest > self.largest {
            (self.largest, self.largest_in) = (largest, Span { from, to });
        } else if largest == self.largest {
            self.largest_in.to = to;
        }
    }

    /// The extent; `None` when a sample is not a number.
    #[inline(always)]
    pub(crate) fn extent(&self) -> Option<Extent<C>> {
        let Self { least_in, largest_in, .. } = *self;
        let extent =
            Extent { least: C::from_key(self.least), largest: C::from_key(self.largest), least_in, largest_in };
        (extent.least.is_number() && extent.largest.is_number()).then_some(extent)
    }
}

/// Samples whose extremes are found together: so few are searched for them later.
const SPAN: usize = 512;

struct Whole<'a, C> {
    samples: &'a [C],
}

impl<C: Count> Kernel for Whole<'_, C> {
    type Output = Option<Extent<C>>;

    #[inline(always)]
    fn run(self) -> Option<Extent<C>> {
        let mut extremes = Extremes::of(*self.samples.first()?);
        for (number, samples) in self.samples.chunks(SPAN).enumerate() {
            extremes.add(number * SPAN, samples);
        }
        extremes.extent()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extremes_of(samples: &[f32]) -> Option<(f32, f32)> {
        Extent::find(samples).map(|extent| (extent.least, extent.largest))
    }

    /// Catches a sample that is left out, and one that is no number: the extreme at every place of every short length.
    #[test]
    fn extent_finds_every_place() {
        for count in 1..100 {
            for place in 0..count {
                let mut samples = vec![0.5_f32; count];
                let (least, largest) = if count > 1 { (0.5, 0.5) } else { (7.0, -7.0) };
                samples[place] = 7.0;
                assert_eq!(extremes_of(&samples), Some((least, 7.0)));
                samples[place] = -7.0;
                assert_eq!(extremes_of(&samples), Some((-7.0, largest)));
                samples[place] = f32::NAN;
                assert!(Extent::find(&samples).is_none());
                samples[place] = f32::NEG_INFINITY;
                assert!(Extent::find(&samples).is_none());
            }
        }
        assert!(Extent::<i16>::find(&[]).is_none());
    }

    /// Catches an exponent off by one, and a gain that overflows for the smallest and largest samples.
    #[test]
    fn gain_brings_the_peak_to_one() {
        for (least, largest, base) in [(-1.0_f32, 3.0, 0.5), (f32::MIN, f32::MAX, 0.0), (0.0, f32::from_bits(1), 0.0)] {
            let gain = Extent::find(&[least, largest]).unwrap().gain(base);
            let peak = (f64::from(largest) - base) * gain;
            assert!((1.0..2.0).contains(&peak), "{largest}: {peak}");
        }
        assert!((Extent::find(&[4_i16, 4]).unwrap().gain(4.0) - 1.0).abs() < 1e-15);
    }

    /// Catches a stretch left out, the wrong place in it, a place before the one to begin at, and one that comes again far behind.
    #[test]
    fn places_like_a_walk() {
        for count in [2, 5, 191, 192, 193, 400, 1000, 1600] {
            for place in (0..count).step_by(7).chain([count - 1]) {
                for (height, again) in [(9, place), (9, (place + count) / 2), (-9, count - 1)] {
                    let mut samples = vec![0_i16; count];
                    (samples[place], samples[again]) = (height, height);
                    let floats: Vec<f32> = samples.iter().map(|&x| f32::from(x)).collect();
                    let (of_counts, of_floats) = (Extent::find(&samples).unwrap(), Extent::find(&floats).unwrap());
                    for from in [0, place / 2, place, place + 1, count] {
                        let expected = [place, again].into_iter().find(|&place| place >= from);
                        assert_eq!(of_counts.position(&samples, height, from), expected);
                        assert_eq!(of_floats.position(&floats, f32::from(height), from), expected);
                    }
                }
            }
        }
    }
}
