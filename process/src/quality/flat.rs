//! Flat tops: runs of equal samples where a signal would turn.

use crate::signal::extent::Extent;
use crate::signal::record::Count;

/// Samples in a row at an extreme from which on a channel may be clipped (B1).
const RUN: usize = 3;
/// Differences below this fraction of the greatest one are rounding of single precision.
const GRID: f64 = 1e-5;
/// The lesser extreme counts only if it reaches this fraction of the greater: the silence between impacts is flat too.
const LESSER_FRACTION: f64 = 0.3;
/// Spread of a flat top under noise, from its lowest to its highest sample, in standard deviations of the noise.
const BAND_SIGMAS: f64 = 6.0;
/// Where that spread exceeds this fraction of the extreme, noise hides whether the top is flat.
const BAND_MAX: f64 = 0.1;

/// How steeply a signal must leave a top under noise for the top to count as flat.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Leaving {
    /// How far beside the top to look, in half widths of the top.
    reach: f64,
    /// Factor by which the fall there must exceed a parabola's.
    margin: f64,
    /// How far the fall half way must lie from that of a fourth power (0) towards that of a straight line (1): a signal that was cut has a
    /// corner.
    corner: f64,
}

/// For a force: a single pulse is close to a parabola far beyond its top.
pub(crate) const OF_PULSE: Leaving = Leaving { reach: 1.0, margin: 1.15, corner: 0.28 };
/// For a sound: several modes may add up to a top that is flatter than a parabola, and turns beside it.
const OF_RINGING: Leaving = Leaving { reach: 0.5, margin: 1.5, corner: f64::NEG_INFINITY };
/// Samples that noise may have lifted out of a flat top, to either side.
const JOINED_MAX: usize = 32;
/// Samples beside a flat top from which the converter's step is found.
const BESIDE: usize = 16;

/// Whether the signal of `extent` around `base` is flat at its top or at its bottom.
pub(crate) fn is_clipped<C: Count>(samples: &[C], extent: Extent<C>, base: f64, noise: f64) -> bool {
    let is_flat_at = |at| is_flat(samples, at, extent, base, (noise, OF_RINGING));
    let is_flat = |level| is_extreme(level, extent, base) && extent.position(samples, level, 0).is_some_and(is_flat_at);
    is_flat(extent.largest) || is_flat(extent.least)
}

/// Whether `level` is so far from `base` that the signal may be cut off there.
pub(super) fn is_extreme<C: Count>(level: C, extent: Extent<C>, base: f64) -> bool {
    let (above, below) = (extent.largest.into() - base, base - extent.least.into());
    let greater = if above > below { above } else { below };
    (level.into() - base).abs() >= LESSER_FRACTION * greater
}

/// Whether the signal is cut off at the extreme that it first reaches `at` this sample: by the converter, or by what is in
/// front of it, before `noise` was added.
pub(crate) fn is_flat<C: Count>(samples: &[C], at: usize, extent: Extent<C>, base: f64, noise: (f64, Leaving)) -> bool {
    let level = samples[at];
    if !is_extreme(level, extent, base) || extent.is_constant() {
        return false;
    }
    let mut found = Some(at);
    while let Some(from) = found {
        let next = from + 1 + samples[from + 1..].iter().take_while(|&&x| x == level).count();
        let is_cut = next - from >= RUN && (C::is_rail(level) || leaves(samples, from, next));
        if is_cut {
            return true;
        }
        found = extent.position(samples, level, next);
    }
    is_flat_under_noise(samples, at, base, noise)
}

/// Whether the signal stays near the extreme, first reached at sample `at`, within the noise, for longer than a parabola that then
/// falls as far as the signal does.
///
/// A parabola that has n samples within `d` of its vertex is `d` below it (n - 1)/2 samples away or more; r samples
/// further on it is at most ((n/2 + r)/(n/2 - 1/2))^2 d below. A plateau of the signal's own turns down gently: half way
/// there it has fallen by little. What is cut has a corner.
fn is_flat_under_noise<C: Count>(samples: &[C], at: usize, base: f64, (noise, leaving): (f64, Leaving)) -> bool {
    let level: f64 = samples[at].into();
    let (sign, band) = (if level < base { -1.0 } else { 1.0 }, BAND_SIGMAS * noise);
    let is_narrow = band > 0.0 && band < BAND_MAX * (level - base).abs();
    if !is_narrow {
        return false;
    }
    let below = |x: C| sign * (level - x.into());
    let from = at - samples[..at].iter().rev().take_while(|&&x| below(x) <= band).count();
    let after = at + samples[at..].iter().take_while(|&&x| below(x) <= band).count();
    let half = (after - from) as f64 / 2.0;
    let reach = if half * leaving.reach > 2.0 { (half * leaving.reach).round() as usize } else { 2 };
    let (Some(before), Some(behind)) = (from.checked_sub(reach), samples.get(after + reach - 1)) else { return false };
    let least = leaving.margin * ((half + reach as f64) / (half - 0.5)).powi(2) * band;
    let half_way = reach.div_ceil(2);
    let fallen = below(samples[from - half_way]) / below(samples[before])
        + below(samples[after + half_way - 1]) / below(*behind);
    let (straight, gentle) =
        (half_way as f64 / reach as f64, ((half + half_way as f64) / (half + reach as f64)).powi(4));
    after - from > RUN
        && below(samples[before]) > least
        && below(*behind) > least
        && 0.5 * fallen - gentle > leaving.corner * (straight - gentle)
}

/// Whether the signal leaves the level, at which it stays from `from` to before `after`, by more than rounding
/// explains, on both sides.
///
/// A top that rounding to a step q makes flat for n samples falls by at most q within (n - 1)/2 samples of its vertex. Two
/// samples further on a parabola has fallen by at most ((n + 3)/(n - 1))^2 q, plus half a step of rounding. A pulse may have a
/// plateau of its own, which is flatter than a parabola: a fourth power falls by the square of that. What is cut leaves its
/// level along the slope that it had.
fn leaves<C: Count>(samples: &[C], from: usize, after: usize) -> bool {
    let level: f64 = samples[from].into();
    let n = (after - from) as f64;
    // Noise may lift a sample or two out of a flat top; what counts is where the signal leaves it for good.
    let is_at = |x: &C| (*x).into().total_cmp(&level).is_eq();
    let (mut from, mut after) = (from, after);
    for _ in 0..JOINED_MAX {
        let back = (2..=3).find(|&back| from.checked_sub(back).is_some_and(|i| is_at(&samples[i])));
        let ahead = (1..=2).find(|&ahead| samples.get(after + ahead).is_some_and(is_at));
        from -= back.unwrap_or(0);
        after += ahead.map_or(0, |ahead| ahead + 1);
        if back.is_none() && ahead.is_none() {
            break;
        }
    }
    let Some(before) = from.checked_sub(2).map(|i| samples[i].into()) else { return false };
    let Some(behind) = samples.get(after + 1).map(|&x| x.into()) else { return false };
    let beside = &samples[from.saturating_sub(BESIDE)..samples.len().min(after + BESIDE)];
    let least = (((n + 3.0) / (n - 1.0)).powi(4) + 0.5) * step(beside, level);
    (level - before).abs() > least && (level - behind).abs() > least
}

/// The step of the converter: the greatest common divisor of the distances of all `samples` from `level`. It is nearly
/// 0 for samples that are on no grid.
fn step<C: Count>(samples: &[C], level: f64) -> f64 {
    let distances = || samples.iter().map(|&x| (x.into() - level).abs());
    let greatest = distances().fold(0.0, |a, b| if b > a { b } else { a });
    let nothing = GRID * greatest;
    distances().fold(0.0, |a, b| {
        // Euclid's algorithm. Every second round at least halves the greater, so it ends.
        let (mut a, mut b) = (a, b);
        while b > nothing {
            let rest = a % b;
            // The remainder of a multiple that rounding made too small is nearly b.
            (a, b) = (b, if b - rest < nothing { 0.0 } else { rest });
        }
        a
    })
}

#[cfg(test)]
mod tests {
    use tapline_testing::noise::Noise;

    use super::*;

    fn half_sine(amplitude: f64, width: f64) -> Vec<f64> {
        (0..400)
            .map(|i| (f64::from(i) - 100.3) / width)
            .map(
                |phase| {
                    if (0.0..1.0).contains(&phase) { amplitude * (std::f64::consts::PI * phase).sin() } else { 0.0 }
                },
            )
            .collect()
    }

    fn counts(signal: &[f64]) -> Vec<i16> {
        signal.iter().map(|&x| x.round().clamp(-32_768.0, 32_767.0) as i16).collect()
    }

    fn is_flat_at_top(samples: &[i16], noise: f64) -> bool {
        let extent = Extent::find(samples).unwrap();
        let at = extent.position(samples, extent.largest, 0).unwrap();
        is_flat(samples, at, extent, 0.0, (noise, OF_PULSE))
    }

    fn is_top_flat(samples: &[i16]) -> bool {
        is_flat_at_top(samples, 0.0)
    }

    /// Catches a rule that mistakes the rounding of a coarse converter for clipping, as pyFRF's does, whatever the
    /// peak.
    #[test]
    fn a_coarse_peak_is_not_clipped() {
        for amplitude in 2..400 {
            for width in [20.0, 37.0, 90.0, 250.0] {
                assert!(!is_top_flat(&counts(&half_sine(f64::from(amplitude), width))), "{amplitude} {width}");
            }
        }
    }

    /// Catches a rule that knows only the converter's limit, or only levels below it.
    #[test]
    fn a_cut_peak_is_clipped_at_any_level() {
        for part in [0.5, 0.7, 0.9, 0.97] {
            for amplitude in [400.0, 4000.0, 30_000.0] {
                let cut: Vec<f64> = half_sine(amplitude, 37.0)
                    .iter()
                    .map(|&x| if x < part * amplitude { x } else { part * amplitude })
                    .collect();
                assert!(is_top_flat(&counts(&cut)), "{part} {amplitude}");
            }
        }
        for gain in [1.02, 1.2, 3.0] {
            assert!(is_top_flat(&counts(&half_sine(gain * 32_767.0, 37.0))), "{gain}");
        }
        assert!(!is_top_flat(&counts(&half_sine(32_700.0, 37.0))));
    }

    /// Catches clipping by an amplifier that is missed because noise lies on top of it, and a peak that counts as
    /// clipped because noise has made it flat.
    #[test]
    fn an_amplifier_is_distinguished_from_a_noisy_peak() {
        let mut noise = Noise(7);
        for sigma in [10.0, 30.0, 60.0, 100.0] {
            let mut share = |part: f64| {
                let found = (0..200).filter(|k| {
                    let pulse = half_sine(20_000.0, 33.0 + f64::from(*k) / 10.0);
                    let samples: Vec<i16> = pulse
                        .iter()
                        .map(|&x| (x.clamp(0.0, part * 20_000.0) + sigma * noise.normal()).round() as i16)
                        .collect();
                    is_flat_at_top(&samples, sigma)
                });
                found.count()
            };
            assert!(share(0.7) >= 198 && share(0.85) >= 198, "{sigma}: {} {}", share(0.7), share(0.85));
            assert!(share(1.0) <= 2, "{sigma}: {}", share(1.0));
        }
    }

    /// Catches a plateau that a pulse has of its own, as over a layer that gives way, and that counts as clipping: a fourth
    /// power, with and without noise, in coarse and fine steps.
    #[test]
    fn a_plateau_of_its_own_is_not_clipped() {
        let mut noise = Noise(5);
        for (amplitude, sigma) in [(100.0, 0.0), (1000.0, 0.0), (30_000.0, 0.0), (20_000.0, 20.0), (20_000.0, 60.0)] {
            let mut flagged = 0;
            for k in 0..400 {
                let (middle, half) = (100.0 + f64::from(k) / 400.0, 12.0 + f64::from(k) / 20.0);
                let height = |i: i32| {
                    let x = (f64::from(i) - middle) / half;
                    if x.abs() < 1.0 { amplitude * (1.0 - x.powi(4)) } else { 0.0 }
                };
                let samples: Vec<i16> = (0..400).map(|i| (height(i) + sigma * noise.normal()).round() as i16).collect();
                flagged += u32::from(is_flat_at_top(&samples, if sigma > 0.0 { sigma } else { 0.3 }));
            }
            assert!(flagged <= 4, "{amplitude} {sigma}: {flagged} of 400");
        }
    }

    /// Catches a flat top, formed by three modes, that counts as clipped under a little noise.
    #[test]
    fn a_flat_top_of_modes_is_not_clipped() {
        let mut noise = Noise(11);
        let ringing = |t: f64| {
            let modes = [(300.0, 0.8), (480.0, 0.3), (900.0, 0.3)];
            modes.iter().map(|(f_hz, amplitude)| amplitude * (std::f64::consts::TAU * f_hz * t).sin()).sum::<f64>()
                * (-120.0 * t).exp()
        };
        let mut share = |level: f64| {
            let found = (0..500).filter(|&k| {
                let sample = |i: i32| {
                    let t = (f64::from(i) - 100.0 - f64::from(k) / 500.0) / 40_960.0;
                    (if t < 0.0 { 0.0 } else { ringing(t).clamp(-level, level) }) + 1e-3 * noise.normal()
                };
                let samples: Vec<f32> = (0..1000).map(sample).map(|x| x as f32).collect();
                is_clipped(&samples, Extent::find(&samples).unwrap(), 0.0, 1e-3)
            });
            found.count()
        };
        assert!(share(10.0) <= 1 && share(0.9) >= 495, "{} {}", share(10.0), share(0.9));
    }

    /// Catches a broad and smooth trough, in which two low modes meet, that counts as clipped; and a cut through it that does not.
    #[test]
    fn a_trough_of_low_modes_is_not_clipped() {
        let mut noise = Noise(3);
        for (low_hz, high_hz) in [(180.0, 420.0), (150.0, 330.0), (200.0, 400.0), (180.0, 540.0)] {
            let (mut false_count, mut found_count, count) = (0, 0, 400);
            for _ in 0..count {
                let modes = [
                    (low_hz, 1.0, noise.uniform()),
                    (high_hz, 0.2 + 0.8 * noise.uniform(), noise.uniform()),
                    (900.0, 0.1 * noise.uniform(), noise.uniform()),
                ];
                let ringing = |t: f64| {
                    let of = |&(f_hz, amplitude, phase): &(f64, f64, f64)| {
                        amplitude * (std::f64::consts::TAU * (f_hz * t + phase)).sin()
                    };
                    modes.iter().map(of).sum::<f64>() * (-60.0 * t).exp() * (1.0 - (-3000.0 * t).exp())
                };
                let shift = noise.uniform();
                let mut sound = |level: f64| -> Vec<f32> {
                    let sample = |i: i32| {
                        let t = (f64::from(i) - 100.0 - shift) / 40_960.0;
                        (if t < 0.0 { 0.0 } else { ringing(t).clamp(-level, level) }) + 1e-3 * noise.normal()
                    };
                    (0..1500).map(sample).map(|x| x as f32).collect()
                };
                let whole = sound(f64::INFINITY);
                let peak = whole.iter().fold(0_f32, |a, x| a.max(x.abs()));
                let cut = sound(0.8 * f64::from(peak));
                let is = |samples: &[f32]| is_clipped(samples, Extent::find(samples).unwrap(), 0.0, 1e-3);
                false_count += usize::from(is(&whole));
                found_count += usize::from(is(&cut));
            }
            assert!(
                false_count <= 2 && found_count >= 392,
                "{low_hz} {high_hz}: {false_count} {found_count} of {count}"
            );
        }
    }

    /// Catches a run that the probes step over, anywhere in a record and at its ends.
    #[test]
    fn every_place_is_probed() {
        for place in 0..37 {
            let mut samples = vec![0_i16; 40];
            samples[place..place + 3].fill(32_767);
            assert!(is_top_flat(&samples), "{place}");
            samples[place + 1] = 0;
            assert!(!is_top_flat(&samples), "{place}");
        }
    }

    /// Catches silence taken for a flat bottom.
    #[test]
    fn silence_is_no_extreme() {
        let samples = counts(&half_sine(4000.0, 37.0));
        assert!(!is_clipped(&samples, Extent::find(&samples).unwrap(), 0.0, 0.0));
    }
}
