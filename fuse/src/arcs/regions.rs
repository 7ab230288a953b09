//! The regions of a shoulder: arcs that stand out, one after the other.

use crate::arcs::statistic::{ARC_MAX, Arc, ArcStatistic, Maps};
use crate::evidence::ABSENT;
use crate::shoulder::ring::Ring;

/// Most arcs that are looked for; more would be damage all round.
const ARCS_MAX: usize = 32;

/// The arcs that reach `limit`, strongest first; none shares a place with another.
pub(crate) fn arcs_above(statistic: &ArcStatistic, ring: &Ring, maps: &Maps, limit: f64) -> Vec<Arc> {
    let mut left = maps.clone();
    let from = |start, left: &Maps| statistic.strongest_from(start, limit.next_down(), ring, left);
    let mut strongest: Vec<Option<Arc>> = (0..ring.len()).map(|start| from(start, &left)).collect();
    let mut found = Vec::new();
    while found.len() < ARCS_MAX
        && let Some(arc) = strongest.iter().flatten().copied().reduce(Arc::stronger)
    {
        let places: Vec<usize> = ring.from(arc.start).take(arc.length).collect();
        for &place in &places {
            left.iter_mut().for_each(|map| map[place] = ABSENT);
        }
        // Arcs from elsewhere have none of these places.
        for (start, strongest) in strongest.iter_mut().enumerate() {
            if ring.from(start).take(ARC_MAX).any(|place| places.contains(&place)) {
                *strongest = from(start, &left);
            }
        }
        found.push(arc);
    }
    found
}

/// How far each place stands out with its neighbours, at the depth where it does most: evidence of this arc of three. NaN
/// where the place has no value.
pub(crate) fn damage_index(statistic: &ArcStatistic, ring: &Ring, maps: &Maps) -> Vec<f64> {
    (0..ring.len()).map(|place| statistic.about(ring, maps, place).max_by(f64::total_cmp).unwrap_or(f64::NAN)).collect()
}
