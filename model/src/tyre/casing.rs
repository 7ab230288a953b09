//! Scatter between casings, and between the places of one casing.

use std::f64::consts::TAU;

use crate::SimulationConfig;
use crate::tyre::identity::{Generator, Identity};

/// Properties of one place of a casing, as factors around 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    /// Factor on the contact stiffness.
    pub stiffness: f64,
    /// Factor on the loudness.
    pub loudness: f64,
}

/// Where a tap lands.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Landing<'a> {
    pub serial: &'a str,
    pub shoulder: u16,
    /// Location; 0 for the closing tap.
    pub location: u32,
    pub location_count: u32,
    pub offset_mm: f64,
}

/// Amplitudes of the ring's harmonics, as fractions of the variation: few and low, so that no place is an outlier.
const HARMONICS: [f64; 3] = [0.7, 0.5, 0.3];
/// Relative change of stiffness, and the opposite change of loudness, per mm towards the centre, where the casing is
/// thinner (Fig. 60).
const STIFFNESS_PER_MM: f64 = -0.004;
const LOUDNESS_PER_MM: f64 = 0.010;

/// The properties of the place where `landing` is; `seed` and the serial number determine the casing.
pub(crate) fn place(config: &SimulationConfig, seed: u64, landing: &Landing<'_>) -> Place {
    let mut tyre = Identity::new(seed, "tyre").text(landing.serial).generator();
    let (tyre_stiffness, tyre_loudness) = (tyre.normal(), tyre.normal());
    let shoulder_id = Identity::new(seed, "shoulder").text(landing.serial).number(u64::from(landing.shoulder));
    let mut shoulder = shoulder_id.generator();
    let (shoulder_stiffness, shoulder_loudness) = (shoulder.normal(), shoulder.normal());
    let turn = f64::from(landing.location) / f64::from(landing.location_count.max(1));
    let (wave_stiffness, wave_loudness) = (wave(&mut shoulder, turn), wave(&mut shoulder, turn));
    let mut spot = shoulder_id.text("spot").number(u64::from(landing.location)).generator();
    let (spot_stiffness, spot_loudness) = (spot.normal(), spot.normal());
    let x_mm = if landing.offset_mm.is_finite() { landing.offset_mm.clamp(-50.0, 50.0) } else { 0.0 };
    let factor = |tyre: f64, shoulder: f64, wave: f64, spot: f64, per_mm: f64| {
        (1.0 + config.construction_scatter * tyre)
            * (1.0 + config.shoulder_scatter * shoulder)
            * (1.0 + config.ring_variation * wave)
            * (1.0 + config.location_scatter * spot)
            * (1.0 + per_mm * x_mm)
    };
    Place {
        stiffness: factor(tyre_stiffness, shoulder_stiffness, wave_stiffness, spot_stiffness, STIFFNESS_PER_MM)
            .clamp(0.2, 5.0),
        loudness: factor(tyre_loudness, shoulder_loudness, wave_loudness, spot_loudness, LOUDNESS_PER_MM)
            .clamp(0.2, 5.0),
    }
}

/// A smooth function of the `turn` (0 to 1) around the ring, of magnitude up to about 1, with phases drawn from
/// `generator`.
fn wave(generator: &mut Generator, turn: f64) -> f64 {
    (1..)
        .zip(HARMONICS)
        .map(|(n, amplitude)| amplitude * (TAU * (f64::from(n) * turn + generator.uniform())).sin())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(location: u32) -> Place {
        let landing = Landing { serial: "SIM-0001", shoulder: 1, location, location_count: 100, offset_mm: 0.0 };
        place(&SimulationConfig { location_scatter: 0.0, ..SimulationConfig::default() }, 5, &landing)
    }

    /// Catches a ring that jumps between neighbours or does not close.
    #[test]
    fn the_ring_is_smooth_and_closed() {
        for location in 0..100 {
            let (here, next) = (at(location), at((location + 1) % 100));
            assert!((here.stiffness - next.stiffness).abs() < 0.006, "{here:?} {next:?}");
            assert!((here.loudness - next.loudness).abs() < 0.006, "{here:?} {next:?}");
        }
    }

    /// Catches shoulders or tyres that are copies of others.
    #[test]
    fn shoulders_and_tyres_differ() {
        let config = SimulationConfig::default();
        let landing = Landing { serial: "SIM-0001", shoulder: 1, location: 3, location_count: 100, offset_mm: 0.0 };
        let here = place(&config, 5, &landing);
        assert_ne!(here, place(&config, 5, &Landing { shoulder: 2, ..landing }));
        assert_ne!(here, place(&config, 5, &Landing { serial: "SIM-0002", ..landing }));
        assert_ne!(here, place(&config, 6, &landing));
        assert_eq!(here, place(&config, 5, &landing));
    }
}
