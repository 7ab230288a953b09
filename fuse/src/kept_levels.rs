//! The levels of a casing's shoulders by those of their places that are kept.

use crate::FuseConfig;
use crate::condition::Conditions;
use crate::fit::Kept;
use crate::level::Level;
use crate::shoulder::{Reading, Shoulder};
use crate::standard::UNTOUCHED_MIN;

/// The level of each shoulder by its `kept` places; that of all together where less than half of its own are kept.
///
/// Shoulders of a casing differ a little. One that is mostly cracked must not be measured against its cracks, so which
/// places are sound is found out with both in one first. Lines across one slab, and parts of a ring, have one level: on a
/// recorded slab of which half a line is cracked, a level for each line took the AUC from 0.99 to 0.86.
///
/// `whole` are the levels of all places of each, `pooled` gives that of all kept ones together.
pub(crate) fn own_levels(
    config: &FuseConfig,
    conditions: &Conditions,
    shoulders: &[Shoulder],
    kept: &Kept,
    whole: &[Level],
    pooled: &mut impl FnMut(&Kept) -> Level,
) -> Vec<Level> {
    let of = |((own, kept_here), whole): ((&Shoulder, &Vec<bool>), &Level)| {
        let count = kept_here.iter().filter(|&&kept| kept).count();
        let is_alone = own.ring.is_closed() && 2 * count > kept_here.len() && count >= UNTOUCHED_MIN;
        match is_alone {
            false => pooled(kept),
            true if count == kept_here.len() => whole.clone(),
            true => level_of(config, conditions, shoulders, kept, |s| std::ptr::eq(s, own)),
        }
    };
    shoulders.iter().zip(kept).zip(whole).map(of).collect()
}

/// The level of each shoulder by all of its places.
pub(crate) fn whole_levels(config: &FuseConfig, conditions: &Conditions, shoulders: &[Shoulder]) -> Vec<Level> {
    let directed = config.directed();
    shoulders.iter().map(|shoulder| Level::of(&directed, conditions.count(), shoulder.taps.iter())).collect()
}

/// The level of the `kept` places of those shoulders that are meant, together.
pub(crate) fn level_of(
    config: &FuseConfig,
    conditions: &Conditions,
    shoulders: &[Shoulder],
    kept: &Kept,
    is_meant: impl Fn(&Shoulder) -> bool,
) -> Level {
    let meant = shoulders.iter().zip(kept).filter(|(shoulder, _)| is_meant(shoulder));
    let readings = meant.flat_map(|(shoulder, kept)| shoulder.taps.iter().filter(|tap: &&Reading| kept[tap.place]));
    Level::of(&config.directed(), conditions.count(), readings)
}
