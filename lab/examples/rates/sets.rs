//! Sets of casings, each simulated once.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use tapline_lab::simulated::{Reading, Scene, Set, Simulator, Tyre, simulate};
use tapline_plate::ScanShape;

/// The sets of a simulator.
#[derive(Debug)]
pub(crate) struct Sets {
    simulator: Simulator,
    shape: ScanShape,
    reading: Reading,
    /// Sound casings of a group that are kept for references.
    reference_casings: usize,
    known: BTreeMap<(String, u64), Arc<Set>>,
    /// How long the simulation took.
    pub seconds: f64,
}

impl Sets {
    pub(crate) fn new(simulator: Simulator, shape: ScanShape, reading: Reading, reference_casings: usize) -> Self {
        Self { simulator, shape, reading, reference_casings, known: BTreeMap::new(), seconds: 0.0 }
    }

    /// Taps simulated so far.
    pub(crate) fn tap_count(&self) -> usize {
        self.known.values().map(|set| set.tyres.len() * self.shape.tap_count()).sum()
    }

    /// The sound casings that references of a group are made of.
    pub(crate) fn reference(&mut self, scene: Scene, seed: u64) -> Result<Arc<Set>> {
        let scene = scene.reference_scene();
        let tyres = (0..self.reference_casings).map(|k| Tyre::sound(format!("reference-{k:03}"))).collect();
        self.set(scene, format!("{}-reference", scene.set_name()), tyres, seed)
    }

    /// `count` casings of a group that are judged.
    pub(crate) fn judged(&mut self, scene: Scene, count: usize, seed: u64) -> Result<Arc<Set>> {
        let tyres = scene.tyres(self.shape.location_count, count, seed);
        self.set(scene, scene.set_name().to_owned(), tyres, seed)
    }

    fn set(&mut self, scene: Scene, name: String, tyres: Vec<Tyre>, seed: u64) -> Result<Arc<Set>> {
        if let Some(set) = self.known.get(&(name.clone(), seed)) {
            return Ok(set.clone());
        }
        let begun = Instant::now();
        let sets = simulate(self.simulator, scene, &self.shape, &tyres, seed, &[self.reading])?;
        let set = Arc::new(sets.into_iter().next().context("there is one reading")?);
        self.seconds += begun.elapsed().as_secs_f64();
        self.known.insert((name, seed), set.clone());
        Ok(set)
    }
}
