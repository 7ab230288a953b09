//! How well a tap that is repeated at the same place gives the same value again, as the reference's repetitions tell.

use crate::FuseConfig;
use crate::fit::Kept;
use crate::level::Level;
use crate::shoulder::Shoulder;
use crate::yardstick::Yardstick;

/// Standard deviation of a repeated tap's score, by discriminator: the mean over the conditions that have one.
pub(crate) fn score_sds(yardstick: &Yardstick, repeats: &[Option<f64>]) -> Vec<Option<f64>> {
    let width = yardstick.width();
    let mean = |which: usize| {
        let slots = (which..repeats.len()).step_by(width);
        let sds = slots.filter_map(|slot| Some(repeats[slot]? / yardstick.sigma(slot)?)).filter(|sd| sd.is_finite());
        let (sum, count) = sds.fold((0.0, 0_u32), |(sum, count), sd| (sum + sd, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    };
    (0..width).map(mean).collect()
}

/// Standard deviation of a repeated tap's share of the level, by slot: pooled over the kept places with two taps and more.
pub(crate) fn repeat_sds(
    config: &FuseConfig,
    condition_count: usize,
    reference: &[Shoulder],
    kept: &Kept,
    levels: &[Level],
) -> Vec<Option<f64>> {
    let discriminators = config.directed();
    let width = discriminators.len();
    let mut pooled = vec![(0.0, 0_u32); condition_count * width];
    for ((shoulder, kept), level) in reference.iter().zip(kept).zip(levels) {
        // Count, mean and sum of squares about it, by condition, place and discriminator (Welford): a turn taps place after
        // place in one condition.
        let place_count = shoulder.ring.len();
        let mut sums = vec![(0_u32, 0.0, 0.0); condition_count * place_count * width];
        for tap in shoulder.taps.iter().filter(|tap| kept[tap.place]) {
            let slots = tap.condition * width..;
            let sums = &mut sums[(tap.condition * place_count + tap.place) * width..][..width];
            for ((slot, &(which, _)), (count, mean, squares)) in slots.zip(&discriminators).zip(sums) {
                let Some(share) = tap.values.get(which).and_then(|x| level.share(slot, x)) else { continue };
                *count += 1;
                let off = share - *mean;
                *mean += off / f64::from(*count);
                *squares += off * (share - *mean);
            }
        }
        for (number, (count, _, squares)) in sums.into_iter().enumerate() {
            let (sum, free) = &mut pooled[number / (place_count * width) * width + number % width];
            if count > 1 && f64::is_finite(squares) {
                (*sum, *free) = (*sum + squares, *free + count - 1);
            }
        }
    }
    pooled.into_iter().map(|(sum, free)| (free > 0).then(|| (sum / f64::from(free)).sqrt())).collect()
}
