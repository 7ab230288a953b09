//! What a shoulder is compared with: minutes on the rig that a reference takes, against misses and false calls.

use anyhow::Result;
use tapline_fuse::FuseConfig;

use crate::chart::Bench;
use crate::chart::casings::{
    Group, Inspected, OFFSETS_MM, VELOCITY_M_PER_S, called_percent, false_call_failure, inspect, missed_percent,
};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Point};
use crate::simulated::{Judging, ScanTaps, Simulator, Times};

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let groups = bench.groups()?;
    let taps = ScanTaps::full(&OFFSETS_MM, &[VELOCITY_M_PER_S], 1);
    let all: Vec<Option<usize>> =
        [None].into_iter().chain(bench.size.reference_sizes.iter().copied().map(Some)).collect();
    let mut found: Vec<(Simulator, Option<usize>, Vec<Inspected>)> = Vec::new();
    for simulator in Simulator::ALL {
        for &casings in &all {
            let configure = |group: &Group| {
                let known = casings.map(|casings| (&group.reference, casings));
                Judging::new(FuseConfig::default(), known, taps.clone())
            };
            found.push((simulator, casings, inspect(groups, simulator, &configure)?));
        }
    }
    let mut facets = Vec::new();
    for simulator in Simulator::ALL {
        let of = || found.iter().filter(move |(of, ..)| *of == simulator);
        let points =
            |error: &dyn Fn(&[Inspected]) -> Result<Error>, n: fn(&Inspected) -> usize| -> Result<Vec<Point>> {
                of().map(|(_, casings, inspected)| point(*casings, &taps, inspected, error(inspected)?, n)).collect()
            };
        facets.push(facet(bench, simulator, true, points(&missed_percent, |i| i.cracked.len())?));
        facets.push(facet(bench, simulator, false, points(&called_percent, |i| i.sound.len())?));
    }
    Ok(Panel::new(
        "How many sound casings must be known?",
        "A shoulder is compared with its own casing, or with sound casings that were scanned before. What does a larger \
         reference buy?",
        [
            "Scans of one turn at each of four offsets, as in the panel `plans`; the reference is scanned likewise. The time is that of \
             scanning its casings once. 2 % of sound shoulders may be called.",
            "A reference whose sound shoulders are called significantly more often than 2 % is hollow. There is no default: a run or a \
             line must name its reference.",
        ],
        facets,
    ))
}

fn point(
    casings: Option<usize>,
    taps: &ScanTaps,
    inspected: &[Inspected],
    error: Error,
    n: fn(&Inspected) -> usize,
) -> Result<Point> {
    let Times { tap_s, offset_s } = Times::default();
    let casing_s = 100.0 * taps.turns.len() as f64 * tap_s + (OFFSETS_MM.len() - 1) as f64 * offset_s;
    let (label, name) = match casings {
        None => ("self".to_owned(), "each casing with itself".to_owned()),
        Some(1) => ("1".to_owned(), "one sound casing".to_owned()),
        Some(casings) => (casings.to_string(), format!("{casings} sound casings")),
    };
    let failures = false_call_failure(&called_percent(inspected)?, FuseConfig::default().re_inspect_rate);
    let cost = Cost::exact(casings.unwrap_or(0) as f64 * casing_s / 60.0);
    Ok(Point::new(name, label, cost, error, inspected.iter().map(n).sum())
        .family(usize::from(casings.is_none()))
        .failing(failures.into_iter().collect()))
}

fn facet(bench: &Bench, simulator: Simulator, is_missed: bool, points: Vec<Point>) -> Facet {
    let (name, title, error) = match is_missed {
        true => ("missed", "Missed cracks", "Cracked shoulders that pass"),
        false => ("called", "False calls", "Sound shoulders not passed"),
    };
    Facet {
        cost: Quantity::linear("Time of the reference on the rig", "min"),
        error: Quantity::linear(error, "%"),
        tolerance: Tolerance { cost: 0.05, error: 1.0 },
        families: vec!["so many sound casings", "each casing by itself"],
        points,
        ..bench.facet(format!("{}-{name}", simulator.name()), format!("{title}, simulator {}", simulator.name()))
    }
}
