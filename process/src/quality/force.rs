//! Rules on the force: is it one complete pulse of one impact?

use std::f64::consts::FRAC_2_PI;
use std::ops::Range;

use tapline_wire::{Discriminator, Quality};

use super::flat::{OF_PULSE, is_flat};
use super::sound::MAINS_HZ;
use super::spike::has_spike;
use super::{OF_SPECTRUM, QualityConfig, QualityReport};
use crate::force::{NOISE_SIGMAS, Pulse};
use crate::signal::baseline::Medians;
use crate::signal::extent::{Extent, Extremes};
use crate::signal::hum::Hum;
use crate::signal::record::{Count, Track};
use crate::signal::wide::Kernel;

/// Standard deviations of the noise that a second pulse must exceed; the greatest noise of a whole record does not.
const SECOND_SIGMAS: f64 = 6.0;
/// Standard deviations of the noise by which the force must rise again; a difference of two samples has sqrt(2) of one.
const RISE_SIGMAS: f64 = 8.0;
/// Longest stretch after the pulse in which hum is looked for.
const HUM_S: f64 = 0.25;
/// Fewest periods that identify hum: a record of 50 ms, of which 12.5 are before the trigger, has 1.7 after the pulse.
const HUM_PERIODS: f64 = 1.6;
/// Largest share of the squares left by hum.
const HUM_LEFT: f64 = 0.3;
/// Fraction of the peak from which on samples belong to the pulse.
const FOOT: f64 = 0.1;
/// Fewest samples above the foot for a peak to be trusted (case 13).
const PULSE_SAMPLES: usize = 8;
/// Samples of a pulse up to which each is looked at for a hit before it; the flank of a finer one is noise.
const FEW_SAMPLES: usize = 64;
/// Fewest quiet samples before the pulse for its beginning to be trusted (case 10).
const QUIET_SAMPLES: usize = 5;
/// Fraction of the peak below which a sample is quiet.
const QUIET: f64 = 0.02;
/// Fraction of the peak at which a trigger has surely fired.
const TRIGGERED: f64 = 0.15;
/// Full scale of a force whose scale is not known, and the least peak of one whose scale is, N.
const UNSCALED_N: f64 = 1.0;
/// Largest impulse of one impact over m V: 2 for an elastic impact, plus a tenth for scale and noise.
const ONE_IMPACT: f64 = 2.2;
/// Smallest impulse of a complete impact over m V. An impactor that rebounds gives (1 + e) m V, 1.5 for e = 0.5; one
/// that gives less still moves with the layer, so that a second pulse is the layer returning to it.
const WHOLE_IMPACT: f64 = 1.2;

/// What the rules on the force need to know.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ForceRecord<'a, C> {
    pub track: Track<'a, C>,
    pub extent: Extent<C>,
    /// Where the force is greatest.
    pub peak_at: usize,
    /// Baseline and standard deviation of the noise, counts.
    pub base: f64,
    pub noise: f64,
    /// Samples that the baseline is computed from; `None` if the record has none.
    pub baseline_count: Option<usize>,
    pub pre_trigger_samples: usize,
    pub sample_rate_hz: f64,
    /// Velocity of the impact, m/s, where it is known.
    pub velocity_m_per_s: Option<f64>,
    /// The pulse, where one was found.
    pub pulse: Option<Pulse>,
    /// Means of every [`MEAN_OF`] samples, counts.
    pub means: &'a [f32],
}

/// Samples of a mean: a pulse has [`PULSE_SAMPLES`] or more.
pub(crate) const MEAN_OF: usize = PULSE_SAMPLES;

/// Fills `means` with those of every [`MEAN_OF`] of `samples`; returns their extent, `None` when there is none or one is not a number.
pub(crate) fn fill_means<C: Count>(samples: &[C], means: &mut Vec<f32>) -> Option<Extent<C>> {
    means.resize(samples.len() / MEAN_OF, 0.0);
    Means { samples, means }.wide()
}

/// Means of samples that are looked at together: memory, not arithmetic, limits passes over a record.
const MEANS: usize = 64;

struct Means<'a, C> {
    samples: &'a [C],
    means: &'a mut [f32],
}

impl<C: Count> Kernel for Means<'_, C> {
    type Output = Option<Extent<C>>;

    #[inline(always)]
    fn run(self) -> Option<Extent<C>> {
        let mut extremes = Extremes::of(*self.samples.first()?);
        let stretches = self.samples.chunks(MEANS * MEAN_OF).zip(self.means.chunks_mut(MEANS));
        for (number, (samples, means)) in stretches.enumerate() {
            extremes.add(number * MEANS * MEAN_OF, samples);
            for (mean, row) in means.iter_mut().zip(samples.as_chunks::<MEAN_OF>().0) {
                *mean = C::mean_of(*row);
            }
        }
        // The last samples, which are fewer than a mean has.
        let from = self.means.len() * MEAN_OF;
        extremes.add(from, &self.samples[from..]);
        extremes.extent()
    }
}

/// Checks a force; without a pulse only a late trigger can be found.
pub(crate) fn check_force<C: Count>(force: &ForceRecord<'_, C>, config: &QualityConfig) -> QualityReport {
    let mut report = QualityReport::default();
    let Some(shape) = Shape::find(force) else {
        if is_lost_in_baseline(force) {
            report.raise_on_pulse(Quality::LATE_TRIGGER, config.late_trigger);
            report.raise(Quality::LATE_TRIGGER, config.late_trigger, &OF_SPECTRUM);
        }
        return report;
    };
    if is_flat(force.track.samples, force.peak_at, force.extent, force.base, (force.noise, OF_PULSE)) {
        report.raise_on_pulse(Quality::CLIPPED, config.clipped_force);
    }
    let pulse = shape.begin..shape.end;
    if pulse.len() < PULSE_SAMPLES {
        report.raise_on_pulse(Quality::UNDERSAMPLED, config.undersampled);
    }
    // A pulse that is clipped or has few samples has corners of its own.
    if report.flags().is_empty()
        && has_spike(force.track.samples, pulse, (shape.peak, force.noise), config.spike_ratio_max)
    {
        report.raise_on_pulse(Quality::SPIKE, config.spike);
    }
    match trigger(force, &shape) {
        Trigger::Good => {}
        Trigger::AfterRise => report.note(Quality::LATE_TRIGGER),
        Trigger::AfterBaseline => report.raise_on_pulse(Quality::LATE_TRIGGER, config.late_trigger),
        Trigger::WithinPulse => {
            report.raise_on_pulse(Quality::LATE_TRIGGER, config.late_trigger);
            report.raise(Quality::LATE_TRIGGER, config.late_trigger, &OF_SPECTRUM);
        }
    }
    let hum = hum(force, &shape, config);
    if hum.is_some() {
        report.raise_on_pulse(Quality::HUM, config.hum);
    }
    if is_double(force, &shape, hum.unwrap_or(0.0), config) {
        report.raise_on_pulse(Quality::DOUBLE_HIT, config.double_hit);
        report.raise(Quality::DOUBLE_HIT, config.double_hit, &OF_SPECTRUM);
    }
    // A pulse that is cut, has few samples or is not alone says nothing about the rate.
    let is_whole = Quality::HUM.contains(report.flags());
    if shape.peak < config.snr_min * force.noise {
        report.raise_on_pulse(Quality::LOW_SNR, config.low_snr);
    }
    let tau_s = force.pulse.map(|pulse| pulse.tau_samples / force.sample_rate_hz);
    let has_tau = tau_s.is_none_or(|tau_s| (config.tau_min_s..=config.tau_max_s).contains(&tau_s));
    let impulse_ratio = force.pulse.and_then(|pulse| impulse_ratio(force, &shape, pulse, config));
    let has_impulse =
        impulse_ratio.is_none_or(|ratio| (config.impulse_ratio_min..=config.impulse_ratio_max).contains(&ratio));
    if is_whole && !(has_tau && has_impulse) {
        let all_but_f_max = &Discriminator::ALL[1..];
        report.raise(Quality::RATE_IMPLAUSIBLE, config.rate_implausible, all_but_f_max);
    }
    report
}

/// Position of the greatest pulse in samples, and its height in counts.
#[derive(Debug, Clone, Copy)]
struct Shape {
    sign: f64,
    peak: f64,
    peak_at: usize,
    /// First sample above the foot, and the first one after it that is not.
    begin: usize,
    end: usize,
}

impl Shape {
    fn find<C: Count>(force: &ForceRecord<'_, C>) -> Option<Self> {
        let ForceRecord { track: Track { samples, unit_per_count }, peak_at, .. } = *force;
        let sign = if unit_per_count < 0.0 { -1.0 } else { 1.0 };
        let peak = sign * (samples[peak_at].into() - force.base);
        let stands_out = peak > NOISE_SIGMAS * force.noise && unit_per_count != 0.0;
        let is_above = |&&x: &&C| sign * (x.into() - force.base) > FOOT * peak;
        let begin = peak_at - samples[..peak_at].iter().rev().take_while(is_above).count();
        let end = peak_at + samples[peak_at..].iter().take_while(is_above).count();
        stands_out.then_some(Self { sign, peak, peak_at, begin, end })
    }

    /// Force at sample `x` in counts, positive in the pulse.
    fn height<C: Count>(&self, x: C, base: f64) -> f64 {
        self.sign * (x.into() - base)
    }
}

/// When the trigger came, relative to the pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trigger {
    Good,
    /// After the force had risen for more than a sample; nothing is lost.
    AfterRise,
    /// So late that the pulse overlaps the baseline.
    AfterBaseline,
    /// The record begins within the pulse.
    WithinPulse,
}

fn trigger<C: Count>(force: &ForceRecord<'_, C>, shape: &Shape) -> Trigger {
    let noise_limit = SECOND_SIGMAS * force.noise;
    let limit = if noise_limit > QUIET * shape.peak { noise_limit } else { QUIET * shape.peak };
    let before = force.track.samples[..shape.begin].iter().rev();
    let quiet = before.filter(|&&x| shape.height(x, force.base) < limit).take(QUIET_SAMPLES).count();
    if quiet < QUIET_SAMPLES {
        return Trigger::WithinPulse;
    }
    match force.baseline_count {
        Some(count) if shape.begin < count => Trigger::AfterBaseline,
        Some(_) if is_up_before_trigger(force, shape) => Trigger::AfterRise,
        _ => Trigger::Good,
    }
}

/// Whether a pulse that does not stand out of the time before the trigger was itself before the trigger: it stands out
/// of the record's last quarter.
fn is_lost_in_baseline<C: Count>(force: &ForceRecord<'_, C>) -> bool {
    let Track { samples, unit_per_count } = force.track;
    let Some(baseline_count) = force.baseline_count.filter(|_| unit_per_count != 0.0) else { return false };
    let sign = if unit_per_count < 0.0 { -1.0 } else { 1.0 };
    let tail = &samples[samples.len() - samples.len() / 4..];
    let mut medians = Medians::default();
    let base = medians.median(tail);
    let noise = medians.noise_counts(tail, base);
    let height = sign * (samples[force.peak_at].into() - base);
    force.peak_at < baseline_count && !tail.is_empty() && height > SECOND_SIGMAS * noise
}

/// Whether the force was high two samples before the trigger; one sample is the trigger's own uncertainty.
fn is_up_before_trigger<C: Count>(force: &ForceRecord<'_, C>, shape: &Shape) -> bool {
    let Some(before) = force.pre_trigger_samples.checked_sub(2) else { return false };
    let is_behind = before >= shape.peak_at;
    let height = force.track.samples.get(before).map_or(0.0, |&x| shape.height(x, force.base));
    is_behind || height > TRIGGERED * shape.peak + SECOND_SIGMAS * force.noise
}

/// Impulse of a half-sine of the pulse's height and width, over mass times velocity of the impactor; `None` if mass, velocity
/// or the force's scale is not known.
fn impulse_ratio<C: Count>(
    force: &ForceRecord<'_, C>,
    shape: &Shape,
    pulse: Pulse,
    config: &QualityConfig,
) -> Option<f64> {
    let m_v = config.impactor_mass_kg * force.velocity_m_per_s?;
    let is_known = m_v > 0.0 && shape.peak * force.track.unit_per_count.abs() > UNSCALED_N;
    let impulse = FRAC_2_PI * pulse.f_max_n * pulse.tau_samples / force.sample_rate_hz;
    is_known.then_some(impulse / m_v)
}

/// Amplitude in counts of hum in the force after the pulse, where it exceeds `hum_ratio_max` of the peak.
///
/// After the pulse a force is silent, so a sine that fits over [`HUM_PERIODS`] is hum and nothing else.
fn hum<C: Count>(force: &ForceRecord<'_, C>, shape: &Shape, config: &QualityConfig) -> Option<f64> {
    let means_per_s = force.sample_rate_hz / MEAN_OF as f64;
    let first = (shape.peak_at / MEAN_OF + 1).saturating_add((config.tau_max_s * means_per_s) as usize);
    let after = force.means.get(first..)?;
    let after = &after[..after.len().min((HUM_S * means_per_s) as usize)];
    let extent = Extent::find(after)?;
    // Most taps end here: the sine is no higher than what there is.
    let least = config.hum_ratio_max * shape.peak;
    if 0.5 * f64::from(extent.largest - extent.least) <= least {
        return None;
    }
    let count = after.len() as f64;
    let mean = after.iter().map(|&x| f64::from(x)).sum::<f64>() / count;
    let spread = after.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>();
    let lines = MAINS_HZ.map(|f_hz| f_hz / means_per_s).into_iter().filter_map(|turns| {
        let sine = Hum::fit(|i| f64::from(after[i]), after.len(), turns).filter(|_| turns * count >= HUM_PERIODS)?;
        let left = after.iter().enumerate().map(|(i, &x)| (f64::from(x) - sine.at(i)).powi(2)).sum::<f64>();
        Some(sine.amplitude()).filter(|&amplitude| amplitude > least && left < HUM_LEFT * spread)
    });
    lines.max_by(f64::total_cmp)
}

/// Whether there is a second pulse besides the greatest. A layer that swings back is none, and neither is the `hum`, in counts.
fn is_double<C: Count>(force: &ForceRecord<'_, C>, shape: &Shape, hum: f64, config: &QualityConfig) -> bool {
    // Means show a hit that noise hides.
    let noise = force.noise / (MEAN_OF as f64).sqrt();
    let (of_peak, of_noise) = (config.double_hit_ratio_max * shape.peak, RISE_SIGMAS * noise);
    let rise = (if of_peak > of_noise { of_peak } else { of_noise }) + 2.0 * hum;
    let heights = Heights { means: force.means, base: force.base, shape };
    // A layer swings back only after the pulse.
    let first = shape.peak_at / MEAN_OF + 1;
    is_up_before(force, shape, hum, config)
        || heights.valley((0..shape.begin / MEAN_OF).rev(), |until| 0..until + 1, rise).is_some()
        || heights
            .valley(first..force.means.len(), |from| from..force.means.len(), rise)
            .is_some_and(|valley| is_whole_impact(force, shape, valley * MEAN_OF, config))
}

/// Whether single samples before a pulse of few samples rise again: a short hit is lost in their means. Backwards from the pulse to where
/// it is below the limit, and from there to the record's beginning.
fn is_up_before<C: Count>(force: &ForceRecord<'_, C>, shape: &Shape, hum: f64, config: &QualityConfig) -> bool {
    if shape.end - shape.begin > FEW_SAMPLES {
        return false;
    }
    let (of_peak, of_noise) = (config.double_hit_ratio_max * shape.peak, RISE_SIGMAS * force.noise);
    let limit = (if of_peak > of_noise { of_peak } else { of_noise }) + 2.0 * hum;
    let samples = force.track.samples;
    let foot = samples[..shape.begin].iter().rposition(|&x| shape.height(x, force.base) < limit);
    foot.is_some_and(|foot| {
        let extreme = Extent::find(&samples[..foot]).map(|e| if shape.sign < 0.0 { e.least } else { e.largest });
        extreme.is_some_and(|x| shape.height(x, force.base) > limit)
    })
}

/// The means of the force as heights over its base.
struct Heights<'a> {
    means: &'a [f32],
    base: f64,
    shape: &'a Shape,
}

impl Heights<'_> {
    /// The lowest of the means `numbers`, which lead away from the pulse, before the force rises by more than `rise` from it; `None` if it
    /// does not. `rest` gives the means from a number on. Of a flank, only its noise rises, however finely it is sampled.
    fn valley(
        &self,
        numbers: impl Iterator<Item = usize>,
        rest: impl Fn(usize) -> Range<usize>,
        rise: f64,
    ) -> Option<usize> {
        let height_of = |mean: f32| self.shape.sign * (f64::from(mean) - self.base);
        let mut valley = (self.shape.peak, self.shape.peak_at / MEAN_OF);
        let mut may_rise = true;
        for number in numbers {
            let height = height_of(self.means[number]);
            // Once the pulse is over, most taps end here: nothing beyond it is that high.
            if may_rise && height <= rise {
                may_rise = false;
                let extent = Extent::find(&self.means[rest(number)]);
                let is_low = |of: Extent<f32>| height_of(of.least) <= rise && height_of(of.largest) <= rise;
                if extent.is_some_and(is_low) {
                    return None;
                }
            }
            let floor = if valley.0 > 0.0 { valley.0 } else { 0.0 };
            if height > floor + rise {
                return Some(valley.1);
            }
            valley = if height < valley.0 { (height, number) } else { valley };
        }
        None
    }
}

/// Whether the impulse until sample `until` has thrown the impactor back, so that only a second hit can bring another
/// pulse. Also true if mass, velocity or the force's scale is not known.
fn is_whole_impact<C: Count>(force: &ForceRecord<'_, C>, shape: &Shape, until: usize, config: &QualityConfig) -> bool {
    let unit_n = force.track.unit_per_count.abs();
    let Some(velocity) = force.velocity_m_per_s.filter(|_| config.impactor_mass_kg > 0.0) else { return true };
    if shape.peak * unit_n <= UNSCALED_N {
        return true;
    }
    let from = shape.begin.saturating_sub(QUIET_SAMPLES);
    let m_v = config.impactor_mass_kg * velocity;
    let noise_limit = SECOND_SIGMAS * force.noise;
    let impulse = |to: usize, least: f64| -> f64 {
        let heights = force.track.samples[from..to].iter().map(|&x| shape.height(x, force.base));
        heights.filter(|&height| height > least).sum::<f64>() * unit_n / force.sample_rate_hz
    };
    let is_part = impulse(until, f64::NEG_INFINITY) < WHOLE_IMPACT * m_v;
    // The layer returns no more impulse than the impactor brought.
    let is_one = impulse(force.track.samples.len(), noise_limit) < ONE_IMPACT * m_v;
    !(is_part && is_one)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a sum of counts that overflows or loses a sign: the extremes of 16 bits at every place.
    #[test]
    fn means_of_counts_are_those_of_floats() {
        let mut means = Vec::new();
        for place in 0..16 {
            for (value, beside) in [(i16::MIN, i16::MAX), (i16::MAX, i16::MIN), (-1, 0), (i16::MIN, i16::MIN), (77, -3)]
            {
                let mut samples = [beside; 16];
                samples[place] = value;
                fill_means(&samples, &mut means);
                let of_counts = means.clone();
                fill_means(&samples.map(f32::from), &mut means);
                assert_eq!(of_counts, means, "{value} at {place} beside {beside}");
            }
        }
    }

    /// Catches samples that are in no mean and therefore in no extent either, and a mean of the wrong eight: lengths around those of
    /// whole means and whole groups of them.
    #[test]
    fn one_pass_finds_means_and_extent() {
        let mut means = Vec::new();
        for count in (1..20).chain(505..530) {
            let samples: Vec<f32> = (0..count).map(|i| (i * i % 37) as f32).collect();
            for place in [0, count / 2, count - 1] {
                for value in [-7.0, 70.0, f32::NAN, f32::NEG_INFINITY] {
                    let mut samples = samples.clone();
                    samples[place] = value;
                    let seen = |extent: Option<Extent<f32>>| {
                        extent.map(|extent| (extent.least, extent.largest, extent.position(&samples, value, 0)))
                    };
                    let of_means = seen(fill_means(&samples, &mut means));
                    assert_eq!(of_means, seen(Extent::find(&samples)), "{value} at {place} of {count}");
                }
            }
            fill_means(&samples, &mut means);
            let expected: Vec<f32> = samples.chunks_exact(8).map(|eight| eight.iter().sum::<f32>() / 8.0).collect();
            assert_eq!(means, expected);
        }
    }
}
