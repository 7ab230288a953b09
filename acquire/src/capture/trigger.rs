//! Finds taps in an endless record of the force: a Schmitt trigger, and what tells a tap from a click and from a step.
//!
//! A tap is a pulse that rises above the level, stays there for a while and falls again. What is shorter is a click on the cable;
//! what does not fall again is a step of the offset, to which the baseline then moves.

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::config::refuse;

/// Samples that the baseline is the median of; it is followed block by block.
const BASELINE_SAMPLES: usize = 64;

/// Parts of the peak between which the rising flank is fitted. The time of a tap is where that fit is half of the peak, whatever
/// the peak.
const FLANK: (f64, f64) = (0.2, 0.8);

/// Part of the peak at which a pulse begins.
const ONSET: f32 = 0.02;

/// The part of its greatest sample above which a pulse is fitted to find its peak.
const TOP: f64 = 0.8;

/// When a force pulse is a tap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TriggerConfig {
    /// What the force rises to above its baseline, as a part of full scale.
    pub level: f64,
    /// What it falls below again, as a part of the level.
    pub release: f64,
    /// Shortest time above the release level: what is shorter is a click.
    pub pulse_min_s: f64,
    /// Longest time above the release level: what is longer is a step.
    pub pulse_max_s: f64,
    /// Time from one tap within which there is no other: a rebound belongs to the tap before it.
    pub hold_off_s: f64,
}

impl Default for TriggerConfig {
    fn default() -> Self {
        Self { level: 0.05, release: 0.5, pulse_min_s: 1e-4, pulse_max_s: 0.006, hold_off_s: 0.1 }
    }
}

impl TriggerConfig {
    /// Checks every value against its bounds; `table` is what stands before their names in an error.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self, table: &str) -> Result<(), Error> {
        for (key, value, low, high) in [
            ("level", self.level, 1e-4, 0.9),
            ("release", self.release, 0.05, 0.95),
            ("pulse_min_s", self.pulse_min_s, 0.0, 0.01),
            ("pulse_max_s", self.pulse_max_s, 1e-3, 0.1),
            ("hold_off_s", self.hold_off_s, 0.0, 10.0),
        ] {
            if !(low..=high).contains(&value) {
                return refuse(&format!("{table}.{key}"), value, &format!("from {low} to {high}"));
            }
        }
        Ok(())
    }
}

/// Where a tap is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Where the pulse begins: the last sample below 2 % of its peak, counted from the start of the stream.
    pub sample: u64,
    /// Where the rising flank has half of the peak, in samples from the start of the stream.
    pub time_samples: f64,
}

/// What was no tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NotTaps {
    /// Clicks: pulses that were too short.
    pub clicks: u64,
    /// Steps of the offset.
    pub steps: u64,
}

/// Finds taps in a stream of force samples.
#[derive(Debug, Clone)]
pub struct Trigger {
    level: f32,
    release: f32,
    pulse_min: usize,
    pulse_max: usize,
    hold_off: u64,
    /// Samples that have come.
    count: u64,
    baseline: Option<f32>,
    /// The block whose median becomes the next baseline.
    block: Vec<f32>,
    /// Samples around a pulse that has not ended: some before the crossing, then all since.
    pulse: Vec<f32>,
    /// How many of `pulse` came before the crossing; `None` between pulses.
    before: Option<usize>,
    /// Before this sample there is no other tap.
    quiet_until: u64,
    /// Where a pulse within the hold-off began that has not ended.
    second: Option<u64>,
    /// Where those began that have ended in what was last pushed.
    seconds: Vec<u64>,
    not_taps: NotTaps,
}

impl Trigger {
    /// A trigger for a force that is sampled at `sample_rate_hz`.
    pub fn new(config: &TriggerConfig, sample_rate_hz: f64) -> Self {
        let samples = |seconds: f64| (seconds * sample_rate_hz).round() as usize;
        Self {
            level: config.level as f32,
            release: (config.level * config.release) as f32,
            pulse_min: samples(config.pulse_min_s).max(2),
            pulse_max: samples(config.pulse_max_s).max(3),
            hold_off: samples(config.hold_off_s) as u64,
            count: 0,
            baseline: None,
            block: Vec::with_capacity(BASELINE_SAMPLES),
            pulse: Vec::new(),
            before: None,
            quiet_until: 0,
            second: None,
            seconds: Vec::new(),
            not_taps: NotTaps::default(),
        }
    }

    /// Has taps found at another `level`, a part of full scale, from the next sample on.
    pub fn set_level(&mut self, level: f64) {
        self.release *= level as f32 / self.level;
        self.level = level as f32;
    }

    /// What was no tap until now.
    pub fn not_taps(&self) -> NotTaps {
        self.not_taps
    }

    /// Most samples after its crossing that a tap is found.
    pub fn delay_samples(&self) -> usize {
        self.pulse_max + 1
    }

    /// Samples after a tap in which there is no other, counted from its crossing of the level.
    pub fn hold_off_samples(&self) -> u64 {
        self.hold_off
    }

    /// Forgets what has not ended: `lost` samples did not come.
    pub fn skip(&mut self, lost: u64) {
        self.count += lost;
        (self.baseline, self.before, self.second) = (None, None, None);
        self.block.clear();
        self.pulse.clear();
    }

    /// Takes the next samples of the force, as parts of full scale, and calls `found` for each tap that has ended in them.
    pub fn push(&mut self, force: &[f32], mut found: impl FnMut(Crossing)) {
        self.seconds.clear();
        for &sample in force {
            if let Some(crossing) = self.sample(sample) {
                found(crossing);
            }
        }
    }

    /// Where pulses began that would be taps but for the hold-off, and have ended in what was last pushed.
    pub fn seconds(&self) -> &[u64] {
        &self.seconds
    }

    fn sample(&mut self, sample: f32) -> Option<Crossing> {
        let number = self.count;
        self.count += 1;
        let Some(baseline) = self.baseline else {
            self.follow(sample);
            return None;
        };
        self.pulse.push(sample);
        if let Some(before) = self.before {
            let above = self.pulse.len() - before;
            if sample - baseline < self.release {
                return self.pulse_ended(baseline, before, number - above as u64 + 1);
            }
            if above > self.pulse_max {
                // The offset is another one from here on.
                self.not_taps.steps += 1;
                self.restart();
                self.baseline = None;
            }
            return None;
        }
        if number < self.quiet_until {
            self.hold_off(sample - baseline, number);
        } else if sample - baseline >= self.level {
            self.before = Some(self.pulse.len() - 1);
            return None;
        }
        // Enough is kept to see where the flank began.
        if self.pulse.len() > 2 * self.pulse_max {
            self.pulse.drain(..self.pulse_max);
        }
        // A baseline that followed a rebound would hide the next tap.
        if number >= self.quiet_until {
            self.follow(sample);
        }
        None
    }

    /// Follows the force within the hold-off of a tap, `above` its baseline at sample `number`.
    fn hold_off(&mut self, above: f32, number: u64) {
        let Some(first) = self.second else {
            self.second = (above >= self.level).then_some(number);
            return;
        };
        let count = (number - first) as usize;
        if above < self.release || count > self.pulse_max {
            self.second = None;
            if (self.pulse_min..=self.pulse_max).contains(&count) {
                self.seconds.push(first);
            }
        }
    }

    fn pulse_ended(&mut self, baseline: f32, before: usize, crossing: u64) -> Option<Crossing> {
        // The pulse is taken from where it last lay below the release level.
        let is_below = |&sample: &f32| sample - baseline < self.release;
        let first = self.pulse[..before].iter().rposition(is_below).map_or(0, |below| below + 1);
        let last = self.pulse.len() - 1;
        if last - first < self.pulse_min {
            self.not_taps.clicks += 1;
            self.restart();
            return None;
        }
        let at = flank_at_half(&self.pulse[..last], before, baseline);
        let time_samples = crossing as f64 + at - before as f64;
        let peak = self.pulse[before..last].iter().fold(0.0, |peak: f32, &x| peak.max(x - baseline));
        let is_quiet = |&sample: &f32| sample - baseline < ONSET * peak;
        let onset = self.pulse[..before].iter().rposition(is_quiet).unwrap_or(0);
        (self.quiet_until, self.second) = (crossing + self.hold_off, None);
        self.restart();
        Some(Crossing { sample: crossing - (before - onset) as u64, time_samples })
    }

    fn restart(&mut self) {
        self.before = None;
        self.pulse.clear();
        self.block.clear();
    }

    /// Takes `sample` for one of the baseline.
    fn follow(&mut self, sample: f32) {
        self.block.push(sample);
        if self.block.len() == BASELINE_SAMPLES {
            let (_, median, _) = self.block.select_nth_unstable_by(BASELINE_SAMPLES / 2, f32::total_cmp);
            self.baseline = Some(*median);
            self.block.clear();
        }
    }
}

/// Where the rising flank of `pulse`, whose peak comes after sample `from`, is half of the peak: by parabolas through the top and
/// through the samples of [`FLANK`], so that noise on one of them does not decide.
fn flank_at_half(pulse: &[f32], from: usize, baseline: f32) -> f64 {
    let above = |place: usize| f64::from(pulse[place] - baseline);
    let highest = (from..pulse.len()).max_by(|&a, &b| above(a).total_cmp(&above(b))).unwrap_or(from);
    let is_top = |place: usize| above(place) >= TOP * above(highest);
    let reach = (1..=highest).take_while(|&k| highest + k < pulse.len() && is_top(highest - k) && is_top(highest + k));
    let reach = reach.last().unwrap_or(0);
    let top = Parabola::through((highest - reach..highest + reach + 1).map(above));
    let peak = top.and_then(Parabola::extreme).unwrap_or(above(highest));
    // Down from the peak: the flank begins above its lower end.
    let first = (0..highest).rev().find(|&place| above(place) < FLANK.0 * peak).map_or(0, |below| below + 1);
    let end = (first..highest).find(|&place| above(place) > FLANK.1 * peak).unwrap_or(highest);
    let middle = 0.5 * (first + end) as f64 - 0.5;
    let fitted = Parabola::through((first..end).map(above)).and_then(|flank| flank.root(0.5 * peak));
    // Too steep for a fit: between the two samples around the half.
    fitted.map_or_else(|| between(above, first.saturating_sub(1), highest, 0.5 * peak), |t| middle + t)
}

/// Where a line from sample to sample first reaches `level`, from sample `first` on; `last` where it does not.
fn between(of: impl Fn(usize) -> f64, first: usize, last: usize, level: f64) -> f64 {
    let Some(above) = (first + 1..=last).find(|&place| of(place) >= level) else { return last as f64 };
    let (low, high) = (of(above - 1), of(above));
    if high > low { (above - 1) as f64 + (level - low) / (high - low) } else { above as f64 }
}

/// a + b t + c t^2, where t counts samples from the middle of those it was fitted to.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    a: f64,
    b: f64,
    c: f64,
    /// Greatest magnitude of t.
    reach: f64,
}

impl Parabola {
    /// By least squares; `None` through fewer than four.
    fn through(values: impl ExactSizeIterator<Item = f64>) -> Option<Self> {
        let n = values.len() as f64;
        if n < 4.0 {
            return None;
        }
        let reach = 0.5 * (n - 1.0);
        let (mut y0, mut y1, mut y2, mut t2, mut t4) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (place, y) in values.enumerate() {
            let t = place as f64 - reach;
            (y0, y1, y2) = (y0 + y, y1 + t * y, y2 + t * t * y);
            (t2, t4) = (t2 + t * t, t4 + t * t * t * t);
        }
        // The odd powers of t sum to 0.
        let c = (n * y2 - t2 * y0) / (n * t4 - t2 * t2);
        Some(Self { a: (y0 - c * t2) / n, b: y1 / t2, c, reach })
    }

    /// Its greatest value; `None` where it opens upwards, or has its extreme elsewhere.
    fn extreme(self) -> Option<f64> {
        let Self { a, b, c, reach } = self;
        (c < 0.0 && (0.5 * b / c).abs() <= reach).then(|| a - 0.25 * b * b / c)
    }

    /// Where it rises through `level`; `None` where that is not among the samples.
    fn root(self, level: f64) -> Option<f64> {
        let Self { a, b, c, reach } = self;
        // The form that holds as c goes to 0.
        let t = 2.0 * (level - a) / (b + (b * b + 4.0 * c * (level - a)).sqrt());
        (b > 0.0 && t.abs() <= reach + 1.0).then_some(t)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    const RATE_HZ: f64 = 40_960.0;

    fn noise(rng: &mut ChaCha8Rng, sd: f64) -> f64 {
        let normal: f64 = StandardNormal.sample(rng);
        sd * normal
    }

    /// A force pulse at `t` samples after its start: as a sphere's that springs back, 1 ms long.
    fn pulse(t: f64) -> f64 {
        let width = 1e-3 * RATE_HZ;
        if (0.0..width).contains(&t) { (PI * t / width).sin().powf(1.5) } else { 0.0 }
    }

    /// Where [`pulse`] is half of its peak.
    fn half() -> f64 {
        0.5_f64.powf(1.0 / 1.5).asin() / PI * 1e-3 * RATE_HZ
    }

    fn crossings(config: &TriggerConfig, stream: &[f32], piece: usize) -> (Vec<Crossing>, NotTaps) {
        let mut trigger = Trigger::new(config, RATE_HZ);
        let mut found = Vec::new();
        for chunk in stream.chunks(piece) {
            trigger.push(chunk, |crossing| found.push(crossing));
        }
        (found, trigger.not_taps())
    }

    /// Taps of changing heights at changing parts of a sample, and when each is half of its peak.
    fn taps(count: usize, period: usize, sd: f64, seed: u64) -> (Vec<f32>, Vec<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut stream: Vec<f64> = (0..(count + 1) * period).map(|_| noise(&mut rng, sd)).collect();
        let mut times = Vec::new();
        for tap in 0..count {
            let start = (tap * period + period / 2) as f64 + (tap % 97) as f64 / 97.0;
            let height = 0.3 + 0.6 * (tap % 13) as f64 / 12.0;
            for (place, value) in stream.iter_mut().enumerate().skip(start as usize).take(50) {
                *value += height * pulse(place as f64 - start);
            }
            times.push(start + half());
        }
        (stream.into_iter().map(|x| x as f32).collect(), times)
    }

    #[test]
    fn every_tap_is_found_once_at_its_time() {
        // Catches a tap that is missed, found twice, or found elsewhere, and a result that depends on how the samples come.
        // The lowest taps are 0.3 high. The last noise is 1 % of them: there the bound of Cramer and Rao for a pulse of 1 ms whose
        // height and length are not known is 0.04 samples, so that of thousands the worst is 0.16 off or more, however it is found.
        let config = TriggerConfig { hold_off_s: 0.02, ..TriggerConfig::default() };
        for (number, sd) in [0.0, 1e-4, 2e-4, 5e-4, 1e-3, 3e-3].into_iter().enumerate() {
            let (stream, times) = taps(2000, 2048, sd, number as u64);
            let (found, not_taps) = crossings(&config, &stream, 411);
            assert_eq!((found.len(), not_taps), (times.len(), NotTaps::default()), "noise {sd}");
            let errors = || found.iter().zip(&times).map(|(found, time)| found.time_samples - time);
            let rms = (errors().map(|e| e * e).sum::<f64>() / times.len() as f64).sqrt();
            let worst = errors().map(f64::abs).max_by(f64::total_cmp).unwrap();
            assert!(rms < 0.06 && worst < if sd > 1e-3 { 0.4 } else { 0.1 }, "noise {sd}: {rms}, {worst} samples");
            assert_eq!(found, crossings(&config, &stream, 7).0);
        }
    }

    #[test]
    fn clicks_and_steps_are_no_taps() {
        // Catches a cable's click and a step of the offset taken for taps, and a tap behind them that is missed.
        let (mut stream, times) = taps(40, 4096, 1e-3, 9);
        for (number, place) in (0..40).map(|tap| (tap, tap * 4096 + 500)) {
            match number % 4 {
                0 => stream[place] += 0.8,
                1 => stream[place..].iter_mut().for_each(|x| *x += 0.1),
                2 => stream[place..].iter_mut().for_each(|x| *x -= 0.1),
                _ => stream[place..place + 2].iter_mut().for_each(|x| *x -= 0.5),
            }
        }
        let config = TriggerConfig { hold_off_s: 0.02, ..TriggerConfig::default() };
        let (found, not_taps) = crossings(&config, &stream, 1000);
        assert_eq!(not_taps, NotTaps { clicks: 10, steps: 10 });
        assert_eq!(found.len(), 40);
        for (found, time) in found.iter().zip(&times) {
            assert!((found.time_samples - time).abs() < 0.1, "{found:?} {time}");
        }
    }

    #[test]
    fn a_rebound_belongs_to_its_tap() {
        // Catches a second hit of the impactor that is taken for the next tap or not told, and a clipped pulse that is no tap.
        let (mut stream, times) = taps(20, 8192, 1e-3, 5);
        for (number, time) in times.iter().enumerate() {
            let rebound = *time as usize + 1500;
            for (place, value) in stream[rebound..rebound + 41].iter_mut().enumerate() {
                *value += 0.3 * pulse(place as f64) as f32;
            }
            if number % 2 == 0 {
                stream[*time as usize - 20..rebound].iter_mut().for_each(|x| *x = x.clamp(-0.2, 0.2));
            }
        }
        let (found, not_taps) = crossings(&TriggerConfig::default(), &stream, 256);
        assert_eq!((found.len(), not_taps), (20, NotTaps::default()));
        assert!(found.iter().zip(&times).all(|(found, time)| (found.time_samples - time).abs() < 8.0));
    }

    #[test]
    fn a_gap_in_the_stream_is_counted() {
        // Catches taps behind an overrun that are placed as if nothing had been lost.
        let (stream, times) = taps(20, 4096, 1e-3, 5);
        let config = TriggerConfig::default();
        let mut trigger = Trigger::new(&config, RATE_HZ);
        let mut found = Vec::new();
        trigger.push(&stream[..5 * 4096], |crossing| found.push(crossing));
        trigger.skip(4 * 4096);
        trigger.push(&stream[9 * 4096..], |crossing| found.push(crossing));
        let kept: Vec<f64> = times.iter().copied().filter(|time| !(20_480.0..36_864.0).contains(time)).collect();
        assert_eq!(found.len(), kept.len());
        assert!(found.iter().zip(&kept).all(|(found, time)| (found.time_samples - time).abs() < 0.1));
    }

    #[test]
    fn what_is_no_trigger_is_refused() {
        // Catches a value out of bounds that is let through, or refused without its key.
        for (change, want) in [
            (
                TriggerConfig { level: 0.0, ..TriggerConfig::default() },
                "capture.level is 0; it must be from 0.0001 to 0.9",
            ),
            (TriggerConfig { release: f64::NAN, ..TriggerConfig::default() }, "capture.release is NaN"),
            (TriggerConfig { hold_off_s: 11.0, ..TriggerConfig::default() }, "capture.hold_off_s is 11"),
        ] {
            let error = change.validate("capture").unwrap_err().to_string();
            assert!(error.contains(want), "{error}");
        }
        TriggerConfig::default().validate("capture").unwrap();
    }
}
