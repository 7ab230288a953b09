//! The sound's spectrum in the bands of the configuration: PR, P_f and E_f.
//!
//! The power spectral density is the one-sided boxcar periodogram of the whole record with its mean removed,
//! as `scipy.signal.periodogram(x, fs, window="boxcar", detrend="constant", scaling="density")` defines it.
//! The bin at 0 Hz is exactly 0: that is what removing the mean does to it.

use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};

use crate::Real;
use crate::real::sum_of;

/// Record lengths whose plans are kept: more than one line taps with, and a bound on memory.
const PLANS_MAX: usize = 8;

/// Edges of the two bands, Hz, each inside its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bands {
    pub(crate) f_c_hz: f64,
    pub(crate) f_hi_hz: f64,
    pub(crate) f_lo_hz: f64,
    pub(crate) f_top_hz: f64,
}

/// What the two bands hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BandPower {
    /// Power ratio PR.
    pub(crate) pr: f64,
    /// Largest density P_f, signal unit squared per Hz.
    pub(crate) p_f: f64,
    /// Energy E_f, signal unit squared.
    pub(crate) e_f: f64,
    /// Whether the flexural band holds so little of the record's power that rounding in `T` shows in it.
    pub(crate) is_faint: bool,
}

/// Share of the record's power below which a band's power is not the transform's to tell in single precision: rounding
/// spreads some 1e-14 of the whole over the bins, which is then no longer small beside 1e-4 of the band.
const FAINT: f64 = 1e-5;

struct Plan<T> {
    fft: Arc<dyn RealToComplex<T>>,
    bins: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

/// Transforms records of any length, keeping the plans of the lengths used last.
pub(crate) struct Spectrum<T> {
    /// Most recently used last.
    plans: Vec<Plan<T>>,
}

impl<T> fmt::Debug for Spectrum<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Spectrum").field("plan_count", &self.plans.len()).finish()
    }
}

impl<T: Real> Spectrum<T> {
    pub(crate) fn new() -> Self {
        Self { plans: Vec::with_capacity(PLANS_MAX) }
    }

    /// PR, P_f and E_f of `signal` at `sample_rate_hz`; destroys `signal`.
    ///
    /// `None` when a band holds no bin, or the lower one's reference no power.
    pub(crate) fn band_power(&mut self, signal: &mut [T], sample_rate_hz: f64, bands: &Bands) -> Option<BandPower> {
        let count = signal.len();
        let grid = Grid::new(count, sample_rate_hz);
        let flexural = grid.bins(bands.f_c_hz, bands.f_hi_hz)?;
        let reference = grid.bins(bands.f_lo_hz, bands.f_top_hz)?;
        let mean = T::rounded(sum_of(signal, |x| x) / count as f64);
        for x in signal.iter_mut() {
            *x -= mean;
        }
        let mean_square = sum_of(signal, |x| x * x) / count as f64;
        let plan = self.plan(count);
        // The lengths are the plan's own.
        plan.fft.process_with_scratch(signal, &mut plan.bins, &mut plan.scratch).ok()?;
        let in_flexural = grid.fold(&plan.bins, flexural);
        let in_reference = grid.fold(&plan.bins, reference);
        let has_power = in_reference.sum > 0.0;
        if !has_power {
            return None;
        }
        // |X|^2 / (fs N) is a density, V^2/Hz (Eq. 50).
        let density = 1.0 / (sample_rate_hz * count as f64);
        Some(BandPower {
            pr: in_flexural.sum / in_reference.sum, // Eq. 52
            p_f: in_flexural.largest * density,
            e_f: in_flexural.sum * density * grid.bin_width_hz,
            // E_f is the band's part of the mean square (Parseval).
            is_faint: in_flexural.sum * density * grid.bin_width_hz < FAINT * mean_square,
        })
    }

    fn plan(&mut self, count: usize) -> &mut Plan<T> {
        match self.plans.iter().position(|plan| plan.fft.len() == count) {
            Some(at) => self.plans[at..].rotate_left(1),
            None => {
                if self.plans.len() >= PLANS_MAX {
                    self.plans.remove(0);
                }
                // A planner keeps every plan it ever made, so each plan gets its own.
                let fft = RealFftPlanner::new().plan_fft_forward(count);
                self.plans.push(Plan { bins: fft.make_output_vec(), scratch: fft.make_scratch_vec(), fft });
            }
        }
        let last = self.plans.len() - 1;
        &mut self.plans[last]
    }
}

/// Frequencies of a spectrum's bins.
#[derive(Debug, Clone, Copy)]
struct Grid {
    sample_count: usize,
    bin_width_hz: f64,
}

/// Sum and largest of the one-sided powers of some bins.
#[derive(Debug, Clone, Copy)]
struct Folded {
    sum: f64,
    largest: f64,
}

impl Grid {
    fn new(sample_count: usize, sample_rate_hz: f64) -> Self {
        // Operation by operation as numpy.fft.rfftfreq(n, 1/fs), so that a bin on an edge falls on the same side.
        let spacing_s = 1.0 / sample_rate_hz;
        Self { sample_count, bin_width_hz: 1.0 / (sample_count as f64 * spacing_s) }
    }

    fn frequency_hz(&self, bin: usize) -> f64 {
        bin as f64 * self.bin_width_hz
    }

    /// First bin whose frequency `is_beyond`, which must stay true once it is.
    fn first(&self, is_beyond: impl Fn(f64) -> bool) -> usize {
        let (mut low, mut high) = (0, self.sample_count / 2 + 1);
        while low < high {
            let middle = low.midpoint(high);
            if is_beyond(self.frequency_hz(middle)) { high = middle } else { low = middle + 1 }
        }
        low
    }

    /// Bins from `from_hz` to `to_hz`, both edges inside; `None` when there is none.
    fn bins(&self, from_hz: f64, to_hz: f64) -> Option<std::ops::Range<usize>> {
        let range = self.first(|f| f >= from_hz)..self.first(|f| f > to_hz);
        (!range.is_empty()).then_some(range)
    }

    /// Powers |X|^2 of `range`, doubled where a bin stands for a negative frequency as well: all but 0 Hz, which
    /// the removed mean makes 0, and the Nyquist frequency of an even number of samples.
    fn fold<T: Real>(&self, bins: &[Complex<T>], range: std::ops::Range<usize>) -> Folded {
        let mut folded = Folded { sum: 0.0, largest: 0.0 };
        for (k, bin) in bins.iter().enumerate().take(range.end).skip(range.start.max(1)) {
            let sides = if 2 * k == self.sample_count { 1.0 } else { 2.0 };
            let (re, im) = (bin.re.widened(), bin.im.widened());
            let power = sides * (re * re + im * im);
            folded.sum += power;
            folded.largest = if power > folded.largest { power } else { folded.largest };
        }
        folded
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const BANDS: Bands = Bands { f_c_hz: 550.0, f_hi_hz: 2000.0, f_lo_hz: 70.0, f_top_hz: 3000.0 };
    const EVERYTHING: Bands = Bands { f_c_hz: 1e-9, f_hi_hz: 1e9, f_lo_hz: 0.0, f_top_hz: 1e9 };

    fn noise(count: usize) -> Vec<f64> {
        let mut state = 12_345_u32;
        std::iter::repeat_with(|| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX) - 0.5
        })
        .take(count)
        .collect()
    }

    /// Catches a wrong scale: a sine of amplitude A on a bin has power A^2/2, all of it in that bin.
    #[test]
    fn sine_on_a_bin() {
        for count in [4096_u32, 4095] {
            let rate = 10.0 * f64::from(count); // bins of 10 Hz
            let mut signal: Vec<f64> =
                (0..count).map(|i| 7.0 + 3.0 * (2.0 * PI * 100.0 * f64::from(i) / f64::from(count)).sin()).collect();
            let power = Spectrum::new().band_power(&mut signal, rate, &BANDS).unwrap();
            assert!((power.pr - 1.0).abs() < 1e-12, "{power:?}");
            assert!((power.e_f - 4.5).abs() < 1e-9, "{power:?}");
            assert!((power.p_f - 0.45).abs() < 1e-9, "{power:?}");
        }
    }

    /// Catches a bin left out or doubled wrongly, of even and odd lengths: Parseval, over all bins.
    #[test]
    fn parseval() {
        for count in [2, 3, 10, 11, 97, 128, 1000, 1023] {
            let mut signal = noise(count);
            let mean = signal.iter().sum::<f64>() / count as f64;
            let variance = signal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64;
            let power = Spectrum::new().band_power(&mut signal, 5000.0, &EVERYTHING).unwrap();
            assert!((power.e_f / variance - 1.0).abs() < 1e-12, "{count}: {} {variance}", power.e_f);
        }
    }

    /// Catches an edge that is not inside: bins of 10 Hz, edges on bins, one tone on each edge.
    #[test]
    fn edges_are_inside() {
        let (count, rate) = (2000, 20_000.0);
        for (tone_hz, expected) in
            [(550.0, 1.0), (2000.0, 1.0), (540.0, 0.0), (2010.0, 0.0), (70.0, 0.0), (3000.0, 0.0)]
        {
            let mut signal: Vec<f64> = (0..count).map(|i| (2.0 * PI * tone_hz * f64::from(i) / rate).cos()).collect();
            let power = Spectrum::new().band_power(&mut signal, rate, &BANDS).unwrap();
            assert!((power.pr - expected).abs() < 1e-9, "{tone_hz} Hz: {}", power.pr);
        }
    }

    /// Catches a bin lost to the rounding of k fs / N: rates whose reciprocal is not a double, as numpy finds them.
    #[test]
    fn bins_like_numpy() {
        for (count, rate, from, to) in
            [(16_384, 40_960.0, 550.0, 2000.0), (16_384, 41_000.0, 70.0, 3000.0), (4800, 48_000.0, 550.0, 2000.0)]
        {
            let grid = Grid::new(count, rate);
            let inside = (0..=count / 2).filter(|&k| (from..=to).contains(&grid.frequency_hz(k)));
            assert!(inside.eq(grid.bins(from, to).unwrap()), "{count} at {rate}");
        }
        assert_eq!(Grid::new(16_384, 40_960.0).bins(550.0, 2000.0), Some(220..801));
        assert_eq!(Grid::new(16, 40_960.0).bins(550.0, 2000.0), None);
    }

    /// Catches a number made up for no bins or no power.
    #[test]
    fn empty_bands() {
        assert_eq!(Spectrum::new().band_power(&mut noise(16), 40_960.0, &BANDS), None);
        assert_eq!(Spectrum::new().band_power(&mut noise(1000), 100.0, &BANDS), None);
        assert_eq!(Spectrum::new().band_power(&mut [0.0_f32; 1000], 40_960.0, &BANDS), None);
        assert_eq!(Spectrum::new().band_power(&mut [1.0_f32], 40_960.0, &EVERYTHING), None);
    }

    /// Catches a cache without bound, and a plan used for another length than its own.
    #[test]
    fn plans_are_kept_and_bounded() {
        let mut spectrum = Spectrum::new();
        for count in (100..130).chain([129, 100, 128]) {
            let kept = spectrum.band_power(&mut noise(count), 40_960.0, &EVERYTHING);
            assert_eq!(kept, Spectrum::new().band_power(&mut noise(count), 40_960.0, &EVERYTHING));
            assert!(spectrum.plans.len() <= PLANS_MAX);
        }
        let kept: Vec<usize> = spectrum.plans.iter().map(|plan| plan.fft.len()).collect();
        assert_eq!(kept, [123, 124, 125, 126, 127, 129, 100, 128]);
    }
}
