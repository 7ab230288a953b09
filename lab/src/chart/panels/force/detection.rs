//! What estimators of the force are worth to detection: tau alone, and the index with one of them changed.

use anyhow::{Context as _, Result};
use rayon::prelude::*;
use tapline_fuse::{FuseConfig, Reference};
use tapline_plate::ScanShape;
use tapline_process::ProcessConfig;
use tapline_wire::Discriminator;

use super::{Way, failures};
use crate::chart::Bench;
use crate::chart::casings::VELOCITY_M_PER_S;
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Quantity};
use crate::chart::point::{Cost, Error, Point};
use crate::evaluation::Areas;
use crate::simulated::{
    Judging, Reading, ScanTaps, Scene, Set, Simulator, Times, Tyre, alone_of, judge, reference, simulate,
};

/// The casings: faint cracks in smooth ones.
const SCENE: Scene = Scene::FaintSmooth;

/// A location: its seed and casing, a score, and whether there is a crack.
type Place = (u64, String, f64, bool);

/// What a way gives of every location.
#[derive(Debug, Default)]
pub(super) struct Found {
    alone: Vec<Place>,
    index: Vec<Place>,
}

/// What each of `ways` gives of the casings of every seed.
pub(super) fn found(bench: &Bench, simulator: Simulator, ways: &[Way]) -> Result<Vec<Found>> {
    let shape = ScanShape {
        offsets_mm: vec![0.0],
        velocities_m_per_s: vec![VELOCITY_M_PER_S],
        repetitions: 2,
        ..ScanShape::default()
    };
    let taps = ScanTaps::full(&shape.offsets_mm, &shape.velocities_m_per_s, shape.repetitions);
    let reading = |way: &Way| {
        let process = ProcessConfig { f_max: way.config.f_max, tau: way.config.tau, ..ProcessConfig::default() };
        Reading { process, bits: None }
    };
    let readings: Vec<Reading> = ways.iter().map(reading).collect();
    let mut found: Vec<Found> = ways.iter().map(|_| Found::default()).collect();
    for seed in bench.seeds() {
        let tyres = SCENE.tyres(shape.location_count, 2 * bench.size.casings.cracked, seed);
        let casings = bench.size.recorded.reference;
        let sound: Vec<Tyre> = (0..casings).map(|k| Tyre::sound(format!("reference-{k:03}"))).collect();
        let cracked = simulate(simulator, SCENE, &shape, &tyres, seed, &readings)?;
        let known = simulate(simulator, SCENE.reference_scene(), &shape, &sound, seed, &readings)?;
        let jobs: Vec<(&Set, &Set)> = cracked.iter().zip(&known).collect();
        let of_ways: Vec<Found> =
            jobs.into_par_iter().map(|(set, known)| of_way(set, known, &taps, seed, casings)).collect::<Result<_>>()?;
        for (all, of_seed) in found.iter_mut().zip(of_ways) {
            all.alone.extend(of_seed.alone);
            all.index.extend(of_seed.index);
        }
    }
    Ok(found)
}

fn of_way(set: &Set, known: &Set, taps: &ScanTaps, seed: u64, casings: usize) -> Result<Found> {
    let config = FuseConfig::by(Reference::Own);
    let reference = Some(reference(&config, known, casings, taps)?);
    let judging = Judging { config, reference, taps: taps.clone(), times: Times::default() };
    let mut found = Found::default();
    for judged in judge(&judging, set, 0..set.tyres.len(), SCENE)? {
        let places = judged.index.iter().zip(&judged.is_cracked);
        found.index.extend(places.map(|(index, is_cracked)| (seed, judged.tyre.clone(), *index, *is_cracked)));
    }
    let alone = alone_of(set, taps, SCENE, Discriminator::Tau)?;
    found.alone.extend(alone.into_iter().map(|(tyre, score, is_cracked)| (seed, tyre, score, is_cracked)));
    Ok(found)
}

/// tau alone, by each of `ways`, which come first of those that were `found`.
pub(super) fn alone(
    bench: &Bench,
    simulator: Simulator,
    ways: &[Way],
    costs: &[Cost],
    found: &[Found],
) -> Result<Facet> {
    let (name, title) = match simulator {
        Simulator::Plate => ("tau-plate", "tau alone, simulator plate"),
        Simulator::Model => ("tau-model", "tau alone, simulator model"),
    };
    let places: Vec<&[Place]> = found.iter().take(ways.len()).map(|found| found.alone.as_slice()).collect();
    facet(bench, (name, title), ways, costs, &places)
}

/// The default index with one estimator changed.
pub(super) fn index(
    bench: &Bench,
    simulator: Simulator,
    ways: &[Way],
    costs: &[Cost],
    found: &[Found],
) -> Result<Facet> {
    let (name, title) = match simulator {
        Simulator::Plate => ("index-plate", "The index with one estimator changed, simulator plate"),
        Simulator::Model => ("index-model", "The index with one estimator changed, simulator model"),
    };
    let places: Vec<&[Place]> = found.iter().map(|found| found.index.as_slice()).collect();
    facet(bench, (name, title), ways, costs, &places)
}

fn facet(
    bench: &Bench,
    (name, title): (&'static str, &str),
    ways: &[Way],
    costs: &[Cost],
    places: &[&[Place]],
) -> Result<Facet> {
    let points = ways.iter().zip(costs).zip(places).map(|((way, &cost), places)| {
        let areas = |seed: Option<u64>| {
            let of_seed = places.iter().filter(|(of, ..)| seed.is_none_or(|seed| seed == *of));
            Areas::of(of_seed.map(|(seed, tyre, score, is_cracked)| (format!("{seed}-{tyre}"), *score, *is_cracked)))
        };
        let loss = |areas: &Areas| {
            Ok::<f64, anyhow::Error>(1.0 - areas.auc().context("locations of both kinds have a value")?)
        };
        let all = areas(None);
        let by_seed = bench.seeds().map(|seed| loss(&areas(Some(seed)))).collect::<Result<_>>()?;
        let interval = all.by_tyres(bench.seed).map(|(low, high)| (1.0 - high, 1.0 - low));
        let error = Error { value: loss(&all)?, ..Error::mean_of(by_seed) }.with_interval(interval);
        Ok(Point::new(way.words(), way.name, cost, error, all.count(true) + all.count(false))
            .family(usize::from(way.which == Discriminator::FMax))
            .default_if(way.is_default())
            .failing(failures(bench, way)?))
    });
    Ok(Facet {
        name,
        title: title.to_owned(),
        cost: Quantity::linear("Processor time of a record of the force", "\u{b5}s"),
        error: Quantity::log("Loss of detection, 1 \u{2212} AUC", ""),
        tolerance: Tolerance { cost: 0.1, error: 0.005 },
        truth: "the cracks that were planted".to_owned(),
        seeds: bench.seeds().collect(),
        families: vec!["tau", "F_max"],
        guides: Vec::new(),
        points: points.collect::<Result<_>>()?,
    })
}
