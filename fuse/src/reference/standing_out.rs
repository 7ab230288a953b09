//! Casings of a reference that stand out from the others: they may be cracked, and limits based on them hide cracks.

use std::cmp::Ordering;

use crate::arcs::limits::Limits;
use crate::reference::fitted::{FittedReference, dealt};
use crate::shoulder::Shoulder;
use crate::verdict::whole_shoulder::{SoundLevels, SoundPlaces};

/// Probability that a sound casing stands out by an arc, or by the level of a shoulder. Below the rate at which shoulders are
/// rejected: a reference has many casings, and without its widest ones its limits are too narrow.
const RATE: f64 = 1e-4;

/// The numbers of the casings of `shoulders`, which taught `fitted`, that stand out from the others, ascending.
pub(super) fn standing_out(fitted: &FittedReference, shoulders: &[Shoulder]) -> Vec<usize> {
    let mut found = by_arcs(fitted);
    found.extend(by_levels(fitted, shoulders));
    found.sort_unstable();
    found.dedup();
    found
}

/// The casings whose strongest arc, judged by other casings, is beyond the limit of those that stand out less.
///
/// Several cracked casings widen each other's limits, so the comparison begins with the half that stands out least.
fn by_arcs(fitted: &FittedReference) -> Vec<usize> {
    let mut casings: Vec<&[(usize, f64)]> = fitted.strongest.chunk_by(|a, b| a.0 == b.0).collect();
    let strongest = |casing: &[(usize, f64)]| casing.iter().map(|(_, value)| *value).max_by(f64::total_cmp);
    casings.sort_by(|a, b| strongest(a).partial_cmp(&strongest(b)).unwrap_or(Ordering::Equal));
    let stands_out = |&count: &usize| {
        let lesser: Vec<f64> = casings[..count].concat().iter().map(|(_, value)| *value).collect();
        strongest(casings[count]) >= Some(Limits::by(&lesser, count, fitted.white).at(RATE))
    };
    let first = (casings.len().div_ceil(2).max(1)..casings.len()).find(stands_out);
    first.map_or_else(Vec::new, |first| casings[first..].iter().map(|casing| casing[0].0).collect())
}

/// The casings whose levels, judged by other casings, are off: the one that is farthest off first, then the next without it.
fn by_levels(fitted: &FittedReference, shoulders: &[Shoulder]) -> Vec<usize> {
    let mut kept: Vec<&Shoulder> = shoulders.iter().collect();
    let mut found = Vec::new();
    for _ in 0..shoulders.len() {
        let casings: Vec<&[&Shoulder]> = kept.chunk_by(|a, b| a.casing == b.casing).collect();
        let mut least = Vec::new();
        for (group, others) in dealt(&casings) {
            let others: Vec<_> = others.into_iter().flatten().map(|other| SoundPlaces::known(other)).collect();
            let levels = SoundLevels::fit(&fitted.setup, &others);
            for casing in group {
                let places: Vec<SoundPlaces<'_>> = casing.iter().map(|shoulder| SoundPlaces::known(shoulder)).collect();
                let of = |place: usize| levels.probability(&places[place], places.get(1 - place));
                let of_casing = (0..places.len().min(2)).filter_map(of).min_by(f64::total_cmp);
                least.extend(of_casing.map(|least| (casing[0].casing, least)));
            }
        }
        let farthest = least.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((number, _)) = farthest.filter(|(_, probability)| *probability < RATE) else { break };
        kept.retain(|shoulder| shoulder.casing != number);
        found.push(number);
    }
    found
}
