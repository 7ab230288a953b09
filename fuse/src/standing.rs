//! Whether a shoulder as a whole stands off: from its casing's other shoulder, or its casing from the reference's.
//!
//! A casing that is measured against its own level hides damage all round. What is left to see is that one shoulder lies
//! higher than the other by more than shoulders do, or the casing higher than casings of the reference do.

use crate::FuseConfig;
use crate::level::Level;
use crate::shoulder::{Reading, Shoulder};
use crate::stats::t_quantile;
use crate::yardstick::Yardstick;

/// Spreads of a tap within its shoulder by which a shoulder may lie above the other one.
///
/// A tap scatters by 1 to 5 % of its level about it, so that shoulders which differ by 1 or 2 % stay below; a crack all round
/// that moves every discriminator by less is not seen by it.
const SHOULDER_AT: f64 = 4.0;

/// Part of the rate of false calls that levels may take; the limits on the index have the rest.
const LEVEL_PART: f64 = 0.1;

/// Fewest casings that tell how far levels scatter.
const CASINGS_MIN: usize = 6;

/// Mean score by which one level lies above another, in the direction of damage: of each discriminator the mean over the
/// conditions that both have, in spreads of a tap.
pub(crate) fn above(level: &Level, other: &Level, yardstick: &Yardstick) -> Option<f64> {
    let width = yardstick.width();
    let differences = level.above(other);
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
        (count > 0).then(|| sum / f64::from(count)).filter(|mean: &f64| mean.is_finite())
    };
    let of = |which: usize| {
        let sign = yardstick.discriminators()[which].1.sign();
        let slots = (which..differences.len()).step_by(width);
        mean(&mut slots.filter_map(|slot| Some(sign * differences[slot]? / yardstick.sigma(slot)?)))
    };
    mean(&mut (0..width).filter_map(of))
}

/// For each of the `shoulders` of a casing, whether it lies above any other by more than shoulders do; `levels` are those of
/// all taps of each.
pub(crate) fn stand_off(
    config: &FuseConfig,
    condition_count: usize,
    shoulders: &[Shoulder],
    levels: &[Level],
) -> Vec<bool> {
    if shoulders.len() < 2 {
        return vec![false; shoulders.len()];
    }
    let robust = FuseConfig { index: crate::IndexKind::Robust, ..config.clone() };
    // Each against its own level: how far they lie apart must not become the unit.
    let readings = shoulders.iter().zip(levels).flat_map(|(s, level)| s.taps.iter().map(move |r: &Reading| (level, r)));
    let yardstick = Yardstick::of(&robust, condition_count, readings, &[]);
    let is_above =
        |own: &Level| levels.iter().any(|other| above(own, other, &yardstick).is_some_and(|above| above > SHOULDER_AT));
    levels.iter().map(is_above).collect()
}

/// Mean score by which a casing may lie above the `levels` of the reference's: what a sound one
/// exceeds with a tenth of the chance `false_call_rate`. `None` of fewer than six.
pub(crate) fn level_limit(levels: &[Level], yardstick: &Yardstick, false_call_rate: f64) -> Option<f64> {
    let pooled = Level::pooled(levels);
    let scores: Vec<f64> = levels.iter().filter_map(|level| above(level, &pooled, yardstick)).collect();
    if scores.len() < CASINGS_MIN {
        return None;
    }
    let n = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / n;
    let sd = (scores.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    Some(mean + t_quantile(LEVEL_PART * false_call_rate, n - 1.0) * sd * (1.0 + 1.0 / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Reference;
    use crate::fusion::Fusion;
    use crate::testing::{Casing, records};
    use tapline_wire::{Reasons, Verdict};

    fn judged(casing: &Casing, seed: u64) -> Vec<(Verdict, Reasons)> {
        let plan = casing.plan();
        let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap();
        for record in records(casing, &plan, seed) {
            fusion.push(&record).unwrap();
        }
        let of = |scan| {
            fusion.end(scan).unwrap();
            let judgement = fusion.judge(scan).unwrap().0;
            (Verdict::from_code(judgement.verdict).unwrap(), judgement.reasons)
        };
        (0..plan.scans().len()).map(of).collect()
    }

    #[test]
    fn a_shoulder_cracked_all_round_does_not_pass() {
        // Catches the one hole of a tyre that is compared with itself: half of it is damaged, and none of it stands out.
        let casing = Casing { shoulder_count: 2, cracks: vec![(1, 0..100)], shift: 8.0, ..Casing::default() };
        for seed in 0..5 {
            let judged = judged(&casing, seed);
            assert!(judged[0].1.contains(Reasons::LEVEL_OFF) && judged[0].0 != Verdict::Pass, "{judged:?}");
            assert!(!judged[1].1.contains(Reasons::LEVEL_OFF), "{judged:?}");
        }
    }

    #[test]
    fn sound_shoulders_stand_as_they_do() {
        // Catches a limit below what sound shoulders differ by, and one shoulder that is compared with nothing.
        let two = Casing { shoulder_count: 2, ..Casing::default() };
        for seed in 0..20 {
            assert!(judged(&two, seed).iter().all(|(_, reasons)| !reasons.contains(Reasons::LEVEL_OFF)), "{seed}");
        }
        assert!(!judged(&Casing::default(), 3)[0].1.contains(Reasons::LEVEL_OFF));
    }
}
