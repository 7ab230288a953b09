//! Scan plans: seconds per casing on the rig against cracks that are missed.

use std::collections::BTreeMap;

use anyhow::Result;
use tapline_fuse::{FuseConfig, IndexKind};
use tapline_wire::Verdict;

use crate::chart::Bench;
use crate::chart::casings::{
    Group, Inspected, OFFSETS_MM, VELOCITIES_M_PER_S, VELOCITY_M_PER_S, called_percent, false_call_failure, inspect,
    missed_percent, rate_percent,
};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Guide, Panel, Quantity};
use crate::chart::point::{Cost, Point};
use crate::evaluation::{Cell, Table, cell, ends};
use crate::simulated::{Judged, Judging, ScanTaps, Simulator};

/// Time of the competing method, as its vendors state it.
const SHEAROGRAPHY_S: (f64, f64) = (45.0, 60.0);

const FIXED: usize = 0;
const CONFIRMED: usize = 1;
const DISSERTATION: usize = 2;

struct Tried {
    label: &'static str,
    name: &'static str,
    taps: ScanTaps,
    index: IndexKind,
    is_default: bool,
}

/// Labels of the plans that a short chart tries.
const QUICK: [&str; 5] = ["1 turn", "4 offsets", "50 + 25, again", "adaptive", "Eqs. 55-56, 1 turn"];

/// The plans; a short chart tries a few.
fn tried(is_full: bool) -> Vec<Tried> {
    let v = [VELOCITY_M_PER_S];
    let full = |offsets: &[f64], repetitions| ScanTaps::full(offsets, &v, repetitions);
    let all = |offsets: &[f64]| ScanTaps::full(offsets, &VELOCITIES_M_PER_S, 2);
    let of = |label, name, taps| Tried { label, name, taps, index: IndexKind::default(), is_default: false };
    let coarse = |steps: &[(f64, u32)]| ScanTaps::coarse(steps, VELOCITY_M_PER_S).confirmed();
    let mut tried = vec![
        of("1 turn", "one turn at 0 mm", full(&OFFSETS_MM[..1], 1)),
        of("2 turns", "two turns at 0 mm", full(&OFFSETS_MM[..1], 2)),
        of("0 + 10 mm", "one turn each at 0 and 10 mm", full(&[0.0, 10.0], 1)),
        of("4 offsets", "one turn each at 0, 5, 10 and 15 mm", full(&OFFSETS_MM, 1)),
        of("4 offsets x 2", "two turns each at 0, 5, 10 and 15 mm", full(&OFFSETS_MM, 2)),
        of("50, again", "every 2nd location at 0 mm, what stands out again", coarse(&[(0.0, 2)])),
        of(
            "50 + 25, again",
            "every 2nd location at 0 mm, every 4th at 10 mm, what stands out again",
            coarse(&[(0.0, 2), (10.0, 4)]),
        ),
        of(
            "50 + 50, again",
            "every 2nd location at 0 mm and at 10 mm, what stands out again",
            coarse(&[(0.0, 2), (10.0, 2)]),
        ),
        Tried {
            is_default: true,
            ..of("adaptive", "one turn at 0 mm, what stands out again", ScanTaps::adaptive(VELOCITY_M_PER_S))
        },
        of(
            "100 + 50, again",
            "one turn at 0 mm, every 2nd location at 10 mm, what stands out again",
            coarse(&[(0.0, 1), (10.0, 2)]),
        ),
        of(
            "4 offsets, again",
            "one turn each at 0, 5, 10 and 15 mm, what stands out again",
            full(&OFFSETS_MM, 1).confirmed(),
        ),
        Tried {
            index: IndexKind::Dissertation,
            ..of("Eqs. 55-56, 1 turn", "one turn at 0 mm, the dissertation's index", full(&OFFSETS_MM[..1], 1))
        },
        Tried {
            index: IndexKind::Dissertation,
            ..of(
                "Eqs. 55-56, 4 offsets",
                "one turn each at 0, 5, 10 and 15 mm, the dissertation's index",
                full(&OFFSETS_MM, 1),
            )
        },
        of("0 mm x 3 velocities x 2", "two turns at 0 mm at each of three velocities", all(&OFFSETS_MM[..1])),
        of("full 4 x 3 x 2", "two turns at each of four offsets and three velocities", all(&OFFSETS_MM)),
        Tried {
            index: IndexKind::Dissertation,
            ..of(
                "Eqs. 55-56, full",
                "two turns at each of four offsets and three velocities, the dissertation's index",
                all(&OFFSETS_MM),
            )
        },
    ];
    tried.retain(|plan| is_full || QUICK.contains(&plan.label));
    tried
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let groups = bench.groups()?;
    let (stated, casings) = (FuseConfig::default().re_inspect_rate, bench.size.casings.reference);
    let title = "Every plan by simulator: seconds a casing, cracked shoulders that pass, by kind of crack and casing, and sound shoulders that \
                 do not pass where 2 % is stated";
    let columns = "simulator plan s_mean s_p95 missed missed_low missed_high faint_smooth faint_rough strong_smooth strong_rough \
                   not_passed not_passed_low not_passed_high";
    let mut table = Table::new("plans", title, columns.split(' '));
    let mut facets = Vec::new();
    let plans = tried(bench.size.is_full);
    for simulator in Simulator::ALL {
        let mut points = Vec::new();
        for plan in &plans {
            let configure = |group: &Group| {
                let config = FuseConfig { index: plan.index, ..FuseConfig::default() };
                Judging::new(config, Some((&group.reference, casings)), plan.taps.clone())
            };
            let inspected = inspect(groups, simulator, &configure)?;
            points.push(point(plan, &inspected, stated)?);
            table.push(row(simulator, plan, &inspected)?);
        }
        facets.push(Facet {
            cost: Quantity::log("Time of a casing on the rig", "s"),
            error: Quantity::linear("Cracked shoulders that pass", "%"),
            tolerance: Tolerance { cost: 0.05, error: 1.0 },
            families: vec!["these taps and no others", "what stands out is tapped again", "the dissertation's index"],
            guides: vec![Guide { label: "shearography 45\u{2013}60 s", cost: SHEAROGRAPHY_S }],
            points,
            ..bench.facet(simulator.name(), format!("Cracks of the simulator {}", simulator.name()))
        });
    }
    Ok(Panel {
        name: "plans",
        title: "Which scan plan, and which method?",
        question: "How does the number of missed cracks fall with the seconds of a casing on the rig, if 2 % of sound shoulders may be called?",
        notes: notes(bench),
        facets,
        tables: vec![table],
    })
}

fn notes(bench: &Bench) -> Vec<String> {
    let casings = bench.size.casings;
    let (populations, mix) = match bench.size.is_full {
        true => (
            "smooth and rough",
            "Half of the cracks are faint, and half lie in rough casings: misses depend on that mix.",
        ),
        false => ("smooth alone", "Half of the cracks are faint: misses depend on that mix."),
    };
    vec![
        format!(
            "Each simulator, population ({populations}) and seed has its own casings. {} sound ones make the reference, scanned \
             likewise, but at every location; {} sound ones are judged. {} have faint cracks: 12 to 20 mm deep, 10 to 20 mm long, 1 to 4 \
             locations. {} have strong ones: 3 to 12 mm, 20 to 25 mm, 3 to 10 locations. {mix}",
            casings.reference, casings.sound, casings.cracked, casings.cracked
        ),
        "0.4 s from tap to tap, 3 s to another offset, both shoulders at once. A tap period of 0.25 s, which records of 0.05 s allow, \
         takes five eighths of it."
            .to_owned(),
        "Every plan states the same rate: 2 % of sound shoulders are not passed. A plan that calls significantly more of them is hollow. \
         Shearography's 45 to 60 s are its vendors' figure; what it misses is not published."
            .to_owned(),
        "Records are 0.05 s long, as in docs/rates.md; the panel `recording` shows that longer ones find no more.".to_owned(),
    ]
}

/// Seconds of each casing.
fn seconds(inspected: &[Inspected]) -> Vec<f64> {
    let of_group = |i: &Inspected| -> Vec<f64> {
        let shoulders = i.sound.iter().chain(&i.cracked);
        let of_casing: BTreeMap<&str, f64> =
            shoulders.map(|judged| (judged.result.tyre.as_str(), judged.scan_s)).collect();
        of_casing.into_values().collect()
    };
    inspected.iter().flat_map(of_group).collect()
}

fn point(plan: &Tried, inspected: &[Inspected], stated: f64) -> Result<Point> {
    let called = called_percent(inspected)?;
    let family = match (plan.index, plan.taps.is_confirmed) {
        (IndexKind::Dissertation, _) => DISSERTATION,
        (_, true) => CONFIRMED,
        (_, false) => FIXED,
    };
    let n = inspected.iter().map(|i| i.cracked.len()).sum();
    let remark = format!(
        "sound shoulders not passed: {:.1} % ({:.1} to {:.1}) of {}",
        called.value,
        called.low,
        called.high,
        inspected.iter().map(|i| i.sound.len()).sum::<usize>()
    );
    Ok(Point::new(plan.name, plan.label, Cost::of(&seconds(inspected)), missed_percent(inspected)?, n)
        .family(family)
        .default_if(plan.is_default)
        .failing(false_call_failure(&called, stated).into_iter().collect())
        .remark(remark))
}

fn row(simulator: Simulator, plan: &Tried, inspected: &[Inspected]) -> Result<Vec<Cell>> {
    let times = seconds(inspected);
    let at = |q| tapline_draw::stats::quantile(&times, q);
    let missed = missed_percent(inspected)?;
    let called = called_percent(inspected)?;
    let mut row: Vec<Cell> =
        vec![simulator.name().into(), plan.name.into(), cell(tapline_draw::stats::mean(&times)), cell(at(0.95))];
    row.push(cell(missed.value));
    row.extend(ends(Some((missed.low, missed.high))));
    for kind in ["faint-smooth", "faint-rough", "strong-smooth", "strong-rough"] {
        let is_missed = |j: &Judged| j.result.tyre.starts_with(kind).then_some(j.result.verdict == Verdict::Pass);
        let missed = rate_percent(inspected, |i| &i.cracked, is_missed);
        row.push(cell(missed.ok().map(|missed| missed.value)));
    }
    row.push(cell(called.value));
    row.extend(ends(Some((called.low, called.high))));
    Ok(row)
}
