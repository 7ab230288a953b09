//! Whether a scan gave all that it should: a sensor may be dead or stuck, or a location without its discriminators.

use tapline_wire::Discriminator;

use crate::fusion::Fusion;

/// What came of one location: how often each discriminator was given, and how many taps were due.
#[derive(Debug, Clone)]
struct Given {
    counts: Vec<usize>,
    due: usize,
}

impl Fusion {
    /// Whether scan number `scan` lacks what the index asks for, although its channels are recorded: a discriminator is absent
    /// from more than half of the planned taps, or one and the same at more than half of those that have it; or a location
    /// lacks more than half of what its taps should have given, or two neighbours one discriminator of most of their taps, in all taps
    /// or in those at the belt edge, where cracks begin.
    pub(super) fn lacks_discriminators(&self, scan: usize) -> bool {
        let asked = self.asked();
        let values = |which: Discriminator| -> Vec<f64> {
            let seen = self.rows_entering(scan).filter_map(|row| self.seen[row as usize].as_ref());
            seen.filter_map(|seen| seen.values.get(which)).collect()
        };
        let tap_count = self.rows_entering(scan).count();
        let is_bad = |values: &[f64]| 2 * values.len() < tap_count || has_majority(values);
        let lacks = |is_edge_only: bool| self.lacking(scan, is_edge_only).contains(&true);
        asked.into_iter().any(|which| is_bad(&values(which))) || lacks(false) || lacks(true)
    }

    /// Whether each location of scan number `scan` lacks more than half of what its taps should have given, those at the belt edge if
    /// `is_edge_only`, or with a neighbour one discriminator of most of them.
    pub(super) fn lacking(&self, scan: usize, is_edge_only: bool) -> Vec<bool> {
        let asked = self.asked();
        let locations = &self.plan.scans()[scan].locations;
        let mut given = vec![Given { counts: vec![0; asked.len()], due: 0 }; locations.len()];
        for (row, id) in if is_edge_only { self.at_edge(scan) } else { self.entering(scan).collect() } {
            let Ok(place) = locations.binary_search_by_key(&id.location, |&(location, _)| location) else { continue };
            let Given { counts, due } = &mut given[place];
            *due += 1;
            let seen = self.seen[row as usize].as_ref();
            for (which, count) in asked.iter().zip(counts) {
                *count += usize::from(seen.is_some_and(|seen| seen.values.get(*which).is_some()));
            }
        }
        // What is absent at one location may be chance, where that has a tap or two.
        let lacks_one: Vec<bool> = given.iter().map(|of| of.counts.iter().any(|count| 2 * count < of.due)).collect();
        let ring = &self.rings[scan];
        let is_block = |place: usize| ring.with_neighbours(place).filter(|&near| lacks_one[near]).count() > 1;
        let lacks_most = |of: &Given| 2 * of.counts.iter().sum::<usize>() < of.counts.len() * of.due;
        (0..given.len()).map(|place| lacks_most(&given[place]) || lacks_one[place] && is_block(place)).collect()
    }

    /// The discriminators that the index asks for and whose channels are recorded.
    fn asked(&self) -> Vec<Discriminator> {
        let channels = &self.plan.recording.channels;
        let recorded = |which: &Discriminator| which.channels().iter().all(|channel| channels.contains(channel));
        self.config.discriminators.iter().copied().filter(recorded).collect()
    }
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
