//! One casing: its own properties, and those of each of its places.

use tapline_wire::Serial;

use crate::contact::Layer;
use crate::crack::Crack;
use crate::modes::{CASING, LAYER_RATIOS, MODES, Mode};
use crate::population::Population;
use crate::random::Key;

/// K = 4/3 E/(1 - nu^2) sqrt(R), for a stiff tip of radius R = 8 mm on rubber of E = 14 MPa, nu = 0.49 (assumed): the
/// contact with a sound casing lasts some 0.9 ms at 1.85 m/s.
const STIFFNESS_N_PER_M1_5: f64 = 2.2e6;
/// Z = 8 sqrt(D m) (Zener 1941) for D = 174 N m and m = 35 kg/m^2: 25 mm of belted rubber (assumed).
const IMPEDANCE_N_S_PER_M: f64 = 624.0;
/// Relative fall of stiffness, and rise of the sound, per mm towards the tyre's centre, where the casing is thinner
/// (assumed).
const SOFTER_PER_MM: f64 = 0.005;
const LOUDER_PER_MM: f64 = 0.008;
/// Loudness of a layer with a compliance of 1 m/N, V/(N s) per m/N (assumed, so that faint cracks raise PR, P_f and
/// E_f, as on recorded slabs).
const LAYER_LEVEL: f64 = 6e7;
/// Damping of the audible modes of a layer, relative to critical damping.
const LAYER_DAMPING: f64 = 0.08;
/// Distance between the knots of the stiffness along the ring.
const KNOT_DEG: f64 = 3.6;
const KNOTS: i64 = 100;

/// A casing of a population.
#[derive(Debug, Clone)]
pub struct Casing {
    population: Population,
    key: Key,
    shoulders: [Shoulder; 2],
    gain: f64,
    cracks: Vec<Crack>,
}

/// Properties that all places of one shoulder share.
#[derive(Debug, Clone, Copy)]
struct Shoulder {
    stiffness: f64,
    impedance: f64,
    modes: [Mode; CASING.len()],
}

/// The properties of a place, for one tap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub stiffness_n_per_m1_5: f64,
    pub impedance_n_s_per_m: f64,
    pub layer: Option<Layer>,
    pub modes: [Mode; MODES],
}

impl Casing {
    /// The casing of `population` that `seed` and `serial` determine, with `cracks`.
    pub fn new(population: &Population, seed: u64, serial: Serial, cracks: Vec<Crack>) -> Self {
        let key = Key::new(seed, "casing").bytes(serial.as_str().as_bytes());
        let p = population;
        let mut dice = key.generator();
        let (stiffness, mass, gain) =
            (dice.factor(p.casing_stiffness), dice.factor(p.casing_mass), dice.factor(p.casing_gain));
        let modes = CASING.map(|m| Mode {
            frequency_hz: m.frequency_hz * dice.factor(p.casing_mode_frequency),
            decay_per_s: m.decay_per_s * dice.factor(p.casing_mode_frequency),
            level_v_per_n_s: m.level_v_per_n_s * dice.factor(p.casing_mode_level) / mass,
            ..m
        });
        let shoulder = |number: u64| {
            let mut dice = key.number(number).generator();
            Shoulder {
                stiffness: STIFFNESS_N_PER_M1_5 * stiffness * dice.factor(p.shoulder),
                impedance: IMPEDANCE_N_S_PER_M * mass * dice.factor(p.shoulder),
                modes: modes.map(|m| Mode {
                    frequency_hz: m.frequency_hz * dice.factor(0.3 * p.shoulder),
                    level_v_per_n_s: m.level_v_per_n_s * dice.factor(p.shoulder),
                    ..m
                }),
            }
        };
        Self { population: *population, key, shoulders: [shoulder(1), shoulder(2)], gain, cracks }
    }

    /// Gain of the microphone for this casing.
    pub(crate) fn gain(&self) -> f64 {
        self.gain
    }

    /// The key of random numbers of `shoulder`.
    pub(crate) fn key(&self, purpose: u64, shoulder: u16) -> Key {
        self.key.number(16 + purpose).number(shoulder.into())
    }

    /// The properties at `angle_deg` and `offset_mm` of `shoulder`.
    pub(crate) fn place(&self, shoulder: u16, angle_deg: f64, offset_mm: f64) -> Place {
        let p = &self.population;
        let common = self.shoulders[usize::from(shoulder == 2)];
        let (shared, own) = (p.place_shared.sqrt(), (1.0 - p.place_shared).sqrt());
        let angle_deg = if self.population.stands_still { 0.0 } else { angle_deg.rem_euclid(360.0) };
        let key = self.key(0, shoulder);
        let field = shared * self.field(key, angle_deg) + own * self.field(key.millionths(offset_mm), angle_deg);
        let (mut here, mut beside) =
            (key.number(1).millionths(angle_deg).generator(), key.number(2).millionths(angle_deg));
        beside = beside.millionths(offset_mm);
        let mut beside = beside.generator();
        let louder = 1.0 + LOUDER_PER_MM * offset_mm.clamp(-50.0, 50.0);
        let softer = 1.0 - SOFTER_PER_MM * offset_mm.clamp(-50.0, 50.0);
        let mut modes = [Mode::default(); MODES];
        for (mode, usual) in modes.iter_mut().zip(common.modes) {
            let scatter = p.place_modes * (shared * here.normal() + own * beside.normal());
            *mode = Mode { level_v_per_n_s: usual.level_v_per_n_s * louder * scatter.exp(), ..usual };
        }
        let layer = self.layer(shoulder, angle_deg, offset_mm);
        if let Some(layer) = layer {
            for (mode, (ratio, level)) in modes[CASING.len()..].iter_mut().zip(LAYER_RATIOS) {
                let frequency_hz = ratio * layer.rings_at_hz;
                *mode = Mode {
                    frequency_hz,
                    decay_per_s: std::f64::consts::TAU * LAYER_DAMPING * frequency_hz,
                    level_v_per_n_s: level * LAYER_LEVEL / layer.layer.stiffness_n_per_m,
                    by_velocity: true,
                };
            }
        }
        Place {
            stiffness_n_per_m1_5: common.stiffness * softer * (p.place_stiffness * field).exp(),
            impedance_n_s_per_m: common.impedance,
            layer: layer.map(|layer| layer.layer),
            modes,
        }
    }

    /// The layer of the crack with the largest effect.
    fn layer(&self, shoulder: u16, angle_deg: f64, offset_mm: f64) -> Option<Felt> {
        let felt = self.cracks.iter().filter_map(|crack| {
            let layer = crack.layer(crack.felt(shoulder, angle_deg, offset_mm))?;
            Some(Felt { layer, rings_at_hz: crack.layer(1.0)?.frequency_hz() })
        });
        felt.min_by(|a, b| a.layer.stiffness_n_per_m.total_cmp(&b.layer.stiffness_n_per_m))
    }

    /// A random field along the ring with mean 0 and standard deviation 1: independent numbers at knots, smoothed by a
    /// Gaussian kernel.
    fn field(&self, key: Key, angle_deg: f64) -> f64 {
        // The field of a kernel of width s has the correlation exp(-d^2/(4 s^2)).
        let width = self.population.place_correlation_deg / (2.0_f64.sqrt() * KNOT_DEG);
        let at = angle_deg / KNOT_DEG;
        let reach = (3.0 * width).ceil().clamp(1.0, 49.0) as i64;
        let middle = at.round() as i64;
        let (mut sum, mut squares) = (0.0, 0.0);
        for knot in middle - reach..=middle + reach {
            let weight = (-0.5 * ((knot as f64 - at) / width).powi(2)).exp();
            sum += weight * key.number(knot.rem_euclid(KNOTS).cast_unsigned()).generator().normal();
            squares += weight * weight;
        }
        if squares > 0.0 { sum / squares.sqrt() } else { 0.0 }
    }
}

/// A layer as a tap finds it, and the frequency at which the whole of it rings.
#[derive(Debug, Clone, Copy)]
struct Felt {
    layer: Layer,
    rings_at_hz: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn casing(population: &Population, serial: &str, cracks: Vec<Crack>) -> Casing {
        Casing::new(population, 7, Serial::new(serial).unwrap(), cracks)
    }

    /// Correlation of two lists of mean 0.
    fn correlation(pairs: &[(f64, f64)]) -> f64 {
        let sum = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>();
        sum(&|p| p.0 * p.1) / (sum(&|p| p.0 * p.0) * sum(&|p| p.1 * p.1)).sqrt()
    }

    /// Catches a stiffness along the ring with another spread or correlation than stated, and a ring that does not
    /// close.
    #[test]
    fn stiffness_keeps_its_spread_and_correlation_along_the_ring() {
        let p = Population::rough();
        let mut here_and_there = Vec::new();
        let mut across = Vec::new();
        for number in 0..60 {
            let casing = casing(&p, &format!("C{number}"), Vec::new());
            let softer = 1.0 - SOFTER_PER_MM * 5.0;
            let value = |angle: f64, offset: f64, factor: f64| {
                let place = casing.place(1, angle, offset);
                (place.stiffness_n_per_m1_5 / casing.shoulders[0].stiffness / factor).ln()
            };
            for k in 0..36 {
                let angle = 10.0 * f64::from(k);
                here_and_there.push((value(angle, 0.0, 1.0), value(angle + p.place_correlation_deg, 0.0, 1.0)));
                across.push((value(angle, 0.0, 1.0), value(angle, 5.0, softer)));
            }
            assert!((value(0.0, 0.0, 1.0) - value(360.0, 0.0, 1.0)).abs() < 1e-12);
        }
        let sd = (here_and_there.iter().map(|p| p.0 * p.0).sum::<f64>() / here_and_there.len() as f64).sqrt();
        assert!((sd / p.place_stiffness - 1.0).abs() < 0.06, "{sd}");
        let along = correlation(&here_and_there);
        assert!((along - (-0.5_f64).exp()).abs() < 0.06, "{along}");
        let shared = correlation(&across);
        assert!((shared - p.place_shared).abs() < 0.1, "{shared}");
    }

    /// Catches modes of a place that change from call to call, or with another spread than stated.
    #[test]
    fn the_modes_of_a_place_stay_with_it() {
        let p = Population::rough();
        let casing = casing(&p, "C", Vec::new());
        let scatter = |angle: f64| casing.place(2, angle, 0.0).modes[0].level_v_per_n_s;
        let logs: Vec<f64> = (0..1000)
            .map(|k| (scatter(0.36 * f64::from(k)) / casing.shoulders[1].modes[0].level_v_per_n_s).ln())
            .collect();
        let sd = (logs.iter().map(|x| x * x).sum::<f64>() / 1000.0).sqrt();
        assert!((sd / p.place_modes - 1.0).abs() < 0.1, "{sd}");
        assert_eq!(scatter(7.2).to_bits(), scatter(7.2).to_bits());
    }

    /// Catches casings or shoulders that are copies of each other, and shoulders that differ as casings do.
    #[test]
    fn casings_differ_more_than_their_shoulders() {
        let p = Population { shoulder: 0.01, casing_stiffness: 0.05, ..Population::smooth() };
        let spread = |of: &dyn Fn(usize) -> f64| ((0..200).map(|k| of(k).powi(2)).sum::<f64>() / 200.0).sqrt();
        let casings: Vec<Casing> = (0..200).map(|k| casing(&p, &format!("C{k}"), Vec::new())).collect();
        let ln = |k: usize, shoulder: usize| (casings[k].shoulders[shoulder].stiffness / STIFFNESS_N_PER_M1_5).ln();
        let between = spread(&|k| ln(k, 0));
        let within = spread(&|k| ln(k, 0) - ln(k, 1)) / 2.0_f64.sqrt();
        assert!((between / 0.05_f64.hypot(0.01) - 1.0).abs() < 0.15, "{between}");
        assert!((within / 0.01 - 1.0).abs() < 0.15, "{within}");
    }

    /// Catches a layer whose band does not grow with the crack, and a layer without a crack.
    #[test]
    fn a_crack_brings_a_flexural_band() {
        let p = Population::smooth();
        let band = |length_mm: f64| {
            let crack = Crack { length_mm, reach_mm: 20.0, depth_mm: 12.0, ..Crack::default() }.over(10, 5, 100);
            casing(&p, "C", vec![crack]).place(1, 43.2, 0.0).modes[CASING.len()]
        };
        let bands = [8.0, 12.0, 16.0, 20.0].map(band);
        assert!(bands.windows(2).all(|b| b[1].level_v_per_n_s > b[0].level_v_per_n_s), "{bands:?}");
        assert!(bands.windows(2).all(|b| b[1].frequency_hz < b[0].frequency_hz), "{bands:?}");
        let sound = casing(&p, "C", Vec::new()).place(1, 43.2, 0.0);
        assert!(sound.layer.is_none() && sound.modes[CASING.len()].level_v_per_n_s.abs() < 1e-12);
    }
}
