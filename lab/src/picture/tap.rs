//! One tap, as it is drawn.

use anyhow::{Context as _, Result, ensure};
use plotters::style::RGBColor;
use realfft::RealFftPlanner;
use tapline_store::{OwnedSamples, Reader};
use tapline_wire::{Channel, DamageCell, Discriminator, Discriminators, Scan, TapHeader, Values};

use tapline_draw::canvas::Point;

/// Width of a step of the drawn spectra; finer ones hide each other.
const SPECTRUM_STEP_HZ: f64 = 10.0;

/// One tap, scaled and free of its baseline.
pub(crate) struct Tap {
    pub(crate) name: String,
    pub(crate) color: RGBColor,
    pub(crate) cell: DamageCell,
    pub(crate) header: TapHeader,
    values: Values,
    pub(crate) force_n: Vec<f64>,
    pub(crate) sound_v: Vec<f64>,
}

/// What was found in the tap of middling peak force, of those nearest to the belt edge at the highest velocity.
fn typical(reader: &Reader, scan: &Scan, location: u32) -> Result<Discriminators> {
    let found = reader.discriminators()?;
    let here = scan.taps.iter().filter_map(|&row| found[row as usize]);
    let mut taps: Vec<Discriminators> = here.filter(|d| d.id.location == location && d.quality.is_empty()).collect();
    let order = |a: &Discriminators, b: &Discriminators| {
        let offset_mm = |d: &Discriminators| d.id.offset_mm().unwrap_or(0.0).abs();
        let velocity_m_per_s = |d: &Discriminators| d.id.velocity_m_per_s().unwrap_or(0.0);
        offset_mm(a).total_cmp(&offset_mm(b)).then(velocity_m_per_s(b).total_cmp(&velocity_m_per_s(a)))
    };
    taps.sort_by(order);
    let first = *taps.first().with_context(|| format!("location {location} has no clean tap to show"))?;
    taps.retain(|tap| order(tap, &first).is_eq());
    let f_max_n = |d: &Discriminators| d.values.get(Discriminator::FMax).unwrap_or(0.0);
    taps.sort_by(|a, b| f_max_n(a).total_cmp(&f_max_n(b)));
    Ok(taps[(taps.len() - 1) / 2])
}

impl Tap {
    /// The tap to show at the location of `cell`, which is called `word`.
    pub(crate) fn at(reader: &Reader, scan: &Scan, cell: DamageCell, word: &str, color: RGBColor) -> Result<Self> {
        let Discriminators { plan_index, values, .. } = typical(reader, scan, cell.location)?;
        let missing = || format!("the tap in row {plan_index} is not archived");
        let (header, samples) = reader.tap(plan_index)?.with_context(missing)?;
        let channel = |kind: Channel| -> Result<Vec<f64>> {
            let mut channels = header.channels().enumerate();
            let (at, (_, scale)) = channels
                .find(|(_, (channel, _))| *channel == kind)
                .with_context(|| format!("the tap in row {plan_index} has no {} channel", kind.name()))?;
            let count = header.sample_count as usize;
            let range = at * count..(at + 1) * count;
            let values: Vec<f64> = match &samples {
                OwnedSamples::I16(all) => all[range].iter().map(|&x| f64::from(x) * scale).collect(),
                OwnedSamples::F32(all) => all[range].iter().map(|&x| f64::from(x) * scale).collect(),
            };
            Ok(without_baseline(values, header.pre_trigger_samples))
        };
        let name = format!("{word}, at {:.0}°", cell.angle_deg);
        let (force_n, sound_v) = (channel(Channel::Force)?, channel(Channel::Sound)?);
        Ok(Self { name, color, cell, header, values, force_n, sound_v })
    }

    /// `signal` over ms since the trigger.
    pub(crate) fn in_time(&self, signal: &[f64]) -> Vec<Point> {
        let (p, rate_hz) = (f64::from(self.header.pre_trigger_samples), self.header.sample_rate_hz);
        signal.iter().enumerate().map(|(k, &y)| ((k as f64 - p) / rate_hz * 1e3, y)).collect()
    }

    /// A discriminator in `scale` of its SI unit, NaN when absent.
    pub(crate) fn value(&self, which: Discriminator, scale: f64) -> f64 {
        self.values.get(which).map_or(f64::NAN, |value| value / scale)
    }

    /// One-sided boxcar power spectral density in dB re 1 V^2/Hz, the mean of every `SPECTRUM_STEP_HZ`.
    pub(crate) fn spectrum_db(&self) -> Result<Vec<Point>> {
        ensure!(self.sound_v.len() > 1, "the record is too short for a spectrum");
        let mut signal = self.sound_v.clone();
        let fft = RealFftPlanner::new().plan_fft_forward(signal.len());
        let mut bins = fft.make_output_vec();
        fft.process(&mut signal, &mut bins)?;
        let bin_width_hz = self.header.sample_rate_hz / self.sound_v.len() as f64;
        let density = 2.0 / (self.header.sample_rate_hz * self.sound_v.len() as f64); // Eq. 50
        let step = ((SPECTRUM_STEP_HZ / bin_width_hz).round() as usize).clamp(1, bins.len());
        let points = bins[1..].chunks_exact(step).enumerate().map(|(k, chunk)| {
            let mean = chunk.iter().map(|x| x.norm_sqr() * density).sum::<f64>() / step as f64;
            let first = (1 + k * step) as f64;
            ((first + (step - 1) as f64 / 2.0) * bin_width_hz, 10.0 * mean.log10())
        });
        Ok(points.filter(|(_, db)| db.is_finite()).collect())
    }
}

/// The signal less the median of its first 0.75 p samples (section 2 of the method).
fn without_baseline(mut signal: Vec<f64>, pre_trigger_samples: u32) -> Vec<f64> {
    let mut quiet = signal[..(pre_trigger_samples as usize * 3 / 4).min(signal.len())].to_vec();
    quiet.sort_by(f64::total_cmp);
    let median = quiet.get(quiet.len() / 2).copied().unwrap_or(0.0);
    signal.iter_mut().for_each(|x| *x -= median);
    signal
}
