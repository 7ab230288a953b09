//! How often a sound shoulder is not passed, and rejected, against the rates that were stated.
//!
//! References of n casings are drawn from many sound tyres, and every other tyre is judged by each. A shoulder that
//! several references judge counts as one trial in the interval, since its results are not independent.

use crate::statistics::{Rate, mean_count};
use anyhow::{Context as _, Result};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_fuse::{FuseConfig, IndexKind};

use super::judge::judge;
use super::parallel::each;
use super::sets::{Set, sound};
use super::size::Size;
use crate::evaluation::{Call, Table, cell, ends, yes_or_no};

/// What is called, and the rate that is stated for it.
pub(super) const STATED: [(Call, f64); 3] = [(Call::NotPassed, 0.05), (Call::NotPassed, 0.02), (Call::Rejected, 0.001)];

/// The default configuration with the rate `stated` for `call`.
fn config_for(call: Call, stated: f64) -> FuseConfig {
    match call {
        Call::NotPassed => FuseConfig { re_inspect_rate: stated, ..FuseConfig::default() },
        Call::Rejected => FuseConfig { reject_rate: stated, ..FuseConfig::default() },
    }
}

/// False calls at one stated rate by references of one size.
#[derive(Debug, Clone)]
pub(super) struct FalseCalls {
    pub index: IndexKind,
    /// Casings in the reference; 0: each tyre with itself.
    pub casings: usize,
    pub call: Call,
    pub stated: f64,
    /// Shoulders judged, over all draws, and how many of them were called.
    pub judged: usize,
    pub calls: usize,
    /// The rate with its interval, each shoulder counted once.
    pub rate: Rate,
}

/// Counts the false calls on the sound tyres of `set`.
pub(super) fn false_calls(set: &Set, size: &Size, seed: u64) -> Result<Vec<FalseCalls>> {
    let serial = |k: usize| format!("sound-{k:03}");
    let tyres = (0..size.sound_tyres).map(|k| sound(serial(k))).collect();
    let dataset = size.short.scan(&set.simulation, tyres, (seed, size.location_count))?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = |casings| drawn(&mut rng, size.sound_tyres, casings).into_iter().map(serial).collect();
    // 0 compares each tyre with itself.
    let mut references: Vec<(usize, Vec<Vec<String>>)> = vec![(0, vec![Vec::new()])];
    for &casings in &size.reference_sizes {
        references.push((casings, (0..size.draws).map(|_| draw(casings)).collect()));
    }
    let widest = size.reference_sizes.iter().copied().max().unwrap_or(0);
    let mut counts = Vec::new();
    for index in IndexKind::ALL {
        let shown = references.iter().filter(|(casings, _)| index == IndexKind::default() || *casings == widest);
        let cases: Vec<_> = shown.flat_map(|of_size| STATED.map(|stated| (of_size, stated))).collect();
        let jobs: Vec<_> = (cases.iter().enumerate())
            .flat_map(|(case, &((_, draws), stated))| draws.iter().map(move |drawn| (case, stated, drawn)))
            .collect();
        let counted = each(&jobs, |&(_, (call, stated), drawn)| {
            let config = FuseConfig { index, ..config_for(call, stated) };
            let is_reference = |tyre: &str| drawn.iter().any(|d| d == tyre);
            let by =
                (!drawn.is_empty()).then(|| dataset.reference(&FuseConfig::default(), is_reference)).transpose()?;
            let judged = judge(&config, &dataset.of_tyres(|tyre| !is_reference(tyre))?, by.as_ref())?;
            Ok((judged.len(), judged.iter().filter(|j| call.is(j.verdict)).count()))
        })?;
        for (case, &(&(casings, _), (call, stated))) in cases.iter().enumerate() {
            let of_case = || jobs.iter().zip(&counted).filter(|((of, ..), _)| *of == case).map(|(_, count)| count);
            let (judged, calls): (usize, usize) =
                (of_case().map(|count| count.0).sum(), of_case().map(|count| count.1).sum());
            let shoulders = 2 * (size.sound_tyres - casings);
            let rate = mean_count(calls as f64 / judged as f64 * shoulders as f64, shoulders, 0.95)?;
            counts.push(FalseCalls { index, casings, call, stated, judged, calls, rate });
        }
    }
    Ok(counts)
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

pub(super) fn table(calls: &[FalseCalls]) -> Result<Table> {
    let mut table = Table::new(
        "false_calls",
        "Sound shoulders that are not passed, and that are rejected, against the stated rate; with 0 casings, each tyre is compared \
         with itself",
        ["index", "casings", "call", "stated", "rate", "rate_low", "rate_high", "calls", "judged", "consistent"],
    );
    for c in calls {
        let mut row =
            vec![c.index.name().into(), c.casings.into(), c.call.name().into(), cell(c.stated), cell(c.rate.rate)];
        row.extend(ends(Some((c.rate.low, c.rate.high))));
        row.extend([c.calls.into(), c.judged.into(), yes_or_no(c.rate.low <= c.stated)]);
        table.push(row);
    }
    (!calls.is_empty()).then_some(table).context("no false calls were counted")
}
