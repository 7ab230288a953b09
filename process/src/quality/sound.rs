//! Rules on the sound: is it one tap, loud enough, complete?

use std::f64::consts::TAU;

use num_complex::Complex;
use tapline_wire::{Discriminator, Quality};

use super::flat::is_clipped;
use super::still::stands_still;
use super::{OF_SOUND, OF_SPECTRUM, Policy, QualityConfig, QualityReport};
use crate::Real;
use crate::signal::blocks::{Blocks, folded_in_lanes, mean_of, samples_per_block};
use crate::signal::extent::Extent;
use crate::signal::record::{Count, Track};

/// Blocks after the onset in which a casing falls silent: 100 ms.
const RINGING_BLOCKS: usize = 100;
/// Blocks per step of the envelope, 10 ms: half a period of hum, and more than the beats of a casing's modes. In steps of
/// 5 ms the envelope of one tap may rise by its beats.
const STEP_BLOCKS: usize = 10;
/// Fewest steps of the envelope from which the rule is applied.
const STEPS_MIN: usize = 4;
/// Factor by which the envelope rises above its smallest value so far if there is another tap; that of one tap falls.
const RISE: f64 = 1.35;
/// Standard deviations of the noise that another tap must exceed.
const TAP_SIGMAS: f64 = 6.0;
/// Ratio of the noise before a tap to the noise after it that noise alone does not reach.
const STEADY: f64 = 3.0;
/// Fraction of the peak from which on a sound has begun, and the greatest that can be waited for: a casing's low modes take
/// 0.4 ms to a seventh.
const ONSET: f64 = 0.02;
const ONSET_MAX: f64 = 0.15;
/// Blocks just before the onset that are not searched for another tap, because the onset is known to a fraction of one.
const GUARD_BLOCKS: usize = 2;
/// Frequencies of the mains, Hz.
pub(super) const MAINS_HZ: [f64; 2] = [50.0, 60.0];
/// Fewest blocks in which hum can be distinguished from ringing: 2.5 periods at 50 Hz.
const HUM_BLOCKS: usize = 50;
/// Upper bound of the rounding of a sum of some hundred terms.
const ROUNDED_UP: f64 = 1.0 + 1e-9;
/// Factor by which a line stands above the spectrum three bins beside it.
const LINE: f64 = 5.0;

/// What the rules on the sound need to know.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SoundRecord<'a, C, T> {
    pub track: Track<'a, C>,
    pub extent: Extent<C>,
    /// Baseline, counts.
    pub base: f64,
    /// Samples less their baseline, times the gain.
    pub signal: &'a [T],
    pub gain: f64,
    /// Standard deviation before the trigger, counts; `None` if nothing precedes it.
    pub noise: Option<f64>,
    /// Samples that the baseline is computed from.
    pub baseline_count: Option<usize>,
    /// Onset of the sound according to the force, samples; `None` without a force.
    pub onset: Option<f64>,
    /// Whether the distance from impact to microphone is known.
    pub has_distance: bool,
    pub sample_rate_hz: f64,
    /// Highest frequency that a discriminator uses, Hz.
    pub f_top_hz: f64,
    /// Flags that the tap has already.
    pub known: Quality,
}

impl<C: Count, T> SoundRecord<'_, C, T> {
    /// Greatest magnitude of the signal.
    fn peak(&self) -> f64 {
        let (below, above) = (self.base - self.extent.least.into(), self.extent.largest.into() - self.base);
        self.gain * if below > above { below } else { above }
    }

    /// Block in which the tap begins; without a force, the loudest block.
    fn onset_block(&self, peaks: &[f64]) -> usize {
        let of_force = self
            .onset
            .filter(|&onset| onset >= 0.0)
            .map(|onset| (onset / samples_per_block(self.sample_rate_hz) as f64) as usize);
        of_force.or_else(|| loudest(peaks).map(|(at, _)| at)).unwrap_or(0)
    }

    /// Whether the tap began before the record did, or within its baseline.
    fn is_late(&self, blocks: &Blocks) -> bool {
        let baseline_blocks = self.baseline_count.map_or(0, |count| count / samples_per_block(self.sample_rate_hz));
        let is_in_baseline = || loudest(blocks.peaks()).is_some_and(|(at, _)| at < baseline_blocks);
        self.known.contains(Quality::LATE_TRIGGER) || (self.known.contains(Quality::NO_FORCE) && is_in_baseline())
    }
}

/// Checks a sound; `blocks` are computed from it.
pub(crate) fn check_sound<C: Count, T: Real>(
    sound: &SoundRecord<'_, C, T>,
    blocks: &mut Blocks,
    config: &QualityConfig,
) -> QualityReport {
    let mut report = QualityReport::default();
    if is_clipped(sound.track.samples, sound.extent, sound.base, sound.noise.unwrap_or(0.0)) {
        report.raise(Quality::CLIPPED, config.clipped_sound, &OF_SOUND);
    }
    if sound.sample_rate_hz < 2.0 * sound.f_top_hz {
        report.raise(Quality::UNDERSAMPLED, config.undersampled, &OF_SPECTRUM);
    }
    if sound.baseline_count.is_some_and(|count| stands_still(sound.track.samples, sound.extent, sound.base, count)) {
        report.raise(Quality::DROPOUT, config.dropout, &OF_SOUND);
    }
    let is_late = sound.is_late(blocks);
    if is_late {
        report.raise(Quality::LATE_TRIGGER, config.late_trigger, &[Discriminator::A2]);
    }
    let peak = sound.peak();
    let hum = hum(blocks, config.hum_ratio_max * peak);
    if hum.is_some() {
        report.raise(Quality::HUM, config.hum, &OF_SOUND);
    }
    let neighbour_min = config.neighbour_ratio_max * peak;
    let can_hear_before = !is_late && sound.onset.is_some();
    // Noise persists: what is louder before the tap than after it is not noise.
    let after = noise_after(sound, blocks, hum);
    let quiet = after.filter(|_| hum.is_none());
    let is_ringing_before = can_hear_before
        && quiet.is_some_and(|quiet| {
            let before = sound.noise.map_or(0.0, |noise| noise * sound.gain);
            let limit = greater(neighbour_min, TAP_SIGMAS * quiet);
            before > STEADY * quiet && is_before(sound, blocks.peaks(), limit)
        });
    let noise = if is_ringing_before { quiet } else { noise(sound, after, hum, is_late) };
    if noise.is_some_and(|noise| peak < config.snr_min * noise) {
        report.raise(Quality::LOW_SNR, config.low_snr, &OF_SOUND);
    }
    // Noise alone is no sound, whatever the policy on a low SNR. A sound whose onset is after the record could not be
    // heard.
    let is_due = sound.onset.is_none_or(|onset| onset < sound.signal.len() as f64);
    if is_due && noise.is_some_and(|noise| peak < TAP_SIGMAS * noise) {
        report.raise(Quality::NO_ONSET, Policy::Drop, &OF_SOUND);
    }
    let faint = greater(ONSET * peak, TAP_SIGMAS * noise.unwrap_or(0.0)) + 2.0 * hum.map_or(0.0, |hum| hum.amplitude);
    if !is_late && faint < ONSET_MAX * peak && is_silent_until(sound, config.sound_delay_max_s, faint) {
        report.raise(Quality::SOUND_LATE, config.sound_late, &[Discriminator::A1, Discriminator::A2]);
    }
    // A second hit is heard too; it is not another station's tap.
    if sound.known.contains(Quality::DOUBLE_HIT) {
        return report;
    }
    // A baseline over part of a period of hum is off by up to the hum's amplitude.
    let limit = greater(neighbour_min, TAP_SIGMAS * noise.unwrap_or(0.0)) + 2.0 * hum.map_or(0.0, |hum| hum.amplitude);
    if is_ringing_before || (can_hear_before && is_before(sound, blocks.peaks(), limit)) {
        report.raise(Quality::NEIGHBOUR, config.neighbour, &OF_SOUND);
    }
    // A baseline within the ringing hides how the envelope falls.
    if !is_late && is_after(sound, blocks.peaks(), limit) {
        report.raise(Quality::NEIGHBOUR, config.neighbour, &[Discriminator::A2]);
        report.raise(Quality::NEIGHBOUR, config.neighbour, &OF_SPECTRUM);
    }
    report
}

fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The loudest block by the `peaks`, the last of equals, and its loudness.
fn loudest(peaks: &[f64]) -> Option<(usize, f64)> {
    let mut loudest = (0, *peaks.first()?);
    for (at, &peak) in peaks.iter().enumerate() {
        loudest = if peak >= loudest.1 { (at, peak) } else { loudest };
    }
    Some(loudest)
}

/// Standard deviation of the noise without the `hum`, in the signal's unit: the greater of the noise before the trigger
/// and the noise `after` the ringing. `None` if the record has neither.
fn noise<C, T>(sound: &SoundRecord<'_, C, T>, after: Option<f64>, hum: Option<Hum>, is_late: bool) -> Option<f64> {
    let before = sound.noise.map(|noise| noise * sound.gain).filter(|_| !is_late);
    match (before, after) {
        // The time before the trigger is too short to distinguish hum from noise.
        (Some(before), Some(after)) if hum.is_none() && before > after => Some(before),
        _ => after.or(before),
    }
}

/// Noise after the tap has fallen silent, in the signal's unit: that of the record's third or last quarter, whichever
/// is quieter. `None` if the record ends before.
fn noise_after<C: Count, T>(sound: &SoundRecord<'_, C, T>, blocks: &mut Blocks, hum: Option<Hum>) -> Option<f64> {
    let count = blocks.peaks().len();
    if count / 2 < sound.onset_block(blocks.peaks()).saturating_add(RINGING_BLOCKS) {
        return None;
    }
    let mut noise = |from, to| match hum {
        Some(Hum { amplitude, turns }) => blocks.noise_beside(from, to, amplitude, turns),
        None => blocks.noise(from, to),
    };
    let (third, last) = (noise(count / 2, count * 3 / 4)?, noise(count * 3 / 4, count)?);
    Some(if third < last { third } else { last })
}

/// Hum: a line at a mains frequency.
#[derive(Debug, Clone, Copy)]
struct Hum {
    /// In the signal's unit.
    amplitude: f64,
    /// Periods per block.
    turns: f64,
}

/// Hum above `least` in the second half of the record; `None` if no mains line stands out, or the half is too short.
///
/// A Hann window is right here, because hum goes on; it would be wrong for the tap.
fn hum(blocks: &Blocks, least: f64) -> Option<Hum> {
    let tail = &blocks.means()[blocks.means().len() / 2..];
    if tail.len() < HUM_BLOCKS {
        return None;
    }
    let beside = 3.0 / tail.len() as f64;
    let mean = mean_of(tail);
    if loudest_line(tail, mean) <= least {
        return None; // most clean taps end here
    }
    let turns = MAINS_HZ.map(|f_hz| f_hz / blocks.rate_hz());
    let lines = turns.into_iter().zip(amplitudes(tail, mean, turns)).filter_map(|(turns, line)| {
        if line <= least {
            return None;
        }
        let sides = amplitudes(tail, mean, [turns - beside, turns + beside]);
        let stands_out = |(side, turns): (f64, f64)| turns <= 0.0 || line > LINE * side;
        let mut sides = sides.into_iter().zip([turns - beside, turns + beside]);
        sides.all(stands_out).then_some(Hum { amplitude: line, turns })
    });
    lines.max_by(|a, b| a.amplitude.total_cmp(&b.amplitude))
}

/// Upper bound of the [`amplitudes`] of any sine in the means `tail` of blocks around their `mean`: twice the largest
/// deviation.
fn loudest_line(tail: &[f64], mean: f64) -> f64 {
    ROUNDED_UP * 2.0 * folded_in_lanes(tail, |block_mean| (block_mean - mean).abs(), greater)
}

/// Amplitude of a sine of each of `turns` per block in the means `tail` of blocks around their `mean`, through a Hann window.
///
/// Sines are computed by rotating a complex number from block to block; over a few hundred steps the rounding does not
/// matter. Each step waits for the one before, so two lines cost as much as one.
fn amplitudes<const N: usize>(tail: &[f64], mean: f64, turns: [f64; N]) -> [f64; N] {
    let per_block = TAU / tail.len() as f64;
    let (mut waves, steps) = ([Complex::new(1.0, 0.0); N], turns.map(|turns| Complex::cis(TAU * turns)));
    let (mut window, window_step) = (Complex::cis(0.5 * per_block), Complex::cis(per_block));
    let (mut sums, mut weight) = ([Complex::new(0.0, 0.0); N], 0.0);
    for block_mean in tail {
        let w = 0.5 - 0.5 * window.re;
        for ((sum, wave), step) in sums.iter_mut().zip(&mut waves).zip(&steps) {
            *sum += *wave * (w * (block_mean - mean));
            *wave *= *step;
        }
        weight += w;
        window *= window_step;
    }
    sums.map(|sum| 2.0 * sum.norm() / weight)
}

/// Whether there is sound before the tap.
fn is_before<C: Count, T>(sound: &SoundRecord<'_, C, T>, peaks: &[f64], limit: f64) -> bool {
    let count = sound.onset_block(peaks).saturating_sub(GUARD_BLOCKS);
    peaks.get(..count).is_some_and(|before| before.iter().any(|&peak| peak > limit))
}

/// Whether the sound stays below `limit` until `delay_s` after the onset. False where the onset is not known, as it is not
/// without the distance that the sound travels.
fn is_silent_until<C: Count, T: Real>(sound: &SoundRecord<'_, C, T>, delay_s: f64, limit: f64) -> bool {
    let Some(onset) = sound.onset.filter(|&onset| onset >= 0.0 && sound.has_distance) else { return false };
    let last = (onset + delay_s * sound.sample_rate_hz) as usize;
    sound.signal.get(onset as usize..=last).is_some_and(|first| first.iter().all(|x| x.widened().abs() <= limit))
}

/// Whether the envelope rises again; after a tap it falls.
fn is_after<C: Count, T>(sound: &SoundRecord<'_, C, T>, peaks: &[f64], limit: f64) -> bool {
    let steps = peaks.get(sound.onset_block(peaks)..).unwrap_or_default().chunks_exact(STEP_BLOCKS);
    if steps.len() < STEPS_MIN {
        return false;
    }
    let mut least = f64::INFINITY;
    for step in steps {
        let peak = loudest(step).map_or(0.0, |(_, peak)| peak);
        if peak > RISE * least && peak > limit {
            return true;
        }
        least = if peak < least { peak } else { least };
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a bound below what a line can have, by which hum would be missed: a square wave's line is 4/pi of its
    /// height.
    #[test]
    fn no_line_is_louder_than_the_loudest() {
        for period in 3..300 {
            for phase in 0..8 {
                let turns = 1.0 / f64::from(period);
                let angle = |i: i32| TAU * (turns * f64::from(i) + f64::from(phase) / 8.0);
                for is_square in [false, true] {
                    let mean = |i: i32| if is_square { angle(i).cos().signum() } else { angle(i).cos() };
                    let tail: Vec<f64> = (0..200).map(mean).collect();
                    let middle = tail.iter().sum::<f64>() / 200.0;
                    let ([line], most) = (amplitudes(&tail, middle, [turns]), loudest_line(&tail, middle));
                    assert!(line <= most, "{period}: {line} {most}");
                    if is_square && period == 21 {
                        assert!(line > 0.55 * most, "the bound is no idle one: {line} {most}");
                    }
                }
            }
        }
    }
}
