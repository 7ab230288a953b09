//! How often a sound shoulder is not passed, against the rate that was stated.
//!
//! References of n casings are drawn from many sound tyres, and every other tyre is judged by each. A shoulder that
//! several references judge counts as one trial in the interval, since its results are not independent.

use crate::statistics::{Rate, clopper_pearson};
use anyhow::{Context as _, Result};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_fuse::{FuseConfig, IndexKind};

use super::candidates::needs_labels;
use super::dataset::Dataset;
use super::judge::{ComparedWith, judge};
use super::parallel::each;
use super::sets::{Set, sound};
use super::size::Size;
use super::table::{Table, cell, ends, yes_or_no};

/// Rates that are stated.
const STATED: [f64; 3] = [0.05, 0.01, 0.001];
/// The rate at which indices are compared, and casings in their reference.
const COMPARED_AT: f64 = 0.05;

/// False calls at one stated rate by references of one size.
#[derive(Debug, Clone)]
pub(super) struct FalseCalls {
    pub index: IndexKind,
    /// Casings in the reference; 0 is each tyre by itself.
    pub casings: usize,
    pub stated: f64,
    /// Shoulders judged, over all draws, and how many of them were not passed.
    pub judged: usize,
    pub calls: usize,
    /// The rate with its interval, each shoulder counted once.
    pub rate: Rate,
}

/// Counts the false calls on the sound tyres of `set`.
pub(super) fn false_calls(set: &Set, size: &Size, seed: u64, threads: usize) -> Result<Vec<FalseCalls>> {
    let serial = |k: usize| format!("sound-{k:03}");
    let tyres = (0..size.sound_tyres).map(|k| sound(serial(k))).collect();
    let dataset = Dataset::scan(&set.simulation, tyres, &size.short, (seed, size.location_count, threads))?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut jobs: Vec<(IndexKind, f64, Vec<String>)> = Vec::new();
    for stated in STATED {
        jobs.push((IndexKind::default(), stated, Vec::new()));
    }
    let widest = size.reference_sizes.iter().copied().max().unwrap_or(0);
    for &casings in &size.reference_sizes {
        for _ in 0..size.draws {
            let drawn = drawn(&mut rng, size.sound_tyres, casings).into_iter().map(serial).collect::<Vec<_>>();
            for stated in STATED {
                jobs.push((IndexKind::default(), stated, drawn.clone()));
            }
            let rest = IndexKind::ALL
                .into_iter()
                .filter(|&i| casings == widest && !needs_labels(i) && i != IndexKind::default());
            jobs.extend(rest.map(|index| (index, COMPARED_AT, drawn.clone())));
        }
    }
    let counted = each(&jobs, threads, |(index, stated, drawn)| {
        let config = FuseConfig { index: *index, false_call_rate: *stated, ..FuseConfig::default() };
        let is_reference = |tyre: &str| drawn.iter().any(|d| d == tyre);
        let by = match drawn.is_empty() {
            true => ComparedWith::Itself,
            false => ComparedWith::File(dataset.reference(false, is_reference)?),
        };
        let judged = judge(&config, &dataset.of_tyres(|tyre| !is_reference(tyre))?, &by)?;
        Ok((judged.len(), judged.iter().filter(|j| !j.is_passed).count()))
    })?;
    let mut calls: Vec<FalseCalls> = Vec::new();
    for ((index, stated, drawn), (judged, called)) in jobs.iter().zip(counted) {
        let is_it =
            |c: &&mut FalseCalls| c.index == *index && c.casings == drawn.len() && c.stated.total_cmp(stated).is_eq();
        match calls.iter_mut().find(is_it) {
            Some(of_it) => {
                of_it.judged += judged;
                of_it.calls += called;
            }
            None => calls.push(FalseCalls {
                index: *index,
                casings: drawn.len(),
                stated: *stated,
                judged,
                calls: called,
                rate: Rate { rate: 0.0, low: 0.0, high: 1.0 },
            }),
        }
    }
    for of_it in &mut calls {
        let shoulders = 2 * size.sound_tyres - 2 * if of_it.casings == size.sound_tyres { 0 } else { of_it.casings };
        let rate = of_it.calls as f64 / of_it.judged as f64;
        let once = clopper_pearson((rate * shoulders as f64).round() as usize, shoulders, 0.95)?;
        of_it.rate = Rate { rate, ..once };
    }
    Ok(calls)
}

/// `count` different numbers below `all`, ascending.
fn drawn(rng: &mut ChaCha8Rng, all: usize, count: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..all).collect();
    for place in 0..count {
        numbers.swap(place, rng.random_range(place..all));
    }
    numbers.truncate(count);
    numbers.sort_unstable();
    numbers
}

/// The table of them.
pub(super) fn table(calls: &[FalseCalls]) -> Result<Table> {
    let mut table = Table::new(
        "false_calls",
        "Sound shoulders that are not passed, against the rate stated; 0 casings are a tyre by itself",
        &["index", "casings", "stated", "rate", "rate_low", "rate_high", "calls", "judged", "consistent"],
    );
    for c in calls {
        let mut row = vec![c.index.name().into(), c.casings.into(), cell(c.stated), cell(c.rate.rate)];
        row.extend(ends(Some((c.rate.low, c.rate.high))));
        row.extend([c.calls.into(), c.judged.into(), yes_or_no(c.rate.low <= c.stated)]);
        table.push(row);
    }
    (!calls.is_empty()).then_some(table).context("no false calls were counted")
}
