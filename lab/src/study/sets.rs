//! The simulated sets: what the rig and its casings are like, and which cracks are planted.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_acquire::TyreConfig;
use tapline_model::{Crack, SimulationConfig};

/// Cracks of a cracked tyre, one each in equal sectors of shoulder 1; its shoulder 2 is sound.
pub(super) const CRACKS_PER_TYRE: u32 = 4;

/// Range of a uniform random number.
type Span = (f64, f64);

/// What cracks of a set are like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cracks {
    pub depth_mm: Span,
    pub length_mm: Span,
    /// Where across the shoulder they begin.
    pub offset_mm: Span,
    /// Least and greatest number of locations.
    pub location_count: (u32, u32),
}

/// Cracks of every set that names no others: down to hardly noticeable ones, since any index finds the others.
const CRACKS: Cracks =
    Cracks { depth_mm: (10.0, 28.0), length_mm: (4.0, 20.0), offset_mm: (0.0, 0.0), location_count: (1, 8) };

#[derive(Debug, Clone)]
pub(super) struct Set {
    pub name: &'static str,
    /// How it differs from the first.
    pub about: &'static str,
    pub simulation: SimulationConfig,
    pub cracks: Cracks,
}

/// All of them; the first is the simulation as it is by default.
pub(super) fn sets() -> Vec<Set> {
    let default = SimulationConfig::default;
    let of = |name, about, simulation| Set { name, about, simulation, cracks: CRACKS };
    vec![
        of("plain", "the simulation's defaults", default()),
        of("loud", "noise of the sound x 10", SimulationConfig { sound_noise_v: 0.04, ..default() }),
        of(
            "rough",
            "noise of the force x 10 (not the rough casings of rates.md)",
            SimulationConfig { force_noise_n: 0.5, ..default() },
        ),
        of(
            "both",
            "noise of sound and force x 10",
            SimulationConfig { sound_noise_v: 0.04, force_noise_n: 0.5, ..default() },
        ),
        of(
            "mixed",
            "construction scatter 0.10, between shoulders 0.03",
            SimulationConfig { construction_scatter: 0.1, shoulder_scatter: 0.03, ..default() },
        ),
        of(
            "uneven",
            "ring variation 0.05, location scatter 0.02",
            SimulationConfig { ring_variation: 0.05, location_scatter: 0.02, ..default() },
        ),
        of(
            "loose",
            "repeatability 0.04, velocity jitter 0.04, gain drift 0.10",
            SimulationConfig { repeatability: 0.04, velocity_jitter: 0.04, gain_drift: 0.1, ..default() },
        ),
        Set {
            cracks: Cracks { offset_mm: (5.0, 12.0), ..CRACKS },
            ..of("aside", "cracks begin 5 to 12 mm from the belt edge", default())
        },
        Set {
            cracks: Cracks { depth_mm: (3.0, 12.0), length_mm: (20.0, 25.0), ..CRACKS },
            ..of("shallow", "cracks 3 to 12 mm deep, 20 to 25 mm long, as `tapline run` plants them", default())
        },
    ]
}

pub(super) fn sound(serial: String) -> TyreConfig {
    TyreConfig { serial, station: 1, crack: Vec::new() }
}

/// A tyre with cracks within `cracks`; each `number` draws different ones from `seed`.
pub(super) fn cracked(serial: String, cracks: &Cracks, location_count: u32, seed: u64, number: u64) -> TyreConfig {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    let sector = location_count / CRACKS_PER_TYRE;
    let turn = rng.random_range(0..location_count);
    let crack = (0..CRACKS_PER_TYRE).map(|place| {
        let (least, most) = cracks.location_count;
        // A third of the sector stays sound, so that no two cracks are one.
        let room = sector - sector / 3;
        let count = rng.random_range(least..=if most < room { most } else { room });
        let first = place * sector + rng.random_range(0..=room - count);
        let mut within = |(low, high): Span| low + (high - low) * rng.random::<f64>();
        Crack {
            shoulder: 1,
            first_location: (turn + first) % location_count,
            location_count: count,
            depth_mm: within(cracks.depth_mm),
            length_mm: within(cracks.length_mm),
            offset_mm: within(cracks.offset_mm),
        }
    });
    TyreConfig { crack: crack.collect(), ..sound(serial) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches cracks that touch, are too many or few, or leave their spans; and a number that draws nothing of its own.
    #[test]
    fn cracks_are_apart_and_as_asked() {
        for number in 0..200 {
            let tyre = cracked("T".to_owned(), &CRACKS, 100, 5, number);
            let at = |location| tyre.crack.iter().filter(|c| c.covers(1, location, 100)).count();
            assert!((0..100).all(|location| at(location) <= 1));
            let starts = (0..100).filter(|&l| at(l) == 1 && at((l + 99) % 100) == 0).count();
            assert_eq!(starts, CRACKS_PER_TYRE as usize);
            assert!(
                tyre.crack.iter().all(|c| (10.0..28.0).contains(&c.depth_mm) && (4.0..20.0).contains(&c.length_mm))
            );
            assert_ne!(tyre.crack, cracked("T".to_owned(), &CRACKS, 100, 5, number + 1).crack);
        }
    }
}
