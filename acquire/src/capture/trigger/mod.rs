//! Finds taps in an endless record of the force: a Schmitt trigger that distinguishes taps from clicks and steps.
//!
//! A tap is a pulse that rises above the level, stays there for a while and falls again. A shorter pulse is a click on the cable;
//! one that does not fall again is a step of the offset, to which the baseline then moves.

mod config;
mod flank;
#[cfg(test)]
mod tests;

pub use config::TriggerConfig;

use flank::flank_at_half;

/// The baseline is the median of this many samples, block by block.
const BASELINE_SAMPLES: usize = 64;

/// Fraction of the peak at which a pulse begins.
const ONSET: f32 = 0.02;

/// Where a tap is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Where the pulse begins: the last sample below 2 % of its peak, counted from the start of the stream.
    pub sample: u64,
    /// Where the rising flank reaches half of the peak, in samples from the start of the stream.
    pub time_samples: f64,
}

/// What was not a tap.
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
    /// No other tap begins before this sample.
    quiet_until: u64,
    /// Where an unfinished pulse within the hold-off began.
    second: Option<u64>,
    /// Where those that ended within the last push began.
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

    /// Sets the trigger `level`, a fraction of full scale, from the next sample on.
    pub fn set_level(&mut self, level: f64) {
        self.release *= level as f32 / self.level;
        self.level = level as f32;
    }

    /// What was no tap until now.
    pub fn not_taps(&self) -> NotTaps {
        self.not_taps
    }

    /// Most samples from a tap's crossing until it is found.
    pub fn delay_samples(&self) -> usize {
        self.pulse_max + 1
    }

    /// Samples after a tap in which there is no other, counted from its crossing of the level.
    pub fn hold_off_samples(&self) -> u64 {
        self.hold_off
    }

    /// Forgets an unfinished pulse: `lost` samples did not come.
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

    /// Where pulses began that ended within the last push and would be taps but for the hold-off.
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
                // The offset has changed from here on.
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

    /// Takes `sample` as one of the baseline.
    fn follow(&mut self, sample: f32) {
        self.block.push(sample);
        if self.block.len() == BASELINE_SAMPLES {
            let (_, median, _) = self.block.select_nth_unstable_by(BASELINE_SAMPLES / 2, f32::total_cmp);
            self.baseline = Some(*median);
            self.block.clear();
        }
    }
}
