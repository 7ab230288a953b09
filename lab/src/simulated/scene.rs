//! The scenes: which casings, of what population, with which cracks and gains.

use clap::ValueEnum;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_model::{FaultKind, PlantedFault, SimulationConfig};
use tapline_plate::Population;
use tapline_wire::{Discriminator, Serial, digest_of_parts};

/// Factor on the noise of force and sound in the scenes with noise.
const NOISE_TIMES: f64 = 8.0;

/// What simulates the casings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Simulator {
    /// `tapline-model`.
    Model,
    /// `tapline-plate`.
    Plate,
}

/// What is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Scene {
    /// Sound casings of even stiffness.
    SoundSmooth,
    /// Sound casings with rogue taps, drifts and places that differ.
    SoundRough,
    /// Smooth casings that do not turn on the rig, compared with smooth ones that do.
    StillSmooth,
    /// Rough casings that do not turn, compared with rough ones that do.
    StillRough,
    /// One turn heard with 0.8 of the gain.
    Gain08,
    /// One turn heard with 1.2 of the gain.
    Gain12,
    /// The gain of one turn rises by 5 %.
    GainDrift,
    /// Sound casings on a rig with eight times the noise.
    SoundNoise,
    /// The same by a reference without that noise.
    SoundNoisier,
    /// Sound casings with rogue taps, drifts and places that differ, compared with smooth ones.
    SoundRougher,
    /// Sound casings of even stiffness, compared with rough ones.
    SoundSmoother,
    /// One or two faint cracks on smooth casings.
    FaintSmooth,
    /// The same on rough ones.
    FaintRough,
    /// The same with eight times the noise.
    FaintNoise,
    /// The same by a reference without that noise.
    FaintNoisier,
    /// Faint cracks on rough casings, compared with smooth ones.
    FaintRougher,
    /// Faint cracks on smooth casings, compared with rough ones.
    FaintSmoother,
    /// One or two strong cracks on smooth casings.
    StrongSmooth,
    /// The same on rough ones.
    StrongRough,
    /// Cracks over 70 % of the ring.
    MostOfRing,
    /// A crack all round.
    AllRound,
}

/// A crack, as both simulators describe it.
#[derive(Debug, Clone)]
pub struct Crack {
    /// Its first location.
    pub first: u32,
    /// How many it has.
    pub count: u32,
    /// Locations of the ring.
    pub location_count: u32,
    /// Depth under the surface.
    pub depth_mm: f64,
    /// Length across the shoulder, which is the length that bends.
    pub length_mm: f64,
    /// Part of the loosened layer's compliance that has an effect; `plate` only.
    pub severity: f64,
}

/// A casing; its cracks are in shoulder 1.
#[derive(Debug, Clone)]
pub struct Tyre {
    /// Serial number; with the seed it determines the casing.
    pub serial: String,
    /// Its cracks; a sound casing has none.
    pub cracks: Vec<Crack>,
}

impl Tyre {
    /// A casing without a crack.
    pub fn sound(serial: String) -> Self {
        Self { serial, cracks: Vec::new() }
    }

    /// The casing for `plate`.
    pub fn of_plate(&self) -> tapline_plate::Tyre {
        let crack = |c: &Crack| {
            tapline_plate::Crack {
                shoulder: 1,
                depth_mm: c.depth_mm,
                length_mm: c.length_mm,
                reach_mm: c.length_mm,
                severity: c.severity,
                ..tapline_plate::Crack::default()
            }
            .over(c.first, c.count, c.location_count)
        };
        let serial = Serial::new(&self.serial).unwrap_or_default();
        tapline_plate::Tyre { serial, cracks: self.cracks.iter().map(crack).collect() }
    }

    /// The casing for `model`.
    pub fn of_model(&self) -> tapline_acquire::TyreConfig {
        let crack = |c: &Crack| tapline_model::Crack {
            shoulder: 1,
            first_location: c.first,
            location_count: c.count,
            depth_mm: c.depth_mm,
            length_mm: c.length_mm,
            offset_mm: 0.0,
        };
        tapline_acquire::TyreConfig {
            serial: self.serial.clone(),
            station: 1,
            crack: self.cracks.iter().map(crack).collect(),
        }
    }
}

impl Simulator {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Plate, Self::Model];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Model => "model",
            Self::Plate => "plate",
        }
    }
}

impl Scene {
    /// Whether its casings have no crack.
    pub fn is_sound(self) -> bool {
        self.cracks().is_none()
    }

    /// Whether one turn of shoulder 1 is changed, so that shoulder 2 does not count.
    pub fn changes_a_turn(self) -> bool {
        matches!(self, Self::Gain08 | Self::Gain12 | Self::GainDrift)
    }

    /// The set of its casings: scenes that differ only after the simulation share one.
    pub fn set_name(self) -> &'static str {
        match self {
            Self::SoundSmooth | Self::SoundSmoother | Self::Gain08 | Self::Gain12 | Self::GainDrift => "sound-smooth",
            Self::SoundRough | Self::SoundRougher => "sound-rough",
            Self::SoundNoise | Self::SoundNoisier => "sound-noise",
            Self::StillSmooth => "still-smooth",
            Self::StillRough => "still-rough",
            Self::FaintSmooth | Self::FaintSmoother => "faint-smooth",
            Self::FaintRough | Self::FaintRougher => "faint-rough",
            Self::FaintNoise | Self::FaintNoisier => "faint-noise",
            Self::StrongSmooth => "strong-smooth",
            Self::StrongRough => "strong-rough",
            Self::MostOfRing => "most-of-ring",
            Self::AllRound => "all-round",
        }
    }

    /// The sound scene whose population and rig its reference has.
    pub fn reference_scene(self) -> Self {
        match self {
            Self::SoundNoisier | Self::SoundRougher | Self::FaintNoisier | Self::FaintRougher => Self::SoundSmooth,
            Self::SoundSmoother | Self::FaintSmoother => Self::SoundRough,
            _ => self.sound_scene(),
        }
    }

    /// The sound scene whose population and rig its casings have.
    fn sound_scene(self) -> Self {
        match self {
            Self::SoundRough
            | Self::StillRough
            | Self::SoundRougher
            | Self::FaintRough
            | Self::FaintRougher
            | Self::StrongRough => Self::SoundRough,
            Self::SoundNoise | Self::SoundNoisier | Self::FaintNoise | Self::FaintNoisier => Self::SoundNoise,
            _ => Self::SoundSmooth,
        }
    }

    /// Whether its casings do not turn.
    fn stands_still(self) -> bool {
        matches!(self, Self::StillSmooth | Self::StillRough)
    }

    /// Casings and rig of `plate`.
    pub fn population(self) -> Population {
        let population = match self.sound_scene() {
            Self::SoundRough => Population::rough(),
            Self::SoundNoise => Population::smooth().with_noise(NOISE_TIMES),
            _ => Population::smooth(),
        };
        Population { stands_still: self.stands_still(), ..population }
    }

    /// The settings of `model` closest to that population.
    pub fn simulation(self) -> SimulationConfig {
        let plain = SimulationConfig { stands_still: self.stands_still(), ..SimulationConfig::default() };
        let fault = |kind| PlantedFault { kind, fraction: 0.005 };
        match self.sound_scene() {
            Self::SoundRough => SimulationConfig {
                ring_variation: 0.05,
                location_scatter: 0.04,
                gain_drift: 0.04,
                fault: vec![fault(FaultKind::DoubleHit), fault(FaultKind::VelocityOff)],
                ..plain
            },
            Self::SoundNoise => SimulationConfig {
                force_noise_n: NOISE_TIMES * plain.force_noise_n,
                sound_noise_v: NOISE_TIMES * plain.sound_noise_v,
                ..plain
            },
            _ => plain,
        }
    }

    /// Cracks of a casing, drawn by `rng`; `None` for a sound scene.
    fn cracks(self) -> Option<fn(&mut ChaCha8Rng, u32) -> Vec<Crack>> {
        match self {
            Self::FaintSmooth
            | Self::FaintSmoother
            | Self::FaintRough
            | Self::FaintNoise
            | Self::FaintNoisier
            | Self::FaintRougher => Some(|rng, n| apart(rng, n, (1, 4), (12.0, 20.0), (10.0, 20.0), (0.15, 0.8))),
            Self::StrongSmooth | Self::StrongRough => {
                Some(|rng, n| apart(rng, n, (3, 10), (3.0, 12.0), (20.0, 25.0), (0.9, 1.0)))
            }
            Self::MostOfRing => Some(|rng, n| vec![arc(rng, n, 7 * n / 10)]),
            Self::AllRound => Some(|rng, n| vec![arc(rng, n, n)]),
            _ => None,
        }
    }

    /// `count` casings of the group of `seed`.
    pub fn tyres(self, location_count: u32, count: usize, seed: u64) -> Vec<Tyre> {
        let name = self.set_name();
        let tyre = |number: usize| {
            let serial = format!("{name}-{number:03}");
            let of = digest_of_parts([serial.as_bytes(), &seed.to_le_bytes()]);
            let mut rng = ChaCha8Rng::seed_from_u64(of);
            Tyre { serial, cracks: self.cracks().map(|draw| draw(&mut rng, location_count)).unwrap_or_default() }
        };
        (0..count).map(tyre).collect()
    }

    /// `value` after the scene's change, at the fraction `turn` of the changed turn.
    pub fn changed(self, which: Discriminator, value: f64, turn: f64) -> f64 {
        let gain = match self {
            Self::Gain08 => 0.8,
            Self::Gain12 => 1.2,
            Self::GainDrift => 1.0 + 0.05 * (turn - 0.5),
            _ => 1.0,
        };
        // Effect of a microphone's gain on each, without noise.
        match which {
            Discriminator::A1 | Discriminator::A2 => gain * value,
            Discriminator::Pf | Discriminator::Ef => gain * gain * value,
            _ => value,
        }
    }
}

/// One or two cracks, in halves of the ring, that do not touch.
fn apart(
    rng: &mut ChaCha8Rng,
    location_count: u32,
    locations: (u32, u32),
    depth_mm: (f64, f64),
    length_mm: (f64, f64),
    severity: (f64, f64),
) -> Vec<Crack> {
    let (turn, cracks) = (rng.random_range(0..location_count), rng.random_range(1..=2_u32));
    let half = location_count / 2;
    (0..cracks)
        .map(|number| {
            let count = rng.random_range(locations.0..=locations.1).min(half - 2);
            let first = number * half + rng.random_range(0..half - count - 1);
            Crack {
                first: (first + turn) % location_count,
                count,
                location_count,
                depth_mm: rng.random_range(depth_mm.0..depth_mm.1),
                length_mm: rng.random_range(length_mm.0..length_mm.1),
                severity: rng.random_range(severity.0..severity.1),
            }
        })
        .collect()
}

/// A crack of medium depth over `count` locations.
fn arc(rng: &mut ChaCha8Rng, location_count: u32, count: u32) -> Crack {
    Crack {
        first: rng.random_range(0..location_count),
        count,
        location_count,
        depth_mm: rng.random_range(6.0..14.0),
        length_mm: rng.random_range(15.0..25.0),
        severity: 1.0,
    }
}
