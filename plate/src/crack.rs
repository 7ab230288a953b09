//! Cracks: their effect on a tap, and the layer that they loosen.

use std::f64::consts::PI;

use crate::contact::Layer;

/// Young's modulus, Poisson's ratio and density of the layer, rubber with cords in it (assumed).
const LAYER_PA: f64 = 60e6;
const LAYER_NU: f64 = 0.49;
const LAYER_KG_PER_M3: f64 = 1143.0;
/// Shear modulus of the layer, determined by the rubber between the cords (assumed).
const SHEAR_PA: f64 = 20e6;
/// Fraction of a plate's section that carries shear (Reissner 1945).
const SHEAR_PART: f64 = 5.0 / 6.0;
/// Radius of the area that the impactor presses, m.
const PRESSED_M: f64 = 3e-3;
/// Mass that moves with the layer besides its own: cords and rubber around it (assumed).
const CARRIED_KG: f64 = 5e-3;
/// Damping of the layer, relative to critical damping.
const LAYER_DAMPING: f64 = 0.08;
/// Angle over which a crack's effect falls at either end of its arc.
const TAPER_DEG: f64 = 5.4;
/// Width of the rim outside the belt's edge in which a crack has an effect.
const RIM_MM: f64 = 4.0;
/// Smallest effect that counts.
const FELT_LEAST: f64 = 2e-3;

/// A separation at the belt's edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crack {
    /// Side of the casing, 1 or 2.
    pub shoulder: u16,
    /// Angle at which its arc begins.
    pub angle_deg: f64,
    /// Length of its arc; 360 is the whole ring.
    pub arc_deg: f64,
    /// Depth under the surface: thickness of the loosened layer.
    pub depth_mm: f64,
    /// Span of the loosened layer that bends.
    pub length_mm: f64,
    /// How far it reaches from the belt's edge towards the tyre's centre, which decides the offsets that detect it.
    pub reach_mm: f64,
    /// 0 to 1: fraction of the layer's compliance that a tap finds; less than 1 if the faces still hold together.
    pub severity: f64,
}

impl Default for Crack {
    fn default() -> Self {
        Self {
            shoulder: 1,
            angle_deg: 0.0,
            arc_deg: 18.0,
            depth_mm: 8.0,
            length_mm: 20.0,
            reach_mm: 20.0,
            severity: 1.0,
        }
    }
}

impl Crack {
    /// The same crack, covering `count` locations of a ring of `location_count`, from location `first` on.
    pub fn over(self, first: u32, count: u32, location_count: u32) -> Self {
        let step_deg = 360.0 / f64::from(location_count.max(1));
        Self { angle_deg: (f64::from(first) - 0.5) * step_deg, arc_deg: f64::from(count) * step_deg, ..self }
    }

    /// Whether its arc covers the place at `angle_deg` of `shoulder`; such a place is labelled cracked.
    pub fn covers(&self, shoulder: u16, angle_deg: f64) -> bool {
        shoulder == self.shoulder && self.inside_deg(angle_deg) >= 0.0
    }

    /// Degrees from the nearer end of the arc, positive inside.
    fn inside_deg(&self, angle_deg: f64) -> f64 {
        if self.arc_deg >= 360.0 {
            return 360.0;
        }
        let from_middle = (angle_deg - self.angle_deg - 0.5 * self.arc_deg + 180.0).rem_euclid(360.0) - 180.0;
        0.5 * self.arc_deg - from_middle.abs()
    }

    /// Fraction of the layer's compliance that a tap at `angle_deg` and `offset_mm` of `shoulder` finds.
    ///
    /// It is 0 from half a taper beyond the ends of the arc, so that a location beside a crack is a little soft; across
    /// the shoulder it falls from 0.3 of the reach on, to 0 at 1.2 of it.
    pub fn felt(&self, shoulder: u16, angle_deg: f64, offset_mm: f64) -> f64 {
        if shoulder != self.shoulder {
            return 0.0;
        }
        let along = fall(0.5 - self.inside_deg(angle_deg) / TAPER_DEG);
        let across =
            if offset_mm < 0.0 { fall(-offset_mm / RIM_MM) } else { fall((offset_mm / self.reach_mm - 0.3) / 0.9) };
        let felt = self.severity * along * across;
        if felt > FELT_LEAST { felt } else { 0.0 } // NaN has no effect
    }

    /// The loosened layer for a tap that finds the fraction `felt` of its compliance.
    ///
    /// A round plate, clamped at its rim and loaded in its middle, deflects by bending, P a^2/(16 pi D) (Timoshenko and
    /// Woinowsky-Krieger, *Theory of Plates and Shells*, 1959, section 19), and by shear between the pressed area and
    /// its rim, P ln(a/c)/(2 pi k G h).
    pub fn layer(&self, felt: f64) -> Option<Layer> {
        if felt <= 0.0 || felt.is_nan() {
            return None;
        }
        let (h, a) = (self.depth_mm * 1e-3, 0.5e-3 * self.length_mm);
        let bending = LAYER_PA * h.powi(3) / (12.0 * (1.0 - LAYER_NU * LAYER_NU));
        let by_bending = a * a / (16.0 * PI * bending);
        let by_shear = (a / PRESSED_M).ln_1p() / (2.0 * PI * SHEAR_PART * SHEAR_PA * h);
        let stiffness_n_per_m = 1.0 / ((by_bending + by_shear) * felt);
        // The effective mass of a clamped round plate in its first mode is 0.153 of its mass: 16 pi/10.22^2 rho h a^2.
        let mass_kg = CARRIED_KG + 0.153 * LAYER_KG_PER_M3 * h * PI * a * a;
        let damping_n_s_per_m = 2.0 * LAYER_DAMPING * (stiffness_n_per_m * mass_kg).sqrt();
        Some(Layer { stiffness_n_per_m, mass_kg, damping_n_s_per_m })
    }
}

/// 1 up to 0, 0 from 1 on, half a cosine in between.
fn fall(x: f64) -> f64 {
    0.5 + 0.5 * (PI * x.clamp(0.0, 1.0)).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches an arc that is off by a location, stops at 360 degrees, or is on both shoulders.
    #[test]
    fn an_arc_covers_its_locations() {
        let crack = Crack::default().over(98, 4, 100);
        let covered: Vec<u32> = (0..100).filter(|&l| crack.covers(1, f64::from(l) * 3.6)).collect();
        assert_eq!(covered, [0, 1, 98, 99]);
        assert!(!crack.covers(2, 0.0));
        let all = Crack::default().over(0, 100, 100);
        assert!((0..100).all(|l| all.covers(1, f64::from(l) * 3.6) && all.felt(1, f64::from(l) * 3.6, 0.0) > 0.99));
    }

    /// Catches a crack whose effect is not largest at the belt's edge and in its middle, and an effect beyond its
    /// reach.
    #[test]
    fn a_crack_is_felt_where_it_reaches() {
        let crack = Crack { reach_mm: 10.0, ..Crack::default() }.over(10, 5, 100);
        let felt = |location: u32, offset| crack.felt(1, f64::from(location) * 3.6, offset);
        assert!((felt(12, 0.0) - 1.0).abs() < 1e-12);
        assert!(felt(12, 5.0) > 0.7 && felt(12, 10.0) < 0.3 && felt(12, 15.0).abs() < 1e-12);
        assert!(felt(10, 0.0) > 0.9 && felt(9, 0.0) < 0.1 && felt(8, 0.0).abs() < 1e-12);
        assert!(crack.felt(2, 43.2, 0.0).abs() < 1e-12 && felt(12, f64::NAN).abs() < 1e-12);
    }

    /// Catches a layer that does not soften with the crack's length and shallowness, or whose frequency does not
    /// follow.
    #[test]
    fn longer_and_shallower_cracks_are_softer_and_lower() {
        let layer = |depth_mm, length_mm| Crack { depth_mm, length_mm, ..Crack::default() }.layer(1.0).unwrap();
        let by_length = [10.0, 15.0, 20.0, 25.0].map(|length| layer(12.0, length));
        let by_depth = [20.0, 12.0, 6.0, 3.0].map(|depth| layer(depth, 20.0));
        for layers in [by_length, by_depth] {
            assert!(layers.windows(2).all(|l| l[1].stiffness_n_per_m < l[0].stiffness_n_per_m), "{layers:?}");
            assert!(layers.windows(2).all(|l| l[1].frequency_hz() < l[0].frequency_hz()), "{layers:?}");
        }
        let band = by_length.map(|l| l.frequency_hz());
        assert!(band.iter().all(|f| (1000.0..3500.0).contains(f)), "{band:?}");
        assert_eq!(Crack::default().layer(0.0), None);
    }
}
