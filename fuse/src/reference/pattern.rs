//! Which taps a scan has: a reference is cut to them, so that it represents such a scan.

use std::collections::{BTreeMap, BTreeSet};

use crate::ReferenceSet;
use crate::shoulder::conditions::Conditions;

/// The taps of a scan, turn by turn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pattern {
    /// The conditions of the scan and of the reference.
    pub conditions: Conditions,
    /// Locations of each turn, ascending, by condition and rank among the repetitions of that condition.
    pub turns: BTreeMap<(usize, usize), Vec<u32>>,
}

impl Pattern {
    /// All taps of `set`.
    pub(crate) fn of_all(set: &ReferenceSet) -> Self {
        let conditions = Conditions::of(set.taps());
        let mut turns: BTreeMap<(usize, usize), Vec<u32>> = BTreeMap::new();
        for shoulder in &set.shoulders {
            let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
            for condition in set.conditions_of(shoulder, &conditions) {
                let rank = counts.entry(condition).or_default();
                turns.entry((condition, *rank)).or_default().extend(&shoulder.locations);
                *rank += 1;
            }
        }
        for locations in turns.values_mut() {
            locations.sort_unstable();
            locations.dedup();
        }
        Self { conditions, turns }
    }

    /// The locations of all turns.
    pub(crate) fn all_locations(&self) -> BTreeSet<u32> {
        self.turns.values().flatten().copied().collect()
    }

    /// The locations of the turn number `rank` among those of `condition`; `None` where the scan has no such turn.
    pub(crate) fn locations(&self, condition: usize, rank: usize) -> Option<&[u32]> {
        self.turns.get(&(condition, rank)).map(Vec::as_slice)
    }
}
