//! Cracks of a simulated tyre: where they are, their effect on a tap, and the truth.

use std::f64::consts::{FRAC_PI_2, PI};

use serde::{Deserialize, Serialize};

use crate::tyre::identity::Identity;
use crate::{Error, Plate, Scene};

/// A separation between two layers of a casing's shoulder.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Crack {
    /// Side of the casing, 1 or 2.
    pub shoulder: u16,
    /// First location of its arc.
    pub first_location: u32,
    /// Locations of its arc, which may wrap around the end of the ring.
    pub location_count: u32,
    /// Depth under the surface.
    pub depth_mm: f64,
    /// Length across the shoulder.
    pub length_mm: f64,
    /// Where across the shoulder it begins: the belt edge is 0, the tyre's centre is at positive offsets.
    pub offset_mm: f64,
}

impl Default for Crack {
    fn default() -> Self {
        Self { shoulder: 1, first_location: 0, location_count: 5, depth_mm: 6.0, length_mm: 22.0, offset_mm: 0.0 }
    }
}

/// Width, in mm, of the rim outside a crack in which it still has an effect.
const RIM_MM: f64 = 4.0;
/// Fraction of a crack's effect at the two ends of its arc, where it closes.
const ARC_END: f64 = 0.8;
/// Stiffness of the cords and of the closing gap, in parallel with bending: it keeps a shallow layer from folding.
const CORDS_N_PER_M: f64 = 8.0e4;
/// Frequency of a layer without its own mass: the surroundings of the crack move with it and load it.
const LOADED_HZ: f64 = 850.0;

impl Crack {
    /// Checks every quantity against its bounds; `serial` and `number`, from 1, go into the error.
    ///
    /// # Errors
    /// [`Error::Crack`] with the first quantity that is out of them.
    pub fn validate(&self, serial: &str, number: usize) -> Result<(), Error> {
        for (name, value, low, high) in [
            ("shoulder", f64::from(self.shoulder), 1.0, f64::from(u16::MAX)),
            ("location_count", f64::from(self.location_count), 1.0, f64::from(u32::MAX)),
            ("depth_mm", self.depth_mm, 0.5, 100.0),
            ("length_mm", self.length_mm, 1.0, 500.0),
            ("offset_mm", self.offset_mm, -2000.0, 2000.0),
        ] {
            if !(low..=high).contains(&value) {
                return Err(Error::Crack { serial: serial.to_owned(), number, name, value, low, high });
            }
        }
        Ok(())
    }

    /// Whether the crack's arc covers `location` of a ring of `ring_count`.
    pub fn covers(&self, shoulder: u16, location: u32, ring_count: u32) -> bool {
        self.place_on_arc(shoulder, location, ring_count).is_some()
    }

    /// Position of `location` along the arc, from 0.
    fn place_on_arc(&self, shoulder: u16, location: u32, ring_count: u32) -> Option<u32> {
        let n = u64::from(ring_count.max(1));
        let place = (u64::from(location) % n + n - u64::from(self.first_location) % n) % n;
        (shoulder == self.shoulder)
            .then_some(place)
            .and_then(|p| u32::try_from(p).ok())
            .filter(|&p| p < self.location_count)
    }

    /// Fraction of the crack's effect on a tap, 0 to 1.
    ///
    /// A belt-edge crack gapes at its beginning and closes towards its tip: in Fig. 60 its effect is strongest at x =
    /// 0, and the curve at 15 mm is almost flat.
    pub(crate) fn felt(&self, shoulder: u16, location: u32, ring_count: u32, offset_mm: f64) -> f64 {
        let Some(place) = self.place_on_arc(shoulder, location, ring_count) else { return 0.0 };
        let is_end = place == 0 || place + 1 == self.location_count;
        let along = if is_end && self.location_count < ring_count { ARC_END } else { 1.0 };
        let x = offset_mm - self.offset_mm;
        let distance = if x < 0.0 { -x / RIM_MM } else { x / self.length_mm };
        // NaN compares false, so it has no effect.
        if distance < 1.0 { along * (FRAC_PI_2 * distance).cos().powi(2) } else { 0.0 }
    }

    /// The layer above the crack for a tap that feels the fraction `felt` of it.
    ///
    /// Its whole impedance grows with 1/`felt`: a smaller effect means less motion at the same frequency, and no effect
    /// means a rigid target. Deep cracks are stiff and heavy, so they look sound by themselves.
    pub(crate) fn plate(&self, scene: &Scene, felt: f64) -> Plate {
        let scene = Scene { h_m: self.depth_mm * 1e-3, l_m: self.length_mm * 1e-3, ..*scene };
        let stiffness = scene.k_f_n_per_m() + CORDS_N_PER_M;
        let load = stiffness / (2.0 * PI * LOADED_HZ).powi(2);
        let mass = scene.rho_2_kg_per_m3 * scene.w_m * scene.l_m * scene.h_m / 4.0 + load;
        Plate {
            mass_kg: mass / felt,
            damping_n_s_per_m: scene.loss_tangent() * (stiffness * mass).sqrt() / felt,
            stiffness_n_per_m: stiffness / felt,
            membrane_n_per_m3: 0.0,
        }
    }
}

/// Default cracks of a damaged tyre: 3-12 mm deep, 20-25 mm long, 3-10 locations wide, at the belt edge of shoulder 1.
///
/// Each lies in its own sector of the ring of `location_count`, at least a third of a sector from the next. A ring too
/// short for sectors of 6 locations gets fewer cracks.
pub fn plant_cracks(seed: u64, serial: &str, location_count: u32, crack_count: u32) -> Vec<Crack> {
    const WIDTHS: (u32, u32) = (3, 10);
    let mut generator = Identity::new(seed, "cracks").text(serial).generator();
    let crack_count = crack_count.min(location_count / 6);
    let turn = generator.below(location_count);
    (0..crack_count)
        .map(|number| {
            let sector = location_count / crack_count;
            let room = sector - sector / 3;
            let width_max = WIDTHS.1.min(room);
            let width = WIDTHS.0 + generator.below(width_max - WIDTHS.0 + 1);
            let first = number * sector + generator.below(room - width + 1);
            Crack {
                shoulder: 1,
                // Not (first + turn) % location_count, whose sum can overflow.
                first_location: if first < location_count - turn {
                    first + turn
                } else {
                    first - (location_count - turn)
                },
                location_count: width,
                depth_mm: 3.0 + 9.0 * generator.uniform(),
                length_mm: 20.0 + 5.0 * generator.uniform(),
                offset_mm: 0.0,
            }
        })
        .collect()
}

/// For each location of `shoulder`, whether one of `cracks` covers it.
pub fn truth(cracks: &[Crack], shoulder: u16, location_count: u32) -> Vec<bool> {
    (0..location_count).map(|location| cracks.iter().any(|c| c.covers(shoulder, location, location_count))).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Catches an arc that stops at the end of the ring or reaches the other shoulder.
    #[test]
    fn arcs_go_on_over_the_end_of_the_ring() {
        let crack = Crack { first_location: 98, location_count: 4, ..Crack::default() };
        let truth_1 = truth(&[crack], 1, 100);
        let cracked: Vec<usize> = (0..100).filter(|&i| truth_1[i]).collect();
        assert_eq!(cracked, [0, 1, 98, 99]);
        assert!(truth(&[crack], 2, 100).iter().all(|&is_cracked| !is_cracked));
        assert!(crack.covers(1, 100, 100), "the closing tap is location 0 again");
    }

    /// Catches a profile across the shoulder that jumps, or is not strongest at the belt edge.
    #[test]
    fn cracks_fade_towards_their_tip() {
        let crack = Crack { first_location: 10, location_count: 5, ..Crack::default() };
        let felt = |x: f64| crack.felt(1, 12, 100, x);
        assert!((felt(0.0) - 1.0).abs() < 1e-12);
        assert!(felt(5.0) > 0.8 && felt(10.0) < 0.65 && felt(15.0) < 0.25 && felt(-2.0) < 0.6);
        for i in -100..400 {
            let x = f64::from(i) * 0.1;
            assert!((felt(x) - felt(x + 0.1)).abs() < 0.05, "jump at {x} mm");
        }
        assert!(crack.felt(1, 9, 100, 0.0) < 1e-12 && felt(f64::NAN) < 1e-12);
    }

    proptest! {
        /// Catches default cracks that are out of bounds, overlap, touch, or depend on more than seed and serial
        /// number.
        #[test]
        fn planted_cracks_are_apart(seed in any::<u64>(), ring in 0..300_u32, count in 0..8_u32) {
            let cracks = plant_cracks(seed, "SIM-0001", ring, count);
            prop_assert_eq!(&cracks, &plant_cracks(seed, "SIM-0001", ring, count));
            let truth = truth(&cracks, 1, ring);
            let cracked = truth.iter().filter(|&&t| t).count();
            prop_assert_eq!(cracked, cracks.iter().map(|c| c.location_count as usize).sum::<usize>());
            let starts = (0..truth.len()).filter(|&i| truth[i] && !truth[(i + truth.len() - 1) % truth.len()]).count();
            prop_assert_eq!(starts, cracks.len());
            for crack in &cracks {
                prop_assert!(crack.validate("SIM-0001", 1).is_ok());
                prop_assert!((3.0..12.0).contains(&crack.depth_mm) && (20.0..25.0).contains(&crack.length_mm));
                prop_assert!((3..=10).contains(&crack.location_count));
            }
            prop_assert!(ring < 100 || count > 5 || cracks.len() == count as usize);
        }
    }
}
