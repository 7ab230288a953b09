//! Whether a scan gave all that it should: a sensor may be dead or stuck, or a location without its features.

use tapline_wire::{Discriminator, TapId};

use crate::fusion::Fusion;
use crate::shoulder::ring::Ring;

impl Fusion {
    /// Whether scan number `scan` lacks what the index asks for, although its channels are recorded: a discriminator is absent
    /// from more than half of the planned taps, or one and the same at more than half of those that have it; or a location
    /// lacks more than half of what its taps should have given, or two neighbours one discriminator of most of their taps, in all taps
    /// or in those at the belt edge, where cracks begin.
    pub(super) fn lacks_features(&self, scan: usize) -> bool {
        let channels = &self.plan.recording.channels;
        let recorded = |which: &Discriminator| which.channels().iter().all(|channel| channels.contains(channel));
        let asked: Vec<Discriminator> = self.config.discriminators.iter().copied().filter(recorded).collect();
        let locations = &self.plan.scans()[scan].locations;
        let offset_mm = |id: &TapId| id.offset_mm().map_or(f64::INFINITY, f64::abs);
        let edge_mm = self.entering(scan).map(|(_, id)| offset_mm(&id)).min_by(f64::total_cmp);
        // In all taps, and in those at the belt edge, by location: how often each discriminator was given, and how many taps were due.
        let none = vec![(vec![0_usize; asked.len()], 0_usize); locations.len()];
        let mut planned = [none.clone(), none];
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); asked.len()];
        let mut tap_count = 0;
        for (row, id) in self.entering(scan) {
            let Ok(place) = locations.binary_search_by_key(&id.location, |&(location, _)| location) else { continue };
            tap_count += 1;
            let is_edge = edge_mm.is_some_and(|edge_mm| offset_mm(&id).total_cmp(&edge_mm).is_eq());
            let seen = self.seen[row as usize].as_ref();
            for counted in planned.iter_mut().take(if is_edge { 2 } else { 1 }) {
                let (given, due) = &mut counted[place];
                *due += 1;
                for (which, given) in asked.iter().zip(given) {
                    *given += usize::from(seen.is_some_and(|seen| seen.values.get(*which).is_some()));
                }
            }
            for (which, values) in asked.iter().zip(&mut values) {
                values.extend(seen.and_then(|seen| seen.values.get(*which)));
            }
        }
        values.iter().any(|values| 2 * values.len() < tap_count || has_majority(values))
            || planned.iter().any(|planned| lack(planned, &self.rings[scan]))
    }
}

/// Whether a location lacks more than half of what its taps should have given, or two neighbours one discriminator of most of their taps:
/// how often each was `given`, and how many taps were due.
fn lack(planned: &[(Vec<usize>, usize)], ring: &Ring) -> bool {
    // What is absent at one location may be chance, where that has a tap or two.
    let lacks_one: Vec<bool> = planned.iter().map(|(given, due)| given.iter().any(|given| 2 * given < *due)).collect();
    let is_block = |place: usize| ring.with_neighbours(place).filter(|&near| lacks_one[near]).count() > 1;
    planned.iter().any(|(given, due)| 2 * given.iter().sum::<usize>() < given.len() * due)
        || (0..planned.len()).any(|place| lacks_one[place] && is_block(place))
}

/// Whether more than half of `values`, and more than one, are one and the same.
fn has_majority(values: &[f64]) -> bool {
    // Each value that differs takes one vote away: only one that has a majority is sure to be left (Boyer and Moore 1981).
    let (mut left, mut votes) = (0, 0_usize);
    for value in values.iter().map(|value| value.to_bits()) {
        match votes {
            0 => (left, votes) = (value, 1),
            _ if value == left => votes += 1,
            _ => votes -= 1,
        }
    }
    let alike = values.iter().filter(|value| value.to_bits() == left).count();
    alike > 1 && 2 * alike > values.len()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_majority_is_that_of_the_sorted_values(values in prop::collection::vec(0..3_u8, 0..12)) {
            // Catches a majority that is voted down, one of a single value, and half taken for more.
            let mut values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let found = has_majority(&values);
            values.sort_by(f64::total_cmp);
            let alike = values.chunk_by(|a, b| a.total_cmp(b).is_eq()).map(<[f64]>::len).max().unwrap_or(0);
            prop_assert_eq!(found, alike > 1 && 2 * alike > values.len());
        }
    }
}
