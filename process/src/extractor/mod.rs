//! One tap in, its discriminators out: the state machine that owns plans and scratch.

pub(crate) mod config;
mod precise;
mod window;

pub use precise::ProcessExtractor;

use tapline_wire::{Discriminator, Discriminators, Quality, Samples, TapHeader};

use crate::extractor::window::{Window, window};
use crate::force::{Pulse, PulseFinder, peak_at};
use crate::quality::{
    self, ForceRecord, QualityReport, SoundRecord, check_force, check_sound, fill_means, stands_still,
};
use crate::signal::aligned::Aligned;
use crate::signal::area::area;
use crate::signal::baseline::{Medians, baseline_count};
use crate::signal::blocks::Blocks;
use crate::signal::extent::{Extent, Extremes};
use crate::signal::hum::Hum;
use crate::signal::record::{Count, Record, Track};
use crate::sound::{deviation, magnitude_area, magnitude_of_noise, sound_onset};
use crate::spectrum::{Bands, Spectrum, View};
use crate::{Error, ProcessConfig, Real};

/// Extracts the discriminators of taps, one after the other, in the arithmetic of `T`.
///
/// Only the transform, the terms of long sums and the blocks (see `signal/blocks.rs`) are in `T`; everything else,
/// including the sums, is in `f64`. The median of the blocks' squares orders them in `f32`. One extractor serves one
/// thread; its results depend on the tap alone, not on earlier taps.
#[derive(Debug)]
pub struct Extractor<T: Real> {
    config: ProcessConfig,
    medians: Medians,
    finder: PulseFinder,
    blocks: Blocks,
    /// Means of the force's samples, see [`fill_means`].
    means: Vec<f32>,
    /// [`balance`](quality::balance) of the last tap's force, where it has one.
    force_balance: Option<f64>,
    signal: Aligned<T>,
    spectrum: Spectrum<T>,
    /// Whether the last tap's flexural band was too faint for single precision.
    is_faint: bool,
}

impl<T: Real> Extractor<T> {
    /// An extractor for `config`, but for its precision: the caller chooses `T`.
    ///
    /// # Errors
    /// What [`ProcessConfig::validate`] finds.
    pub fn new(config: &ProcessConfig) -> Result<Self, Error> {
        config.validate()?;
        Ok(Self {
            config: *config,
            medians: Medians::default(),
            finder: PulseFinder::new(config.f_max, config.tau),
            blocks: Blocks::default(),
            means: Vec::new(),
            force_balance: None,
            signal: Aligned::new(),
            spectrum: Spectrum::new(),
            is_faint: false,
        })
    }

    /// The discriminators of the tap that `header` describes, from its planar `samples`.
    ///
    /// Never fails: what the record does not show is absent, and a flag says why (see the table of the crate).
    pub fn extract(&mut self, header: &TapHeader, samples: Samples<'_>) -> Discriminators {
        let mut found = Found::default();
        self.is_faint = false;
        self.force_balance = None;
        match samples {
            Samples::I16(samples) => self.extract_counts(header, samples, &mut found),
            Samples::F32(samples) => self.extract_counts(header, samples, &mut found),
        }
        if header.retakes_left > 0 && self.config.quality.wants_retake(&found.0) {
            found.flag(Quality::RETAKE);
        }
        Discriminators {
            id: header.id,
            plan_index: header.plan_index,
            quality: found.0.quality,
            velocity_measured_m_per_s: header.velocity_measured_m_per_s,
            values: found.0.values,
        }
    }

    fn extract_counts<C: Count>(&mut self, header: &TapHeader, samples: &[C], found: &mut Found) {
        let used = self.config.samples_looked_at(header.sample_count, header.sample_rate_hz);
        let Some(record) = Record::new(header, used, samples) else { return found.flag(Quality::REFUSED) };
        let mut force_report = QualityReport::default();
        let pulse = self.pulse(&record, quality::velocity_m_per_s(header), &mut force_report);
        found.flag(force_report.flags());
        match &pulse {
            Ok(pulse) => {
                found.set(Discriminator::FMax, pulse.f_max_n);
                found.set(Discriminator::Tau, pulse.tau_samples / record.sample_rate_hz);
            }
            Err(why) => found.flag(*why),
        }
        let mut sound_report = QualityReport::default();
        if let Err(why) = self.sound(&record, header.microphone_distance_m, pulse, found, &mut sound_report) {
            found.flag(why);
        }
        force_report.apply(&mut found.0);
        sound_report.apply(&mut found.0);
        let planned = self.config.samples_looked_at(header.planned_sample_count, header.sample_rate_hz);
        quality::check_length(used, planned, &self.config.quality).apply(&mut found.0);
        quality::check_velocity(header, &self.config.quality).apply(&mut found.0);
    }

    /// The force pulse, or the flag that says why there is none.
    fn pulse<C: Count>(
        &mut self,
        record: &Record<'_, C>,
        velocity_m_per_s: Option<f64>,
        report: &mut QualityReport,
    ) -> Result<Pulse, Quality> {
        let track = record.force.ok_or(Quality::NO_FORCE)?;
        let extent = checked(track, fill_means(track.samples, &mut self.means))?;
        let peak_at = peak_at(track, extent).ok_or(Quality::NON_FINITE)?;
        let baseline_count = baseline_count(record.pre_trigger_samples, track.samples.len());
        // Without a baseline there is no pulse; the other rules still apply.
        let before = &track.samples[..baseline_count.unwrap_or(track.samples.len())];
        let base = self.medians.median(before);
        let noise = self.medians.noise_counts(before, base);
        self.force_balance = Some(quality::balance(extent, base)).filter(|_| !extent.is_constant());
        self.finder.set_droop(self.config.droop_time_constant_s * record.sample_rate_hz);
        let pulse = match baseline_count {
            Some(_) => self.finder.find(track, peak_at, base, noise).ok_or(Quality::NO_PULSE),
            None => Err(Quality::NO_BASELINE),
        };
        let Record { pre_trigger_samples, sample_rate_hz, .. } = *record;
        let force = ForceRecord {
            track,
            extent,
            peak_at,
            base,
            noise,
            baseline_count,
            pre_trigger_samples,
            sample_rate_hz,
            velocity_m_per_s,
            pulse: pulse.ok(),
            means: &self.means,
        };
        *report = check_force(&force, &self.config.quality);
        if extent.is_constant() {
            report.note(Quality::NO_FORCE); // beside NO_PULSE, which drops A_2 too
        }
        if baseline_count.is_some_and(|count| stands_still(track.samples, extent, base, count)) {
            report.raise_on_pulse(Quality::DROPOUT, self.config.quality.dropout);
        }
        report.pulse_dropped_for().map_or(pulse, Err)
    }

    /// Areas and band powers of the sound.
    fn sound<C: Count>(
        &mut self,
        record: &Record<'_, C>,
        microphone_distance_m: f64,
        pulse: Result<Pulse, Quality>,
        found: &mut Found,
        report: &mut QualityReport,
    ) -> Result<(), Quality> {
        let track = record.sound.ok_or(Quality::NO_SOUND)?;
        let sample_rate_hz = record.sample_rate_hz;
        let Centring { extent, baseline_count, base, noise, gain } = self.centre(record, track)?;
        if extent.is_constant() || track.unit_per_count == 0.0 {
            report.note(Quality::NO_SOUND);
            return Err(Quality::NO_ONSET); // a dead microphone has no spectrum rather than a quiet one
        }
        let sound = SoundRecord {
            track,
            extent,
            base,
            signal: &self.signal,
            gain,
            noise,
            baseline_count,
            onset: pulse.ok().map(|pulse| sound_onset(pulse, microphone_distance_m, sample_rate_hz)),
            has_distance: microphone_distance_m > 0.0,
            sample_rate_hz,
            f_top_hz: self.config.f_top_hz,
            known: found.0.quality,
        };
        *report = check_sound(&sound, &mut self.blocks, &self.config.quality);
        if let Some(of_force) = self.force_balance {
            let of_sound = quality::balance(extent, base);
            if quality::are_swapped(of_force, of_sound) {
                report.raise(Quality::SWAPPED, self.config.quality.swapped, &Discriminator::ALL);
            }
        }
        let hum = self.subtract_hum(baseline_count, sample_rate_hz);
        let window = match baseline_count {
            Some(_) => window(record, track, base, microphone_distance_m, pulse),
            None => Err(Quality::NO_BASELINE),
        };
        match window {
            Ok(window) => {
                let value = |i: usize| track.samples[i].into() - base - hum.map_or(0.0, |hum| hum.at(i) / gain);
                let quiet = baseline_count.filter(|_| self.config.subtract.has_noise());
                let noise = quiet.map(|count| deviation(&self.signal[..count]));
                self.areas(value, track.unit_per_count.abs(), window, sample_rate_hz, (gain, noise), found);
            }
            Err(why) => found.flag(why),
        }
        let tau_s = pulse.ok().map(|pulse| pulse.tau_samples / sample_rate_hz);
        self.powers(sample_rate_hz, baseline_count, tau_s, track.unit_per_count.abs() / gain, found)
    }

    /// Fills the signal and its blocks with the sound of `track`, less its baseline and times a gain.
    fn centre<C: Count>(&mut self, record: &Record<'_, C>, track: Track<'_, C>) -> Result<Centring<C>, Quality> {
        let baseline_count = baseline_count(record.pre_trigger_samples, track.samples.len());
        let before = baseline_count.map(|count| &track.samples[..count]);
        let base = before.map_or(0.0, |before| self.medians.median(before)); // the mean is in no band
        let noise = before.map(|before| self.medians.noise_counts(before, base));
        // Without need of a gain the extremes are found in the pass that is made anyway.
        let known = if C::NEEDS_GAIN { Some(checked(track, Extent::find(track.samples))?) } else { None };
        let gain = known.map_or(1.0, |extent| extent.gain(base));
        let mut extremes = Extremes::of(*track.samples.first().ok_or(Quality::NON_FINITE)?);
        self.signal.resize(track.samples.len());
        let centred = |from: usize, to: &mut [T]| {
            let samples = &track.samples[from..][..to.len()];
            if !C::NEEDS_GAIN {
                extremes.add(from, samples);
            }
            to.iter_mut().zip(samples).for_each(|(to, &x)| *to = x.centred(base, gain));
        };
        self.blocks.fill(&mut self.signal, record.sample_rate_hz, centred);
        let extent = checked(track, known.or_else(|| extremes.extent()))?;
        Ok(Centring { extent, baseline_count, base, noise, gain })
    }

    /// Removes the hum from the signal, if the configuration asks for it and the `quiet` samples show it.
    fn subtract_hum(&mut self, quiet: Option<usize>, sample_rate_hz: f64) -> Option<Hum> {
        let count = quiet.filter(|_| self.config.subtract.has_hum())?;
        let hum = Hum::fit(|i| self.signal[i].widened(), count, self.config.mains_hz / sample_rate_hz)?;
        hum.subtract_from(&mut self.signal);
        self.blocks.fill(&mut self.signal, sample_rate_hz, |_, _| ());
        Some(hum)
    }

    /// A_1 and A_2 of a sound that has `value` counts of a `unit` at each sample. The signal is the sound times `gain`; its `noise`, in
    /// the signal's unit, is subtracted from A_2.
    fn areas(
        &self,
        value: impl Fn(usize) -> f64,
        unit: f64,
        window: Window,
        sample_rate_hz: f64,
        (gain, noise): (f64, Option<f64>),
        found: &mut Found,
    ) {
        if let Some(onset) = window.onset {
            let initial = area(value, onset, window.ringing); // Eq. 40
            found.set(Discriminator::A1, initial.abs() * unit / sample_rate_hz);
        }
        let of_noise = noise.map_or(0.0, |noise| magnitude_of_noise(&self.signal, window.ringing, noise));
        let ringing = magnitude_area(&self.signal, &self.blocks, window.ringing) - of_noise; // Eq. 43 of the magnitude
        if ringing < 0.0 {
            return found.flag(Quality::NO_ONSET); // no more than noise
        }
        found.set(Discriminator::A2, ringing * (unit / gain) / sample_rate_hz);
    }

    /// PR, P_f, E_f and the centroid of the signal, of which 1 is a `unit`; `tau_s` is the tap's contact time.
    fn powers(
        &mut self,
        sample_rate_hz: f64,
        baseline_count: Option<usize>,
        tau_s: Option<f64>,
        unit: f64,
        found: &mut Found,
    ) -> Result<(), Quality> {
        let bands = self.bands(tau_s).ok_or(Quality::NO_BAND)?;
        let view = View {
            sample_rate_hz,
            edges: self.config.band_edges,
            quiet_count: self.config.subtract.has_noise().then(|| baseline_count.unwrap_or(0)),
        };
        let moments = self.blocks.moments(&self.signal);
        let power = self.spectrum.band_power(&mut self.signal, moments, &view, &bands)?;
        self.is_faint = power.is_faint;
        found.set(Discriminator::Pr, power.pr);
        found.set(Discriminator::Pf, power.p_f * unit * unit);
        found.set(Discriminator::Ef, power.e_f * unit * unit);
        found.set(Discriminator::Centroid, power.centroid_hz);
        Ok(())
    }

    /// The bands for a tap of contact time `tau_s`; `None` if an f_c that follows it leaves nothing below f_hi.
    ///
    /// f_c never follows below f_lo, where PR's band would reach beyond its reference.
    fn bands(&self, tau_s: Option<f64>) -> Option<Bands> {
        let ProcessConfig { f_c_hz, f_hi_hz, f_lo_hz, f_top_hz, .. } = self.config;
        let followed = tau_s.filter(|_| self.config.f_c_follows_tau).map(|tau_s| 1.0 / (2.0 * tau_s));
        let asked_for = followed.unwrap_or(f_c_hz);
        let f_c_hz = if asked_for > f_lo_hz { asked_for } else { f_lo_hz };
        (f_c_hz <= f_hi_hz).then_some(Bands { f_c_hz, f_hi_hz, f_lo_hz, f_top_hz })
    }
}

/// How the signal follows from the samples of the sound: (sample - `base`) `gain`.
struct Centring<C> {
    extent: Extent<C>,
    /// Samples that the baseline is computed from; `None` if the record has none, and `base` is 0.
    baseline_count: Option<usize>,
    /// Baseline, counts.
    base: f64,
    /// Standard deviation before the trigger, counts.
    noise: Option<f64>,
    gain: f64,
}

/// The `extent` of a channel; an error if a sample or the scale is not a number.
fn checked<C>(track: Track<'_, C>, extent: Option<Extent<C>>) -> Result<Extent<C>, Quality> {
    extent.filter(|_| track.unit_per_count.is_finite()).ok_or(Quality::NON_FINITE)
}

/// The discriminators and flags found so far.
#[derive(Debug, Default)]
struct Found(Discriminators);

impl Found {
    fn flag(&mut self, why: Quality) {
        self.0.quality.insert(why);
    }

    /// Sets a value; one that overflowed because of a huge scale is absent and flagged.
    fn set(&mut self, which: Discriminator, value: f64) {
        if !value.is_finite() {
            self.flag(Quality::NON_FINITE);
        }
        self.0.values.set(which, Some(value));
    }
}
