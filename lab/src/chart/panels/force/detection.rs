//! How well tau alone detects cracks with each of its estimators.

use anyhow::Result;
use tapline_plate::ScanShape;
use tapline_process::ProcessConfig;
use tapline_wire::Discriminator;

use super::{Way, point};
use crate::chart::Bench;
use crate::chart::casings::{Place, VELOCITY_M_PER_S, loss};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Quantity};
use crate::chart::point::Cost;
use crate::simulated::{Reading, ScanTaps, Scene, Simulator, alone_of, simulate};

/// The casings: faint cracks in smooth ones.
const SCENE: Scene = Scene::FaintSmooth;

/// tau of every location, read in each of `ways`.
fn found(bench: &Bench, simulator: Simulator, ways: &[Way]) -> Result<Vec<Vec<Place>>> {
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
    let mut found = vec![Vec::new(); ways.len()];
    for seed in bench.seeds() {
        let tyres = SCENE.tyres(shape.location_count, 2 * bench.size.casings.cracked, seed);
        let sets = simulate(simulator, SCENE, &shape, &tyres, seed, &readings)?;
        for (all, set) in found.iter_mut().zip(&sets) {
            let of_seed = alone_of(set, &taps, SCENE, Discriminator::Tau)?;
            all.extend(of_seed.into_iter().map(|(tyre, score, is_cracked)| (seed, tyre, score, is_cracked)));
        }
    }
    Ok(found)
}

/// tau alone, read in each of `ways`.
pub(super) fn alone(bench: &Bench, simulator: Simulator, ways: &[Way], costs: &[Cost]) -> Result<Facet> {
    let found = found(bench, simulator, ways)?;
    let points = ways.iter().zip(costs).zip(&found).map(|((way, &cost), places)| {
        let (error, n) = loss(bench, places)?;
        point(bench, way, cost, error, n)
    });
    Ok(Facet {
        cost: Quantity::linear("Processor time of a record of the force", "\u{b5}s"),
        error: Quantity::log("Loss of detection, 1 \u{2212} AUC", ""),
        tolerance: Tolerance { cost: 0.1, error: 0.005 },
        families: vec!["estimators"],
        points: points.collect::<Result<_>>()?,
        ..bench.facet(format!("tau-{}", simulator.name()), format!("tau alone, simulator {}", simulator.name()))
    })
}
