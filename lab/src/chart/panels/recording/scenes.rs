//! What each way of recording finds, scene by scene.

use anyhow::{Context as _, Result};
use rayon::prelude::*;
use tapline_fuse::FuseConfig;
use tapline_plate::ScanShape;

use super::readings::{Heard, PRE_TRIGGER_S};
use crate::chart::Bench;
use crate::chart::casings::{OFFSETS_MM, Place, VELOCITY_M_PER_S};
use crate::simulated::{Judged, Judging, Reading, ScanTaps, Scene, Set, Simulator, Tyre, judge, simulate};

/// Cracked scenes; those of an entry share a population. A short chart has the first alone.
pub(in crate::chart::panels) const ALL: [&[Scene]; 3] =
    [&[Scene::FaintSmooth, Scene::StrongSmooth], &[Scene::FaintRough, Scene::StrongRough], &[Scene::FaintNoise]];
/// The scenes that show a difference between converters.
pub(in crate::chart::panels) const FAINT: [&[Scene]; 2] = [&[Scene::FaintSmooth], &[Scene::FaintNoise]];

/// What the ways find in one scene and seed.
#[derive(Debug)]
pub(in crate::chart::panels) struct Found {
    pub simulator: Simulator,
    pub scene: Scene,
    pub seed: u64,
    /// By the number of the way; `None` if such records make no reference.
    pub judged: Vec<Option<Vec<Judged>>>,
}

impl Found {
    /// The locations by way number `place`.
    pub(in crate::chart::panels) fn places(&self, place: usize) -> impl Iterator<Item = Place> + '_ {
        self.judged[place].iter().flatten().flat_map(move |judged| judged.places(self.seed))
    }
}

/// Every scene of `populations` and every seed of both simulators, as each of `heard` reads it.
pub(in crate::chart::panels) fn found(bench: &Bench, heard: &[Heard], populations: &[&[Scene]]) -> Result<Vec<Found>> {
    let populations = if bench.size.is_full { populations } else { &populations[..1] };
    let mut all = Vec::new();
    for simulator in Simulator::ALL {
        for scenes in populations {
            for seed in bench.seeds() {
                all.extend(of_population(bench, heard, simulator, scenes, seed)?);
            }
        }
    }
    Ok(all)
}

/// Offsets of a scan; a short chart taps the belt edge alone.
fn offsets_mm(bench: &Bench) -> &'static [f64] {
    &OFFSETS_MM[..if bench.size.is_full { 2 } else { 1 }]
}

fn of_population(
    bench: &Bench,
    heard: &[Heard],
    simulator: Simulator,
    scenes: &[Scene],
    seed: u64,
) -> Result<Vec<Found>> {
    let casings = bench.size.recorded;
    let sound = scenes.first().context("a population has a scene")?.reference_scene();
    let tyres = (0..casings.reference).map(|k| Tyre::sound(format!("reference-{k:03}"))).collect();
    let known = in_every_way(bench, heard, simulator, sound, tyres, seed)?;
    let taps = ScanTaps::full(offsets_mm(bench), &[VELOCITY_M_PER_S], 1);
    let judging = |known: &Set| {
        // Records that give nothing make no reference, and find nothing.
        Judging::new(FuseConfig::default(), Some((known, casings.reference)), taps.clone()).ok()
    };
    let judgings: Vec<Option<Judging>> = known.par_iter().map(judging).collect();
    let of_scene = |&scene: &Scene| {
        let sets = in_every_way(bench, heard, simulator, scene, scene.tyres(100, casings.cracked, seed), seed)?;
        let jobs: Vec<_> = judgings.iter().zip(&sets).collect();
        let judged = jobs.into_par_iter().map(|(judging, set)| {
            judging.as_ref().map(|judging| judge(judging, set, 0..set.tyres.len(), scene)).transpose()
        });
        Ok(Found { simulator, scene, seed, judged: judged.collect::<Result<_>>()? })
    };
    scenes.iter().map(of_scene).collect()
}

/// The taps of `tyres` in each of the ways; those of one rate are read from one simulation.
fn in_every_way(
    bench: &Bench,
    heard: &[Heard],
    simulator: Simulator,
    scene: Scene,
    tyres: Vec<Tyre>,
    seed: u64,
) -> Result<Vec<Set>> {
    let mut sets: Vec<Option<Set>> = heard.iter().map(|_| None).collect();
    let is_of = |heard: &Heard, rate_hz: f64| (heard.rate_hz - rate_hz).abs() < 1.0;
    let mut first: Vec<&Heard> = Vec::new();
    for heard in heard {
        if !first.iter().any(|first| is_of(first, heard.rate_hz)) {
            first.push(heard);
        }
    }
    for &Heard { rate_hz, record_s, .. } in first {
        let places: Vec<usize> = (0..heard.len()).filter(|&k| is_of(&heard[k], rate_hz)).collect();
        let readings: Vec<Reading> = places.iter().map(|&k| heard[k].reading).collect();
        let shape = ScanShape {
            offsets_mm: offsets_mm(bench).to_vec(),
            velocities_m_per_s: vec![VELOCITY_M_PER_S],
            repetitions: 1,
            record_s,
            sample_rate_hz: rate_hz,
            pre_trigger_samples: (PRE_TRIGGER_S * rate_hz).round() as u32,
            ..ScanShape::default()
        };
        let read = simulate(simulator, scene, &shape, &tyres, seed, &readings)?;
        places.into_iter().zip(read).for_each(|(place, set)| sets[place] = Some(set));
    }
    sets.into_iter().collect::<Option<_>>().context("every way was simulated")
}
