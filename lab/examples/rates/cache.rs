//! Sets of casings: simulated once, and kept in a folder.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use serde_json::json;
use tapline_lab::simulated::{COLUMNS, Crack, Scene, Set, Simulator, Tyre, values_of};
use tapline_plate::ScanShape;
use tapline_process::ProcessConfig;
use tapline_wire::{Discriminator, digest_of_parts};

/// Where sets come from.
#[derive(Debug)]
pub(crate) struct Cache {
    folder: PathBuf,
    simulator: Simulator,
    shape: ScanShape,
    process: ProcessConfig,
    /// Sound casings of a group that are kept for references.
    reference_casings: usize,
    simulated: Cell<(usize, f64)>,
}

impl Cache {
    pub(crate) fn new(
        folder: &Path,
        simulator: Simulator,
        shape: ScanShape,
        process: ProcessConfig,
        reference_casings: Option<usize>,
    ) -> Result<Self> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let reference_casings = reference_casings.unwrap_or(0);
        Ok(Self { folder: folder.to_owned(), simulator, shape, process, reference_casings, simulated: Cell::default() })
    }

    pub(crate) fn shape(&self) -> &ScanShape {
        &self.shape
    }

    /// Taps simulated so far, and the seconds that took.
    pub(crate) fn simulated(&self) -> (usize, f64) {
        self.simulated.get()
    }

    /// The sound casings that references of a group are made of.
    pub(crate) fn reference(&self, scene: Scene, seed: u64) -> Result<Set> {
        let scene = scene.reference_scene();
        let tyres = (0..self.reference_casings).map(|k| Tyre::sound(format!("reference-{k:03}"))).collect();
        self.set(scene, &format!("{}-reference", scene.set_name()), tyres, seed)
    }

    /// `count` casings of a group that are judged.
    pub(crate) fn judged(&self, scene: Scene, count: usize, seed: u64) -> Result<Set> {
        self.set(scene, scene.set_name(), scene.tyres(self.shape.location_count, count, seed), seed)
    }

    fn set(&self, scene: Scene, name: &str, tyres: Vec<Tyre>, seed: u64) -> Result<Set> {
        let shape = self.shape.clone();
        let counts = [2, shape.offsets_mm.len(), shape.velocities_m_per_s.len()];
        let mut lengths = vec![tyres.len()];
        lengths.extend(counts);
        lengths.extend([usize::from(shape.repetitions), shape.location_count as usize, COLUMNS]);
        let truth = |tyre: &Tyre| -> Vec<Vec<bool>> {
            let ring = |shoulder| (0..shape.location_count).map(|l| tyre.is_cracked(shoulder, l)).collect();
            vec![ring(1), ring(2)]
        };
        let names = Discriminator::ALL.iter().map(|d| d.column()).chain(["velocity_measured_m_per_s"]);
        let settings = match self.simulator {
            Simulator::Plate => json!(scene.population()),
            Simulator::Model => json!(scene.model(&shape)),
        };
        let head = json!({
            "simulator": self.simulator,
            "settings": settings,
            "seed": seed,
            "order": ["casing", "shoulder", "offset", "velocity", "repetition", "location", "column"],
            "shape": lengths,
            "offsets_mm": shape.offsets_mm,
            "velocities_m_per_s": shape.velocities_m_per_s,
            "record_s": shape.record_s,
            "columns": names.collect::<Vec<_>>(),
            "tyres": tyres,
            "is_cracked": tyres.iter().map(truth).collect::<Vec<_>>(),
            "fingerprint": self.fingerprint(scene, seed)?,
        });
        let text = serde_json::to_string_pretty(&head)?;
        let simulator = self.simulator.name();
        let digest = digest_of_parts([text.as_bytes()]);
        let path = self.folder.join(format!("{simulator}-{name}-{seed}-{digest:016x}.f64"));
        let length: usize = lengths.iter().product();
        if let Some(values) = fs::read(&path).ok().and_then(|bytes| read(&bytes, length)) {
            return Set::new(tyres, shape, values);
        }
        let begun = Instant::now();
        let values = values_of(self.simulator, scene, &shape, &tyres, seed, self.process)?;
        let (taps, seconds) = self.simulated.get();
        self.simulated.set((taps + values.len() / COLUMNS, seconds + begun.elapsed().as_secs_f64()));
        fs::write(path.with_extension("json"), text)?;
        let draft = path.with_extension("draft");
        fs::write(&draft, values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        fs::rename(&draft, &path)?;
        Set::new(tyres, shape, values)
    }

    /// The bits of two taps' discriminators: they differ if simulator or extractor have changed since a set was cached.
    fn fingerprint(&self, scene: Scene, seed: u64) -> Result<Vec<u64>> {
        let shape = ScanShape {
            offsets_mm: vec![0.0],
            velocities_m_per_s: vec![1.85],
            repetitions: 1,
            location_count: 2,
            ..self.shape.clone()
        };
        let crack = Crack { first: 0, count: 1, location_count: 2, depth_mm: 8.0, length_mm: 20.0, severity: 1.0 };
        let tyre = Tyre { serial: "fingerprint".to_owned(), cracks: vec![crack] };
        let values = values_of(self.simulator, scene, &shape, &[tyre], seed, self.process)?;
        let of_discriminators = values.chunks(COLUMNS).flat_map(|tap| &tap[..Discriminator::COUNT]);
        Ok(of_discriminators.map(|value| value.to_bits()).collect())
    }
}

fn read(bytes: &[u8], length: usize) -> Option<Vec<f64>> {
    let (values, rest) = bytes.as_chunks::<8>();
    (values.len() == length && rest.is_empty()).then(|| values.iter().map(|&x| f64::from_le_bytes(x)).collect())
}
