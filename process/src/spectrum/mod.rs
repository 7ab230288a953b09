//! The sound's spectrum in the bands of the configuration: PR, P_f, E_f and the centroid.
//!
//! The power spectral density is the one-sided boxcar periodogram of the whole record with its mean removed,
//! as `scipy.signal.periodogram(x, fs, window="boxcar", detrend="constant", scaling="density")` defines it.
//! The bin at 0 Hz, which is 0 without the mean, is in no band.

#[cfg(target_arch = "x86_64")]
mod avx512;
mod bands;
mod noise;
mod plans;
pub(crate) mod transform;

use bands::{Cells, Folded, Grid};
use plans::Plans;
use tapline_wire::Quality;

use crate::signal::blocks::Moments;
use crate::signal::real::sum_of_squares;
use crate::signal::wide::Kernel;
use crate::{BandEdges, Real};

pub(crate) use bands::Bands;

/// PR, P_f, E_f and the centroid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BandPower {
    /// Power ratio PR.
    pub pr: f64,
    /// Largest density P_f, signal unit squared per Hz.
    pub p_f: f64,
    /// Energy E_f, signal unit squared.
    pub e_f: f64,
    /// Centroid of the reference band, Hz; noise is not subtracted from it.
    pub centroid_hz: f64,
    /// Whether the flexural band holds so little of the record's power that it shows the rounding of `T`.
    pub is_faint: bool,
}

/// Fraction of the record's power below which single precision does not resolve a band: rounding spreads some 1e-14 of
/// the whole over the bins, which is not small beside 1e-4 of the band.
const FAINT: f64 = 1e-5;

/// How to compute a record's power.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct View {
    pub sample_rate_hz: f64,
    pub edges: BandEdges,
    /// Number of samples, from the record's first, that give the noise to subtract; `None` to subtract none.
    pub quiet_count: Option<usize>,
}

impl View {
    /// A record at `sample_rate_hz`, by whole bins, from which nothing is subtracted.
    #[cfg(test)]
    fn plain(sample_rate_hz: f64) -> Self {
        Self { sample_rate_hz, edges: BandEdges::Bins, quiet_count: None }
    }
}

/// Computes the power of records of any length; keeps the plans of the most recent lengths.
#[derive(Debug)]
pub(crate) struct Spectrum<T> {
    plans: Plans<T>,
}

impl<T: Real> Spectrum<T> {
    pub(crate) fn new() -> Self {
        Self { plans: Plans::new() }
    }

    /// PR, P_f, E_f and the centroid of `signal`, whose mean and mean square are `moments`, computed as `view` says. Overwrites the
    /// signal.
    ///
    /// # Errors
    /// `NO_BAND` if a band has no bin, if the reference band has no power, or if the flexural band has no more than noise;
    /// `NO_BASELINE` if the quiet samples are too few to show the noise.
    pub(crate) fn band_power(
        &mut self,
        signal: &mut [T],
        moments: Moments,
        view: &View,
        bands: &Bands,
    ) -> Result<BandPower, Quality> {
        let count = signal.len();
        let grid = Grid::new(count, view.sample_rate_hz);
        let (flexural, reference) = cells(&grid, view.edges, bands).ok_or(Quality::NO_BAND)?;
        let noise = view.quiet_count.map(|count| {
            let quiet = signal.get(..count).unwrap_or_default();
            noise::of_bands(&mut self.plans, quiet, view.sample_rate_hz, bands).ok_or(Quality::NO_BASELINE)
        });
        let noise = noise.transpose()?;
        let mean_square = square_about_mean(signal, moments);
        let powers = self.plans.powers(signal, end(&flexural, &reference));
        let centroid_hz = centroid_hz(&grid, &reference, powers, count);
        let (flexural, reference) = (grid.fold(flexural, powers), grid.fold(reference, powers));
        let has_power = reference.sum > 0.0;
        if !has_power {
            return Err(Quality::NO_BAND);
        }
        let density = 1.0 / (view.sample_rate_hz * count as f64); // PSD = |X|^2/(fs N), V^2/Hz
        // The band's part of the mean square (Parseval).
        let energy = |band: Folded| band.sum * density * grid.bin_width_hz(); // Eq. 53 times the bin width
        let power = BandPower {
            pr: flexural.sum / reference.sum, // Eq. 52
            p_f: flexural.largest * density,
            e_f: energy(flexural),
            centroid_hz,
            is_faint: energy(flexural) < FAINT * mean_square,
        };
        match noise {
            None => Ok(power),
            Some(noise) => noise.subtracted(&power, energy(reference)).ok_or(Quality::NO_BAND),
        }
    }
}

/// Mean square of `signal` around its mean, from its `moments`; subtracts the mean from the signal where it outweighs
/// the rest.
///
/// The mean is in the bin at 0 Hz, which is in no band. Only where it exceeds all the rest does its rounding show in
/// other bins, and does the difference of mean squares lose its digits.
fn square_about_mean<T: Real>(signal: &mut [T], Moments { mean, mean_square }: Moments) -> f64 {
    let is_small = 2.0 * mean * mean < mean_square;
    if is_small {
        return mean_square - mean * mean;
    }
    let mean = T::rounded(mean);
    signal.iter_mut().for_each(|x| *x -= mean);
    sum_of_squares(signal) / signal.len() as f64
}

/// Bins of the flexural and of the reference band; `None` if either has none.
fn cells(grid: &Grid, edges: BandEdges, bands: &Bands) -> Option<(Cells, Cells)> {
    Some((grid.cells(edges, bands.f_c_hz, bands.f_hi_hz)?, grid.cells(edges, bands.f_lo_hz, bands.f_top_hz)?))
}

/// The mean frequency of the bins of `band`, weighted by their powers, without 0 Hz as in [`Grid::fold`].
fn centroid_hz(grid: &Grid, band: &Cells, powers: &[f64], sample_count: usize) -> f64 {
    let bins = band.whole.start.max(1)..band.whole.end;
    let (first, of_bins) = (bins.start as f64, powers.get(bins.clone()).unwrap_or_default());
    let (rows, rest) = of_bins.as_chunks();
    let (mut sum, mut moment) = FirstMoment { rows }.wide();
    let mut add = |bin: usize, part: f64| {
        sum += part * powers[bin];
        moment += part * (bin as f64 - first) * powers[bin];
    };
    (bins.end - rest.len()..bins.end).for_each(|bin| add(bin, 1.0));
    // The Nyquist frequency counts once, all others twice.
    let is_nyquist = |bin: usize| 2 * bin == sample_count;
    if bins.clone().last().is_some_and(is_nyquist) {
        add(bins.end - 1, -0.5);
    }
    let edges = band.edges.into_iter().filter(|&(bin, part)| bin > 0 && part > 0.0);
    edges.for_each(|(bin, part)| add(bin, if is_nyquist(bin) { 0.5 * part } else { part }));
    (first + moment / sum) * grid.bin_width_hz()
}

/// Lanes of a [`FirstMoment`]; they let the compiler use vectors.
const LANES: usize = 8;

/// Sum and first moment of powers; bins are counted from the first.
struct FirstMoment<'a> {
    rows: &'a [[f64; LANES]],
}

impl Kernel for FirstMoment<'_> {
    type Output = (f64, f64);

    #[inline(always)]
    fn run(self) -> (f64, f64) {
        let (mut sums, mut moments) = ([0.0; LANES], [0.0; LANES]);
        let mut bins: [f64; LANES] = std::array::from_fn(|lane| lane as f64);
        for row in self.rows {
            for (lane, &power) in row.iter().enumerate() {
                sums[lane] += power;
                moments[lane] += bins[lane] * power;
                bins[lane] += LANES as f64;
            }
        }
        (sums.iter().sum(), moments.iter().sum())
    }
}

/// One past the last bin of both bands.
fn end(flexural: &Cells, reference: &Cells) -> usize {
    flexural.end().max(reference.end())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use tapline_testing::noise::Noise;

    use super::*;
    use crate::signal::wide::in_all_vectors;

    /// Catches a lane that is left out or counted from another bin, and sums that depend on the machine's vectors.
    #[test]
    fn first_moments_are_the_same_on_every_machine() {
        for count in 0..9 {
            let rows: Vec<[f64; LANES]> = noise(count * LANES).as_chunks().0.to_vec();
            let powers = rows.as_flattened();
            let expected = powers.iter().enumerate().map(|(bin, power)| bin as f64 * power).sum::<f64>();
            let found = in_all_vectors(|| FirstMoment { rows: &rows });
            let bits = found.map(|(sum, moment)| [sum.to_bits(), moment.to_bits()]);
            assert_eq!(bits, [bits[0]; 3]);
            assert!((found[0].0 - powers.iter().sum::<f64>()).abs() < 1e-12 && (found[0].1 - expected).abs() < 1e-10);
        }
    }

    const BANDS: Bands = Bands { f_c_hz: 550.0, f_hi_hz: 2000.0, f_lo_hz: 70.0, f_top_hz: 3000.0 };
    const EVERYTHING: Bands = Bands { f_c_hz: 1e-9, f_hi_hz: 1e9, f_lo_hz: 0.0, f_top_hz: 1e9 };

    fn moments<T: Real>(signal: &[T]) -> Moments {
        let mean_of =
            |term: fn(f64) -> f64| signal.iter().map(|x| term(x.widened())).sum::<f64>() / signal.len() as f64;
        Moments { mean: mean_of(|x| x), mean_square: mean_of(|x| x * x) }
    }

    fn band_power<T: Real>(mut signal: Vec<T>, view: &View, bands: &Bands) -> Result<BandPower, Quality> {
        let moments = moments(&signal);
        Spectrum::new().band_power(&mut signal, moments, view, bands)
    }

    fn noise(count: usize) -> Vec<f64> {
        let mut noise = Noise(12_345);
        std::iter::repeat_with(|| noise.uniform() - 0.5).take(count).collect()
    }

    /// Catches a wrong scale: a sine of amplitude A on a bin has power A^2/2, all of it in that bin.
    #[test]
    fn sine_on_a_bin() {
        for count in [4096_u32, 4095] {
            let rate = 10.0 * f64::from(count); // bins of 10 Hz
            let signal: Vec<f64> =
                (0..count).map(|i| 7.0 + 3.0 * (2.0 * PI * 100.0 * f64::from(i) / f64::from(count)).sin()).collect();
            let power = band_power(signal, &View::plain(rate), &BANDS).unwrap();
            assert!((power.pr - 1.0).abs() < 1e-12, "{power:?}");
            assert!((power.e_f - 4.5).abs() < 1e-9, "{power:?}");
            assert!((power.p_f - 0.45).abs() < 1e-9, "{power:?}");
            assert!((power.centroid_hz - 1000.0).abs() < 1e-6, "{power:?}");
        }
    }

    /// Catches a bin left out or doubled wrongly, of even and odd lengths: Parseval, over all bins.
    #[test]
    fn parseval() {
        for count in [2, 3, 10, 11, 97, 128, 1000, 1023] {
            let signal = noise(count);
            let mean = signal.iter().sum::<f64>() / count as f64;
            let variance = signal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64;
            let power = band_power(signal, &View::plain(5000.0), &EVERYTHING).unwrap();
            assert!((power.e_f / variance - 1.0).abs() < 1e-12, "{count}: {} {variance}", power.e_f);
        }
    }

    /// Catches the Nyquist frequency that counts twice in the centroid, whether its bin counts in full or in part.
    #[test]
    fn the_centroid_counts_nyquist_once() {
        // All numbers of bins after the last row of lanes.
        for half in 8..20 {
            let grid = Grid::new(2 * half, 2.0 * half as f64); // bins of 1 Hz
            let powers: Vec<f64> = (0..=half).map(|bin| 1.0 + bin as f64).collect();
            for edges in [BandEdges::Bins, BandEdges::Fractional] {
                let band = grid.cells(edges, 1.0, half as f64).unwrap();
                let mut parts = vec![1.0; half + 1];
                band.edges.into_iter().filter(|&(_, part)| part > 0.0).for_each(|(bin, part)| parts[bin] = part);
                parts[half] *= 0.5;
                let sum = |of: fn(usize) -> f64| (1..=half).map(|bin| of(bin) * parts[bin] * powers[bin]).sum::<f64>();
                let expected = sum(|bin| bin as f64) / sum(|_| 1.0);
                let found = centroid_hz(&grid, &band, &powers, 2 * half);
                assert!((found - expected).abs() < 1e-12, "{half}, {edges:?}: {found} {expected}");
            }
        }
    }

    /// Catches noise that is to be subtracted and silently is not, because nothing before the trigger shows it.
    #[test]
    fn noise_that_is_not_known_is_not_left_in() {
        let mut signal = noise(4096);
        signal[..1024].iter_mut().for_each(|x| *x *= 0.1);
        let found = |quiet_count, bands: &Bands| {
            let view = View { quiet_count: Some(quiet_count), ..View::plain(40_960.0) };
            band_power(signal.clone(), &view, bands).map(|_| ())
        };
        let unknown = Err(Quality::NO_BASELINE);
        assert_eq!([found(1024, &BANDS), found(31, &BANDS), found(0, &BANDS)], [Ok(()), unknown, unknown]);
        // Bins of 1024 Hz: none lies between f_c and f_hi.
        assert_eq!(found(40, &Bands { f_hi_hz: 1000.0, ..BANDS }), unknown);
    }

    /// Catches an edge that is left out: bins of 10 Hz, edges on bins, one tone on each edge.
    #[test]
    fn edges_are_inside() {
        let (count, rate) = (2000, 20_000.0);
        for (tone_hz, expected) in
            [(550.0, 1.0), (2000.0, 1.0), (540.0, 0.0), (2010.0, 0.0), (70.0, 0.0), (3000.0, 0.0)]
        {
            let signal: Vec<f64> = (0..count).map(|i| (2.0 * PI * tone_hz * f64::from(i) / rate).cos()).collect();
            let power = band_power(signal, &View::plain(rate), &BANDS).unwrap();
            assert!((power.pr - expected).abs() < 1e-9, "{tone_hz} Hz: {}", power.pr);
        }
    }

    /// Catches an offset whose rounding shows in the bands, whether it stays in the signal or is subtracted, and a mean
    /// square that includes the offset.
    #[test]
    fn an_offset_is_in_no_band() {
        let tone: Vec<f64> = noise(4096).iter().enumerate().map(|(i, x)| x + (0.3 * i as f64).sin()).collect();
        let mean = tone.iter().sum::<f64>() / 4096.0;
        let mean_square = tone.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 4096.0;
        let view = View::plain(40_960.0);
        let expected = band_power(tone.clone(), &view, &BANDS).unwrap();
        for offset in [0.0, 0.2, 0.7, 0.8, 30.0, 1000.0] {
            let single: Vec<f32> = tone.iter().map(|x| (x + offset) as f32).collect();
            let found = square_about_mean(&mut single.clone(), moments(&single));
            assert!((found / mean_square - 1.0).abs() < 1e-4, "{offset}: {found} {mean_square}");
            let found = band_power(single, &view, &BANDS).unwrap();
            // What remains is the rounding of the samples beside the offset.
            let most = 1e-5 * (1.0 + offset);
            assert!((found.pr / expected.pr - 1.0).abs() < most, "{offset}: {found:?} {expected:?}");
            assert!((found.e_f / expected.e_f - 1.0).abs() < most, "{offset}: {found:?} {expected:?}");
        }
    }

    /// Catches a value invented where there are no bins or no power.
    #[test]
    fn empty_bands() {
        let none = Err(Quality::NO_BAND);
        assert_eq!(band_power(noise(16), &View::plain(40_960.0), &BANDS), none);
        assert_eq!(band_power(noise(1000), &View::plain(100.0), &BANDS), none);
        assert_eq!(band_power(vec![0.0_f32; 1000], &View::plain(40_960.0), &BANDS), none);
        assert_eq!(band_power(vec![1.0_f32], &View::plain(40_960.0), &EVERYTHING), none);
    }
}
