//! How much is simulated: the default, what `--quick` does, and `--tyres`.

use anyhow::{Context as _, Result};
use tapline_acquire::{ScanConfig, TyreConfig};
use tapline_model::SimulationConfig;

use crate::simulated::{Dataset, Reading, scan_model};

/// Offsets of a scan, in mm, as in section 5.2.
const OFFSETS_MM: [f64; 4] = [0.0, 5.0, 10.0, 15.0];
const REPETITIONS: u16 = 2;
/// The velocity of every tap.
const VELOCITY_M_PER_S: f64 = 1.5;

/// Which turns are made around a shoulder.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    pub offsets_mm: Vec<f64>,
    pub repetitions: u16,
}

impl Turns {
    /// Scans `tyres`; `seed` decides every random number.
    pub(super) fn scan(
        &self,
        simulation: &SimulationConfig,
        tyres: Vec<TyreConfig>,
        numbers: (u64, u32),
    ) -> Result<Dataset> {
        let read = self.scan_read(simulation, tyres, numbers, &[Reading::default()])?;
        read.into_iter().next().context("one reading gives one dataset")
    }

    /// The same for each of `readings`.
    pub(super) fn scan_read(
        &self,
        simulation: &SimulationConfig,
        tyres: Vec<TyreConfig>,
        (seed, location_count): (u64, u32),
        readings: &[Reading],
    ) -> Result<Vec<Dataset>> {
        let scan = ScanConfig {
            seed,
            offsets_mm: self.offsets_mm.clone(),
            velocities_m_per_s: vec![VELOCITY_M_PER_S],
            repetitions: self.repetitions,
            locations: location_count,
            closing_tap: false, // it enters no index
            tyre: tyres,
            ..ScanConfig::default()
        };
        scan_model(&scan, simulation, readings)
    }
}

#[derive(Debug, Clone)]
pub(super) struct Size {
    /// Tyres of a set: half of them are sound and make the reference; of the others, which are judged, half are cracked.
    pub tyres: usize,
    /// Locations of a ring.
    pub location_count: u32,
    /// Sound tyres of which false calls are counted.
    pub sound_tyres: usize,
    /// How many references of each size are drawn of them.
    pub draws: usize,
    /// Casings in those references.
    pub reference_sizes: Vec<usize>,
    /// Cracked tyres of which finds are counted.
    pub target_tyres: usize,
    /// Sound tyres that are the reference for those.
    pub target_reference: usize,
    /// How many tyres a rig reads again, and how often.
    pub gauge_tyres: usize,
    pub gauge_scans: u16,
    /// How many of the sets are simulated.
    pub set_count: usize,
    /// The turns of every set, and of the targets.
    pub turns: Turns,
    /// The turns of what counts false calls and of the gauge.
    pub short: Turns,
}

fn turns(offsets_mm: &[f64]) -> Turns {
    Turns { offsets_mm: offsets_mm.to_vec(), repetitions: REPETITIONS }
}

impl Size {
    /// The default: minutes on two cores.
    pub(super) fn full_study(tyres: usize) -> Self {
        Self {
            tyres,
            location_count: 100,
            sound_tyres: 80,
            draws: 6,
            reference_sizes: vec![2, 4, 8, 16],
            target_tyres: 32,
            target_reference: 8,
            gauge_tyres: 8,
            gauge_scans: 3,
            set_count: usize::MAX,
            turns: turns(&OFFSETS_MM),
            short: turns(&[0.0]),
        }
    }

    /// Enough to see that all of it works: seconds.
    pub(super) fn quick(tyres: usize) -> Self {
        Self {
            tyres,
            location_count: 48,
            sound_tyres: 12,
            draws: 3,
            reference_sizes: vec![2, 4],
            target_tyres: 6,
            target_reference: 2,
            gauge_tyres: 2,
            gauge_scans: 2,
            set_count: 2,
            turns: turns(&OFFSETS_MM[..2]),
            ..Self::full_study(tyres)
        }
    }
}
