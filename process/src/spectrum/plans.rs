//! Powers of a signal's bins. Each length has its transform planned once.

use std::any::Any;
use std::cmp::Ordering;
use std::f64::consts::TAU;
use std::fmt;

use num_complex::Complex;

#[cfg(target_arch = "x86_64")]
use super::avx512::Lanes;
use super::transform::{Rustfft, Transform};
use crate::Real;
use crate::signal::wide::{Kernel, may_use_avx512};

/// Lengths whose plans are kept: more than one line uses, and a bound on memory.
const PLANS_MAX: usize = 8;

/// The transform of `count` samples. An even number of them is transformed as half as many complex numbers, of two
/// samples each.
struct Plan<T> {
    count: usize,
    transform: Box<dyn Transform<T>>,
    /// exp(-2 pi i k/n)/2 for the bins k from 0 Hz to the Nyquist frequency, which untangle the bins of an even number.
    twiddles: Vec<Complex<T>>,
    /// The samples of an odd number as complex numbers.
    complex: Vec<Complex<T>>,
    /// The first bins, as many as are needed, and as many of the last; those in between are not used.
    transformed: Vec<Complex<T>>,
    powers: Vec<f64>,
}

/// Transforms signals of any length; keeps the plans of the most recent lengths.
pub(super) struct Plans<T> {
    /// Most recently used last.
    plans: Vec<Plan<T>>,
}

impl<T> fmt::Debug for Plans<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Plans").field("plan_count", &self.plans.len()).finish()
    }
}

impl<T: Real> Plans<T> {
    pub(super) fn new() -> Self {
        Self { plans: Vec::with_capacity(PLANS_MAX) }
    }

    /// |X|^2 of the first `bin_count` bins of `signal`, from 0 Hz on, none beyond the Nyquist frequency. Overwrites the
    /// signal.
    ///
    /// `realfft` could do this, but it untangles all bins, of which the bands hold an eighth.
    pub(super) fn powers(&mut self, signal: &mut [T], bin_count: usize) -> &mut [f64] {
        self.plan(signal.len()).powers(signal, bin_count)
    }

    fn plan(&mut self, count: usize) -> &mut Plan<T> {
        match self.plans.iter().position(|plan| plan.count == count) {
            Some(at) => self.plans[at..].rotate_left(1),
            None => {
                if self.plans.len() >= PLANS_MAX {
                    self.plans.remove(0);
                }
                self.plans.push(Plan::new(count));
            }
        }
        let last = self.plans.len() - 1;
        &mut self.plans[last]
    }
}

impl<T: Real> Plan<T> {
    fn new(count: usize) -> Self {
        let is_even = count.is_multiple_of(2);
        let length = length_of(count);
        let zeros = |length: usize| vec![Complex::new(T::zero(), T::zero()); length];
        Self {
            count,
            twiddles: if is_even { twiddles(count) } else { Vec::new() },
            complex: if is_even { Vec::new() } else { zeros(length) },
            transformed: zeros(length + 1),
            transform: plan(length),
            powers: Vec::new(),
        }
    }

    fn powers(&mut self, signal: &mut [T], bin_count: usize) -> &mut [f64] {
        let Self { transform, twiddles, complex, transformed, powers, .. } = self;
        let is_even = !twiddles.is_empty();
        let given: &mut [Complex<T>] = match is_even {
            // Samples 0 and 1 are one complex number, 2 and 3 the next, and so on.
            true => bytemuck::cast_slice_mut(signal),
            false => {
                complex.iter_mut().zip(&*signal).for_each(|(to, &x)| *to = Complex::new(x, T::zero()));
                complex
            }
        };
        let length = given.len();
        transform.forward(given, &mut transformed[..length], bin_count);
        // The transform is periodic: after its last bin comes its first.
        transformed[length] = transformed[0];
        powers.resize(bin_count, 0.0);
        match is_even {
            true => Untangle { halves: transformed, twiddles, powers }.wide(),
            false => powers.iter_mut().zip(transformed).for_each(|(power, bin)| *power = power_of(bin.re, bin.im)),
        }
        powers
    }
}

/// Number of complex numbers that `count` samples are transformed as.
fn length_of(count: usize) -> usize {
    if count.is_multiple_of(2) { count / 2 } else { count }
}

/// The twiddles of an even `count`; those beyond half the Nyquist frequency mirror the others bit for bit.
fn twiddles<T: Real>(count: usize) -> Vec<Complex<T>> {
    let half = T::rounded(0.5);
    let twiddle = |bin: usize| {
        let angle = -TAU / count as f64 * bin as f64;
        Complex::new(T::rounded(angle.cos()) * half, T::rounded(angle.sin()) * half)
    };
    let of_bin = |bin: usize| match (4 * bin).cmp(&count) {
        Ordering::Less => twiddle(bin),
        Ordering::Equal => Complex::new(T::zero(), -half),
        Ordering::Greater => {
            let image = twiddle(count / 2 - bin);
            Complex::new(-image.re, image.im)
        }
    };
    (0..=count / 2).map(of_bin).collect()
}

/// |X_k|^2 of the signal whose pairs of samples have the transform Z = `halves`. With E and O the transforms of the
/// even and odd samples, Z = E + iO and X_k = E_k + exp(-2 pi i k/n) O_k; E and O can be separated because the samples
/// are real.
struct Untangle<'a, T> {
    halves: &'a [Complex<T>],
    twiddles: &'a [Complex<T>],
    powers: &'a mut [f64],
}

impl<T: Real> Kernel for Untangle<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { halves, twiddles, powers } = self;
        let half = T::rounded(0.5);
        for (((power, z), image), w) in powers.iter_mut().zip(halves).zip(halves.iter().rev()).zip(twiddles) {
            let (sum_re, sum_im) = (z.re + image.re, z.im + image.im);
            let (diff_re, diff_im) = (z.re - image.re, z.im - image.im);
            let re = half * sum_re + (sum_im * w.re + diff_re * w.im);
            let im = half * diff_im + (sum_im * w.im - diff_re * w.re);
            *power = power_of(re, im);
        }
    }
}

#[inline(always)]
fn power_of<T: Real>(re: T, im: T) -> f64 {
    let (re, im) = (re.widened(), im.widened());
    re * re + im * im
}

/// The fastest transform of `length` numbers: our own for powers of two from 1024 on in single precision, where the
/// thread may use AVX-512, and `rustfft` everywhere else.
fn plan<T: Real>(length: usize) -> Box<dyn Transform<T>> {
    let own = if may_use_avx512() { single_precision(length) } else { None };
    // Ours is for `f32`; the downcast fails for another `T`.
    let own = own.map(|own| Box::new(own) as Box<dyn Any>);
    match own.and_then(|own| own.downcast::<Box<dyn Transform<T>>>().ok()) {
        Some(own) => *own,
        None => Box::new(Rustfft::new(length)),
    }
}

/// Our own transform of `length` numbers in single precision; `None` where there is none.
#[cfg(target_arch = "x86_64")]
fn single_precision(length: usize) -> Option<Box<dyn Transform<f32>>> {
    Some(Box::new(Lanes::try_new(length)?))
}

/// Other processors have none.
#[cfg(not(target_arch = "x86_64"))]
fn single_precision(_length: usize) -> Option<Box<dyn Transform<f32>>> {
    None
}

#[cfg(test)]
mod tests {
    use realfft::RealFftPlanner;
    use tapline_testing::noise::Noise;

    use super::*;
    use crate::without_avx512;

    fn signal<T: Real>(count: usize) -> Vec<T> {
        (0..count).map(|i| T::rounded(((i * i) % 17) as f64 - 0.1 * (i % 5) as f64)).collect()
    }

    /// Catches a cache without bound, and a plan used for another length.
    #[test]
    fn plans_are_kept_and_bounded() {
        let mut plans = Plans::<f64>::new();
        for count in (100..130).chain([129, 100, 128]) {
            let kept = plans.powers(&mut signal(count), 40).to_vec();
            assert_eq!(kept, Plans::<f64>::new().powers(&mut signal(count), 40));
            assert!(plans.plans.len() <= PLANS_MAX);
        }
        let kept: Vec<usize> = plans.plans.iter().map(|plan| plan.count).collect();
        assert_eq!(kept, [123, 124, 125, 126, 127, 129, 100, 128]);
    }

    /// Catches a bin untangled wrongly, for any length, even and odd: the twin is `realfft`, bit for bit.
    #[test]
    fn powers_like_realfft() {
        fn check<T: Real>(count: usize) {
            without_avx512(true);
            let signal: Vec<T> = signal(count);
            let fft = RealFftPlanner::new().plan_fft_forward(count);
            let mut bins = fft.make_output_vec();
            fft.process(&mut signal.clone(), &mut bins).unwrap();
            for bin_count in [bins.len(), bins.len() / 3] {
                let expected: Vec<f64> = bins[..bin_count].iter().map(|bin| power_of(bin.re, bin.im)).collect();
                let mut plan = Plan::new(count);
                assert_eq!(plan.powers(&mut signal.clone(), bin_count), expected, "{count}");
            }
        }
        for count in (1..70).chain([96, 100, 127, 128, 1000, 1023, 1026, 4096, 16_384]) {
            check::<f32>(count);
            check::<f64>(count);
        }
        without_avx512(false);
    }

    /// Catches a bin that our own transform leaves out, for every number of bins: the powers of noise in single
    /// precision are those in double precision.
    #[test]
    fn powers_of_both_precisions() {
        fn noise<T: Real>(count: usize) -> Vec<T> {
            let mut noise = Noise(12_345);
            let random = || T::rounded(f64::from((noise.uniform() - 0.5) as f32));
            std::iter::repeat_with(random).take(count).collect()
        }
        for count in [2048, 4096, 16_384, 32_768] {
            for bin_count in [1, 2, count / 14, count / 4, count / 2, count / 2 + 1] {
                let expected = Plans::<f64>::new().powers(&mut noise(count), bin_count).to_vec();
                let mut plans = Plans::<f32>::new();
                let found = plans.powers(&mut noise(count), bin_count);
                for (bin, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    // Compares amplitudes relative to the greatest, because one bin of noise may be next to nothing.
                    let error = (found.sqrt() - expected.sqrt()).abs() / (count as f64 / 12.0).sqrt();
                    assert!(error < 1e-5, "bin {bin} of {count}: {found} {expected}");
                }
            }
        }
    }
}
