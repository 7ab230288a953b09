//! The noise before the trigger, as power in the two bands.

use std::f64::consts::TAU;

use super::bands::{Bands, Grid};
use super::plans::Plans;
use super::{BandPower, cells, end};
use crate::{BandEdges, Real};

/// Fewest samples from which a spectrum of the noise is computed.
const SAMPLES_MIN: usize = 32;

/// Mean square of the noise in each band, and its mean density in the flexural band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    flexural: f64,
    reference: f64,
    density: f64,
}

/// The noise of `quiet` samples in `bands`: their periodogram with a Hann window, which suits what goes on, as noise
/// does, and keeps hum out of the bands. `None` if there are too few samples to resolve the bands.
pub(super) fn of_bands<T: Real>(
    plans: &mut Plans<T>,
    quiet: &[T],
    sample_rate_hz: f64,
    bands: &Bands,
) -> Option<Noise> {
    let count = quiet.len();
    if count < SAMPLES_MIN {
        return None;
    }
    let grid = Grid::new(count, sample_rate_hz);
    // Bins are wide here; whole bins would be much more or less than the band.
    let (flexural, reference) = cells(&grid, BandEdges::Fractional, bands)?;
    let mean = quiet.iter().map(|x| x.widened()).sum::<f64>() / count as f64;
    let mut squares = 0.0;
    let windowed = quiet.iter().enumerate().map(|(i, x)| {
        let height = 0.5 - 0.5 * (TAU * i as f64 / count as f64).cos();
        squares += height * height;
        T::rounded(height * (x.widened() - mean))
    });
    let mut windowed: Vec<T> = windowed.collect();
    let powers = plans.powers(&mut windowed, end(&flexural, &reference));
    let density = 1.0 / (sample_rate_hz * squares);
    let mean_square = |cells| grid.fold(cells, powers).sum * density * grid.bin_width_hz();
    let (flexural, reference) = (mean_square(flexural), mean_square(reference));
    let top_hz = if bands.f_hi_hz < sample_rate_hz / 2.0 { bands.f_hi_hz } else { sample_rate_hz / 2.0 };
    Some(Noise { flexural, reference, density: flexural / (top_hz - bands.f_c_hz) })
}

impl Noise {
    /// `power` less the noise; `reference` is the mean square of the reference band. `None` if the band, or the
    /// largest density, is no more than noise, or if so little is left of the reference band that the band is more than it.
    pub(super) fn subtracted(&self, power: &BandPower, reference: f64) -> Option<BandPower> {
        let flexural = power.e_f - self.flexural;
        let reference = reference - self.reference;
        let p_f = power.p_f - self.density;
        let is_left = flexural > 0.0 && reference >= flexural && p_f > 0.0;
        is_left.then_some(BandPower { pr: flexural / reference, p_f, e_f: flexural, ..*power })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a wrong scale of window, density or band: a band of white noise has its fraction of the mean square.
    #[test]
    fn white_noise_fills_the_bands() {
        let bands = Bands { f_c_hz: 1000.0, f_hi_hz: 3000.0, f_lo_hz: 500.0, f_top_hz: 4500.0 };
        let mut white = tapline_testing::noise::Noise(1);
        let samples: Vec<f64> = (0..1 << 16).map(|_| 3.0 + white.uniform()).collect();
        let noise = of_bands(&mut Plans::new(), &samples, 10_000.0, &bands).unwrap();
        let expected = 1.0 / 12.0 * 2000.0 / 5000.0;
        assert!((noise.flexural / expected - 1.0).abs() < 0.03, "{noise:?}");
        assert!((noise.reference / (2.0 * expected) - 1.0).abs() < 0.03, "{noise:?}");
        assert!((noise.density / (expected / 2000.0) - 1.0).abs() < 0.03, "{noise:?}");
        assert_eq!(of_bands(&mut Plans::new(), &samples[..31], 10_000.0, &bands), None);
    }

    /// Catches values below zero, a ratio above one, and noise that is subtracted from one of them alone.
    #[test]
    fn no_more_than_noise_is_nothing() {
        let noise = Noise { flexural: 1.0, reference: 2.0, density: 0.1 };
        let power = BandPower { pr: 0.5, p_f: 1.0, e_f: 3.0, centroid_hz: 9.0, is_faint: false };
        let found = noise.subtracted(&power, 6.0).unwrap();
        assert_eq!((found.pr, found.p_f, found.e_f), (2.0 / 4.0, 0.9, 2.0));
        assert_eq!(noise.subtracted(&BandPower { e_f: 1.0, ..power }, 9.0), None);
        assert_eq!(noise.subtracted(&power, 2.0), None);
        assert_eq!(noise.subtracted(&power, 3.5), None);
        assert_eq!(noise.subtracted(&BandPower { p_f: 0.1, ..power }, 5.0), None);
    }
}
