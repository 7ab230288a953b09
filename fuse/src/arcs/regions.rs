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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_wire::Geometry;

    use super::*;
    use crate::evidence::Vector;

    proptest! {
        #[test]
        fn arcs_are_those_of_a_search_after_each(
            values in prop::collection::vec(
                prop::collection::vec(prop_oneof![9 => -2.0..4.0_f64, 1 => Just(f64::NAN)], 50), 1..3),
            is_ring: bool, count in 1_usize..51, limit in 2.0..5.0_f64
        ) {
            // Catches an arc that is kept although a place of it is taken, over the seam too, and one that is not found again.
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            let ring = Ring::of(geometry, &(0..count as u32).map(|location| (location, None)).collect::<Vec<_>>(), None);
            let vector = |value: &f64| -> Vector { std::array::from_fn(|d| if d == 0 { *value } else { f64::NAN }) };
            let by_offset: Vec<Vec<Vector>> = values.iter().map(|of| of[..count].iter().map(vector).collect()).collect();
            let statistic = ArcStatistic::fit((0..values.len()).collect(), &[], false);
            let maps = statistic.maps(&by_offset);
            let (mut left, mut expected) = (maps.clone(), Vec::new());
            while let Some(arc) = statistic.strongest(&ring, &left).filter(|arc| arc.value >= limit) {
                let places: Vec<usize> = ring.from(arc.start).take(arc.length).collect();
                left.iter_mut().for_each(|map| places.iter().for_each(|&place| map[place] = ABSENT));
                expected.push(arc);
            }
            prop_assert_eq!(arcs_above(&statistic, &ring, &maps, limit), expected);
        }
    }
}
