//! Dropouts: stretches of one value in a channel whose noise never stays constant for so long.

use super::flat::is_extreme;
use crate::signal::extent::Extent;
use crate::signal::record::Count;
use crate::signal::wide::Kernel;

/// Fewest equal samples in a row that count as a dropout, 0.3 ms at 40 kHz.
const RUN_MIN: usize = 12;
/// In noise where a sample equals the previous one with probability p, a run of r equal samples begins at a given sample with
/// probability p^(r - 1). A dropout is a run of probability exp(-40): of rumble, whose samples follow each other, a longer
/// record than any has none.
const LN_IMPROBABLE: f64 = -40.0;
/// Fewest pairs of neighbours from which p is computed.
const PAIRS_MIN: usize = 16;
/// Most samples before the trigger that are looked at: they give p to within a hundredth or two.
const QUIET_MAX: usize = 1024;
/// Samples of a probe: every run of [`RUN_MIN`] has a whole one.
const PROBE: usize = 4;
/// Probes that are looked at together: most have none of one value.
const PROBES: usize = 16;

/// Whether the channel stands still somewhere although its first `quiet_count` samples have noise.
///
/// A run at an extreme is not a dropout but clipping.
pub(crate) fn stands_still<C: Count>(samples: &[C], extent: Extent<C>, base: f64, quiet_count: usize) -> bool {
    let quiet = &samples[..quiet_count.min(QUIET_MAX).min(samples.len())];
    let (probes, _) = samples.as_chunks::<PROBE>();
    let (mut next, mut unexplained) = (0, None);
    while let Some(number) = (Still { probes, from: next }).wide() {
        let at = number * PROBE;
        let level = samples[at];
        let from = at - samples[..at].iter().rev().take_while(|&&x| x == level).count();
        let after = at + samples[at..].iter().take_while(|&&x| x == level).count();
        // All probes until then are of this run, which has this one at least.
        next = after.div_ceil(PROBE).max(number + 1);
        let is_end = level == extent.largest || level == extent.least;
        let is_clipped = is_end && is_extreme(level, extent, base);
        // Few channels have so long a run, and only for theirs it matters how often the noise repeats a sample.
        if after - from >= RUN_MIN && !is_clipped {
            let Some(run_min) = *unexplained.get_or_insert_with(|| unexplained_run(quiet)) else { return false };
            if (after - from) as f64 >= run_min {
                return true;
            }
        }
    }
    false
}

/// How many equal samples in a row the noise of `quiet` does not explain, which may be fewer than [`RUN_MIN`]; `None` if it has too
/// little noise to say.
fn unexplained_run<C: Count>(quiet: &[C]) -> Option<f64> {
    let (mut equal_count, mut run, mut longest) = (0, 0, 0);
    for [before, x] in quiet.array_windows() {
        run = if before == x { run + 1 } else { 0 };
        equal_count += usize::from(before == x);
        longest = longest.max(run);
    }
    // Without the longest run, which may itself be a dropout.
    let pair_count = quiet.len().checked_sub(1 + longest).filter(|&count| count >= PAIRS_MIN)?;
    let p = (equal_count - longest + 1) as f64 / (pair_count + 2) as f64;
    Some(1.0 + LN_IMPROBABLE / p.ln())
}

/// The first probe from number `from` on that has one value.
struct Still<'a, C> {
    probes: &'a [[C; PROBE]],
    from: usize,
}

impl<C: Count> Kernel for Still<'_, C> {
    type Output = Option<usize>;

    #[inline(always)]
    fn run(self) -> Option<usize> {
        let Self { probes, from } = self;
        let (stretches, _) = probes.get(from..)?.as_chunks::<PROBES>();
        let none = |stretch: &&[[C; PROBE]; PROBES]| {
            let mut is_any = false;
            for &probe in *stretch {
                is_any |= C::are_equal(probe);
            }
            !is_any
        };
        let begin = from + PROBES * stretches.iter().take_while(none).count();
        Some(begin + probes[begin..].iter().position(|&probe| C::are_equal(probe))?)
    }
}

#[cfg(test)]
mod tests {
    use tapline_testing::noise::Noise;

    use super::*;

    /// Whether noise of `sigma` counts stands still, with `value` in `hole`.
    fn still(sigma: f64, hole: std::ops::Range<usize>, value: i16) -> bool {
        let mut noise = Noise(3);
        let mut samples: Vec<i16> = (0..20_000).map(|_| (100.0 + sigma * noise.normal()).round() as i16).collect();
        samples[15_000] = 5000;
        samples[hole].fill(value);
        stands_still(&samples, Extent::find(&samples).unwrap(), 100.0, 384)
    }

    /// Catches a dropout that is missed because of its place, its length or its value, and one in the quiet time itself.
    #[test]
    fn a_channel_that_stands_still_is_found() {
        for from in [0, 3, 100, 380, 7000, 19_900] {
            for value in [0, 100, 90] {
                assert!(still(20.0, from..from + 40, value), "{from} {value}");
            }
        }
        assert!((0..PROBE).all(|shift| still(20.0, 5000 + shift..5012 + shift, 0)), "the shortest, at every place");
        assert!(still(20.0, 100..113, 0), "a short one in the quiet time, which is no noise of its own");
    }

    /// Catches quiet noise taken for a dropout, and a channel without noise that is said to stand still.
    #[test]
    fn noise_of_any_strength_is_none() {
        for sigma in [0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 20.0] {
            assert!(!still(sigma, 0..0, 0), "{sigma}");
        }
        assert!(!still(0.0, 5000..9000, 100) && !still(20.0, 5000..5008, 0));
    }

    /// Catches clipping that counts as a dropout.
    #[test]
    fn a_run_at_an_extreme_is_clipping() {
        assert!(!still(20.0, 14_990..15_010, 5000));
    }
}
