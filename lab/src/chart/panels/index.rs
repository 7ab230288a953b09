//! Index and ring rules: processor time of a casing against loss of detection.

use anyhow::{Context as _, Result};
use rayon::prelude::*;
use tapline_fuse::{FuseConfig, Fusion, IndexKind};
use tapline_wire::{Discriminator, Discriminators, Plan, Verdict};

use crate::chart::Bench;
use crate::chart::casings::{Group, Inspected, OFFSETS_MM, Place, VELOCITY_M_PER_S, areas_of, inspect, loss};
use crate::chart::cost::{Workload, by_turns};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Failure, LEVEL, Point, exceeds};
use crate::chart::size::Size;
use crate::evaluation::{FALSE_ALARMS, FoundAt};
use crate::simulated::{Dataset, Judged, Judging, ScanTaps, Scene, Simulator, judge};
use crate::statistics::clopper_pearson;

/// How each place gets one number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rule {
    Index(IndexKind),
    /// An index of the belt edge alone.
    EdgeAlone(IndexKind),
    /// The default index of one discriminator.
    Alone(Discriminator),
}

/// The rules; a short chart tries two discriminators alone.
fn rules(size: &Size) -> Vec<Rule> {
    let mut rules: Vec<Rule> = IndexKind::ALL.map(Rule::Index).into();
    rules.extend(IndexKind::ALL.map(Rule::EdgeAlone));
    let alone = FuseConfig::default().discriminators.into_iter();
    rules.extend(alone.take(if size.is_full { usize::MAX } else { 2 }).map(Rule::Alone));
    rules
}

/// Label of an index next to its point.
fn words(index: IndexKind) -> &'static str {
    if index == IndexKind::Dissertation { "Eqs. 55-56" } else { index.name() }
}

impl Rule {
    fn config(self) -> FuseConfig {
        let default = FuseConfig::default();
        match self {
            Self::Index(index) | Self::EdgeAlone(index) => FuseConfig { index, ..default },
            Self::Alone(which) => FuseConfig { discriminators: vec![which], ..default },
        }
    }

    fn taps(self) -> ScanTaps {
        let offsets = if matches!(self, Self::EdgeAlone(_)) { &OFFSETS_MM[..1] } else { &OFFSETS_MM[..] };
        ScanTaps::full(offsets, &[VELOCITY_M_PER_S], 1)
    }

    fn label(self) -> String {
        match self {
            Self::Index(index) => words(index).to_owned(),
            Self::EdgeAlone(index) => format!("{}, 0 mm", words(index)),
            Self::Alone(which) => format!("{} alone", which.symbol()),
        }
    }

    fn name(self) -> String {
        match self {
            Self::Index(index) => format!("index = \"{}\", four offsets", index.name()),
            Self::EdgeAlone(index) => format!("index = \"{}\", 0 mm alone", index.name()),
            Self::Alone(which) => {
                format!("index = \"{}\" of {} alone, four offsets", IndexKind::default().name(), which.name())
            }
        }
    }

    fn judging(self, size: &Size, group: &Group) -> Result<Judging> {
        Judging::new(self.config(), Some((&group.reference, size.casings.reference)), self.taps())
    }
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let groups = bench.groups()?;
    let rules = rules(&bench.size);
    let costs = costs(bench, groups, &rules)?;
    let mut facets = Vec::new();
    for simulator in Simulator::ALL {
        let (mut points, mut ring) = (Vec::new(), Vec::new());
        let (size, seed) = (&bench.size, bench.seed);
        let failures: Vec<Vec<Failure>> =
            rules.par_iter().map(|&rule| failures(size, seed, groups, simulator, rule)).collect::<Result<_>>()?;
        for ((&rule, &cost), failures) in rules.iter().zip(&costs).zip(failures) {
            let inspected = inspect(groups, simulator, &|group| rule.judging(size, group))?;
            points.push(point(bench, rule, cost, &inspected)?.failing(failures.clone()));
            let of_ring = ring_points(bench, rule, cost, &inspected).into_iter();
            ring.extend(of_ring.map(|point| point.failing(failures.clone())));
        }
        let loss = Quantity::log("Loss of detection, 1 \u{2212} AUC", "");
        let missed = Quantity::linear("Cracked shoulders missed at 5 % false calls", "%");
        for (name, title, error, tolerance, families, points) in [
            ("locations", "Locations", loss, 0.005, ["all discriminators", "one discriminator"], points),
            ("shoulders", "Shoulders", missed, 1.0, ["strongest arc", "largest index of three"], ring),
        ] {
            facets.push(Facet {
                cost: Quantity::log("Processor time of a casing", "\u{b5}s"),
                error,
                tolerance: Tolerance { cost: 0.15, error: tolerance },
                families: families.into(),
                points,
                ..bench
                    .facet(format!("{}-{name}", simulator.name()), format!("{title}, simulator {}", simulator.name()))
            });
        }
    }
    Ok(Panel::new(
        "Which index rates a place, and which rule a shoulder?",
        "Which index ranks locations best, which rule finds the cracked shoulders, and what do they cost?",
        [
            "A scan has one turn at each of four offsets or, like the default, one at 0 mm alone. The reference is that of the panel `plans`. \
             The cost is that of taking in a casing's discriminators, comparing, and judging both shoulders; fitting the reference \
             is not in it.",
            "Ring rules: the strongest arc of 1 to 20 neighbours, which verdicts rest on, and the largest damage index, which is of \
             three neighbours. Both cost the same work. A limit is set so that 5 % of the sound shoulders reach it; what is \
             missed then does not depend on stated rates.",
        ],
        facets,
    ))
}

/// Processor time of each rule, in us, on one casing of the first group.
fn costs(bench: &Bench, groups: &[Group], rules: &[Rule]) -> Result<Vec<Cost>> {
    let group = groups.first().context("there is a group")?;
    let (scene, set) = group.judged.first().context("a group has a sound scene")?;
    let mut prepared: Vec<(Fusion, Plan, Vec<Discriminators>)> = Vec::new();
    for &rule in rules {
        let judging = rule.judging(&bench.size, group)?;
        let Dataset { plan, records } = set.part(0..1, &judging.taps, *scene)?;
        let reference = judging.reference.context("rules need a reference")?;
        prepared.push((Fusion::by(&judging.config, &plan, Some(reference))?, plan, records));
    }
    let workloads: Vec<Workload<'_>> = prepared
        .iter_mut()
        .map(|(fusion, plan, records)| {
            Workload::batch(1, move || {
                // A further attempt each time, so that no earlier result is reused.
                records.iter_mut().for_each(|record| record.id.attempt += 1);
                let is_taken = records.iter().all(|record| fusion.push(record).is_ok());
                let scans = 0..plan.scans().len();
                let is_ended = scans.clone().all(|scan| fusion.end(scan).is_ok());
                let judged =
                    scans.filter_map(|scan| fusion.judge(scan).ok()).map(|(judgement, _)| judgement.strongest_arc);
                if is_taken && is_ended { judged.sum() } else { f64::NAN }
            })
        })
        .collect();
    Ok(by_turns(workloads, bench.size.rounds))
}

/// The locations of `inspected`, each with its index.
fn locations_of(inspected: &[Inspected]) -> Vec<Place> {
    let of = |i: &Inspected| -> Vec<Place> {
        i.sound.iter().chain(&i.cracked).flat_map(|judged| judged.places(i.seed)).collect()
    };
    inspected.iter().flat_map(of).collect()
}

fn point(bench: &Bench, rule: Rule, cost: Cost, inspected: &[Inspected]) -> Result<Point> {
    let (error, n) = loss(bench, &locations_of(inspected))?;
    Ok(Point::new(rule.name(), rule.label(), cost, error, n)
        .family(usize::from(matches!(rule, Rule::Alone(_))))
        .default_if(rule == Rule::EdgeAlone(IndexKind::default())))
}

/// A rule that reduces a ring to one number: its label, its name in a table, the number, and its family.
type RingRule<'a> = (&'a str, &'a str, &'a dyn Fn(&Judged) -> f64, usize);

/// The shoulders of `inspected` by the two ring rules.
fn ring_points(bench: &Bench, rule: Rule, cost: Cost, inspected: &[Inspected]) -> Vec<Point> {
    if matches!(rule, Rule::Alone(_)) {
        return Vec::new();
    }
    let largest = |judged: &Judged| {
        let known = judged.result.index.iter().copied().filter(|index| !index.is_nan());
        known.max_by(f64::total_cmp).unwrap_or(f64::NAN)
    };
    let rules: [RingRule<'_>; 2] = [
        ("arc", "strongest arc", &|judged| judged.result.strongest_arc, 0),
        ("three", "largest index of three neighbours", &largest, 1),
    ];
    let point = |(label, words, score, family): RingRule<'_>| {
        let mut shoulders: Vec<Place> = Vec::new();
        for i in inspected {
            let of = |judged: &Judged, is_cracked| (i.seed, judged.result.tyre.clone(), score(judged), is_cracked);
            shoulders.extend(i.sound.iter().map(|judged| of(judged, false)));
            shoulders.extend(i.cracked.iter().map(|judged| of(judged, true)));
        }
        let areas = |seed| areas_of(&shoulders, seed);
        let all = areas(None);
        let found = all.found_at(FALSE_ALARMS, bench.seed);
        let missed = |found: Option<FoundAt>| found.map_or(f64::NAN, |found| 100.0 * (1.0 - found.rate));
        let by_seed = bench.seeds().map(|seed| missed(areas(Some(seed)).found_at(FALSE_ALARMS, bench.seed))).collect();
        let interval =
            found.and_then(|found| found.interval).map(|(low, high)| (100.0 * (1.0 - high), 100.0 * (1.0 - low)));
        let error = Error { value: missed(found), low: f64::NAN, high: f64::NAN, by_seed }.with_interval(interval);
        Point::new(
            format!("{}, {words}", rule.name()),
            format!("{}, {label}", rule.label()),
            cost,
            error,
            all.count(true),
        )
        .family(family)
        .default_if(rule == Rule::EdgeAlone(IndexKind::default()) && family == 0)
    };
    rules.into_iter().map(point).collect()
}

/// The limits that `rule` fails in the stability cases that break an index.
fn failures(size: &Size, seed: u64, groups: &[Group], simulator: Simulator, rule: Rule) -> Result<Vec<Failure>> {
    // One seed is enough: what breaks an index does so there.
    let groups: Vec<&Group> =
        groups.iter().filter(|group| group.simulator == simulator && group.seed == seed).collect();
    let (mut called, mut all, mut lost) = (0, 0, 0.0);
    for group in &groups {
        let judging = rule.judging(size, group)?;
        let (scene, sound) = group.judged.first().context("a group has a sound scene")?;
        if *scene == Scene::SoundSmooth {
            let judged = judge(&judging, sound, 0..sound.tyres.len(), Scene::Gain08)?;
            called += judged.iter().filter(|judged| judged.result.verdict != Verdict::Pass).count();
            all += judged.len();
        }
        lost += lost_to_outliers(size, group, rule, &judging)? / groups.len() as f64;
    }
    let called = clopper_pearson(called, all, LEVEL)?;
    let stated = FuseConfig::default().re_inspect_rate;
    let cases = [
        exceeds(
            "sound shoulders called where one turn is heard with 0.8 of the gain, lower end of the rate",
            called.low,
            stated,
        ),
        exceeds("C23: AUC lost to two outliers in one discriminator of the reference", lost, 0.005),
    ];
    Ok(cases.into_iter().flatten().collect())
}

/// The AUC that `rule` loses if in two taps of the reference the initial area, or the rule's discriminator, is 20 times the
/// usual and a twentieth of it.
fn lost_to_outliers(size: &Size, group: &Group, rule: Rule, clean: &Judging) -> Result<f64> {
    let which = if let Rule::Alone(which) = rule { which } else { Discriminator::A1 };
    let first = group.reference.first_tap_of(&clean.taps)?;
    let spoiled = group.reference.changed(|tap, of, value| match tap {
        _ if of != which => value,
        tap if tap == first => 20.0 * value,
        tap if tap == first + 1 => value / 20.0,
        _ => value,
    });
    let spoiled = Judging::new(clean.config.clone(), Some((&spoiled, size.casings.reference)), clean.taps.clone())?;
    let area = |judging: &Judging| -> Result<f64> {
        let mut inspected = Inspected { seed: group.seed, sound: Vec::new(), cracked: Vec::new() };
        for (scene, set) in group.judged.iter().filter(|(scene, _)| !scene.is_sound()) {
            inspected.cracked.extend(judge(judging, set, 0..set.tyres.len(), *scene)?);
        }
        areas_of(&locations_of(&[inspected]), None).auc().context("locations of both kinds have an index")
    };
    Ok(area(clean)? - area(&spoiled)?)
}
