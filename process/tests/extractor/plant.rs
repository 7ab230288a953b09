//! Taps of two rigs, and faults planted in them.
//!
//! The simulated rig has the default settings of the model: sound and cracked tyres, noise, hum and scatter.

use std::sync::LazyLock;

use tapline_model::SimulationConfig;
use tapline_wire::Quality;

use crate::other_rig;
pub(crate) use crate::tap::{Tap, peak};
use crate::tap::{rig_with_tyres, tap_on};

pub(crate) const N: usize = 16_384;
pub(crate) const RATE_HZ: f64 = 40_960.0;

/// The default rig with records of [`N`] samples.
pub(crate) fn rig() -> SimulationConfig {
    SimulationConfig { sample_count: N as u32, ..SimulationConfig::default() }
}

/// `count` taps of four sound and four cracked tyres, at three velocities and four offsets, on the rig of `config`.
pub(crate) fn simulated_on(config: &SimulationConfig, count: u32) -> Vec<Tap> {
    let mut rig = rig_with_tyres(config, 3);
    (0..count).map(|k| tap_on(&mut rig, k)).collect()
}

/// Taps of the simulated rig, without those whose velocity happens to be off; faults are planted in them.
pub(crate) static TAPS: LazyLock<Vec<Tap>> = LazyLock::new(|| {
    let mut taps = simulated_on(&rig(), 160);
    taps.retain(|tap| !tap.flags().contains(Quality::VELOCITY_OFF));
    taps
});

/// Taps of the other rig; faults are planted in them.
pub(crate) static OTHERS: LazyLock<Vec<Tap>> = LazyLock::new(|| (0..240).map(other_rig::tap).collect());

/// Numbers of mean 0 and standard deviation 1 that are nearly normal.
pub(crate) fn noise(seed: usize) -> impl Iterator<Item = f64> {
    let mut state = seed as u64;
    std::iter::repeat_with(move || {
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum()
    })
}

/// Adds `part` of `channel` to itself, `lag` samples later, or earlier if `lag` is negative.
pub(crate) fn add_echo(channel: &mut [f64], part: f64, lag: isize) {
    let once = channel.to_vec();
    for (i, x) in channel.iter_mut().enumerate() {
        let from = i as isize - lag;
        *x += part * once.get(from as usize).filter(|_| from >= 0).copied().unwrap_or(0.0);
    }
}

/// Whether three samples in a row have at least the magnitude `level`.
pub(crate) fn has_flat_top(channel: &[f64], level: f64) -> bool {
    channel.windows(3).any(|w| w.iter().all(|&x| x >= level) || w.iter().all(|&x| x <= -level))
}

/// Clips `channel` at `part` of its peak; returns false if fewer than three samples are clipped.
pub(crate) fn cut(channel: &mut [f64], part: f64) -> bool {
    let level = part * peak(channel);
    let is_flat = has_flat_top(channel, level);
    channel.iter_mut().for_each(|x| *x = x.clamp(-level, level));
    is_flat
}

/// Removes the samples of `channel` before `cut`, and extends its end to the old length.
pub(crate) fn begin_at(channel: &mut Vec<f64>, cut: usize) {
    let last = channel[channel.len() - cut..].to_vec();
    channel.drain(..cut);
    channel.extend(last);
}

/// Outcome of planting a fault: `false` if this tap cannot have it.
pub(crate) trait Planted {
    fn planted(self) -> bool;
}

impl Planted for () {
    fn planted(self) -> bool {
        true
    }
}

impl Planted for bool {
    fn planted(self) -> bool {
        self
    }
}

/// Flags of taps with faults.
pub(crate) struct Flags(pub(crate) Vec<Quality>);

impl Flags {
    pub(crate) fn with_fault<P: Planted>(taps: &[Tap], plant: impl Fn(usize, &mut Tap) -> P) -> Self {
        let planted = taps.iter().enumerate().filter_map(|(k, tap)| {
            let mut tap = tap.clone();
            plant(k, &mut tap).planted().then(|| tap.flags())
        });
        let flags: Vec<Quality> = planted.collect();
        assert!(!flags.is_empty(), "no tap can have the fault");
        Self(flags)
    }

    pub(crate) fn share(&self, flag: Quality) -> f64 {
        self.0.iter().filter(|flags| flags.contains(flag)).count() as f64 / self.0.len() as f64
    }

    #[track_caller]
    pub(crate) fn assert_raised(&self, flag: Quality, what: &str) {
        let raised = self.share(flag);
        eprintln!("{what}: {flag} in {raised:.4} of {} taps", self.0.len());
        assert!(raised >= 0.99, "{what}: {flag} in {raised} of taps");
    }
}

/// Checks that `flag` is raised in 99 of 100 planted taps of either rig, and that in the simulated rig any flag except
/// it and `also` is raised in at most 1 of 100.
#[track_caller]
pub(crate) fn assert_flagged<P: Planted>(
    flag: Quality,
    also: &[Quality],
    what: &str,
    plant: impl Fn(usize, &mut Tap) -> P,
) {
    let flags = Flags::with_fault(&TAPS, &plant);
    flags.assert_raised(flag, what);
    for &(other, name) in Quality::ALL.iter().filter(|(other, _)| *other != flag && !also.contains(other)) {
        let raised = flags.share(other);
        if raised > 0.01 {
            eprintln!("{what}: {name} in {raised} of taps");
        }
        assert!(raised <= 0.01, "{what}: {name} in {raised} of taps");
    }
    Flags::with_fault(&OTHERS, &plant).assert_raised(flag, &format!("other rig, {what}"));
}
