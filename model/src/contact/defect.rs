//! The defect model: the layer above a crack bends as a plate on two edges (section 3.4 of the dissertation).

use std::f64::consts::PI;

use crate::{Error, Scene, integral_contact};

/// Contact quantities over a crack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DefectContact {
    /// Peak force (root of Eq. 32, corrected).
    pub f_max_n: f64,
    /// Impact duration (Eq. 20 with m_1, not the reduced mass).
    pub tau_s: f64,
    /// Largest local deformation alpha (Eq. 33).
    pub alpha_max_m: f64,
    /// Largest deflection of the surface: local deformation and bending, without cos^2 d (Eq. 46).
    pub d_max_m: f64,
    /// Bending stiffness of the layer (Eq. 23).
    pub k_f_n_per_m: f64,
    /// Fraction of the impact's energy lost to bending (Eq. 34).
    pub lambda_f: f64,
}

/// Closed form of the defect model for `scene`.
///
/// Deviation from Eq. 32 as printed: its left side is V^2/(2 M), with which the dissertation's tables are reproduced.
///
/// # Errors
/// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds.
pub fn defect_contact(scene: &Scene) -> Result<DefectContact, Error> {
    let f_integral = integral_contact(scene)?.f_max_n;
    let (v, m_1, k_c, k_f) = (scene.velocity_m_per_s, scene.m_1_kg, scene.k_c_n_per_m1_5(), scene.k_f_n_per_m());
    // Eq. 32 in x = F/F_integral, divided by its left side: x^(5/3) + b x^2 = 1.
    let energy = v * v / (2.0 * scene.mass_factor_per_kg());
    let b = scene.cos2_d() * f_integral * f_integral / (2.0 * k_f) / energy;
    let f_max_n = f_integral * unit_root(b);
    let alpha_max_m = (f_max_n / k_c).cbrt().powi(2); // Eq. 33
    Ok(DefectContact {
        f_max_n,
        tau_s: PI * m_1 * v / f_max_n, // Eq. 20
        alpha_max_m,
        d_max_m: alpha_max_m + f_max_n / k_f, // Eq. 46
        k_f_n_per_m: k_f,
        lambda_f: scene.cos2_d() * f_max_n * f_max_n / (m_1 * v * v * k_f), // Eq. 34
    })
}

/// Root of x^(5/3) + b x^2 = 1 in (0, 1], for b >= 0.
///
/// The left side rises and is convex, so Newton's method from above converges to the root; it ends when rounding stops
/// it. Each of the two terms alone gives an upper bound, and the root is within a factor 2 of the smaller one.
fn unit_root(b: f64) -> f64 {
    const STEPS_MAX: usize = 64;
    let mut x = if b > 1.0 { 1.0 / b.sqrt() } else { 1.0 };
    for _ in 0..STEPS_MAX {
        let x_2_3 = x.cbrt().powi(2);
        let excess = x_2_3 * x + b * x * x - 1.0;
        let next = x - excess / (5.0 / 3.0 * x_2_3 + 2.0 * b * x);
        if next.partial_cmp(&x) != Some(std::cmp::Ordering::Less) || next <= 0.0 {
            return x;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The slow twin: bisection to the last bit.
    fn unit_root_slow(b: f64) -> f64 {
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for _ in 0..2000 {
            let x = 0.5 * (low + high);
            if x.powf(5.0 / 3.0) + b * x * x > 1.0 { high = x } else { low = x }
        }
        0.5 * (low + high)
    }

    /// Catches m_1 V^2/2 on the left of Eq. 32, cos^2 d in d_max, the reduced mass in tau: Tables 8 to 11.
    #[test]
    fn baseline_is_that_of_the_tables() {
        let contact = defect_contact(&Scene::default()).unwrap();
        assert!((contact.f_max_n / 33.650_495 - 1.0).abs() < 1e-6);
        assert!((contact.tau_s / 0.777_217_7e-3 - 1.0).abs() < 1e-6);
        assert!((contact.d_max_m / 0.569_934_7e-3 - 1.0).abs() < 1e-6);
        assert!((contact.lambda_f - 0.02415).abs() < 5e-6);
        let shallow = defect_contact(&Scene { h_m: 2.54e-3, ..Scene::default() }).unwrap();
        assert!((shallow.f_max_n / 6.612_760_9 - 1.0).abs() < 1e-6);
    }

    proptest! {
        /// Catches a Newton iteration that stops early or leaves the bracket, for any fraction of bending.
        #[test]
        fn newton_agrees_with_bisection(exponent in -40.0..40.0_f64) {
            let b = 10_f64.powf(exponent);
            let (fast, slow) = (unit_root(b), unit_root_slow(b));
            prop_assert!((fast / slow - 1.0).abs() < 4e-15, "b = {b}: {fast} against {slow}");
        }

        /// Catches a panic or NaN at the extremes of what a scene may hold.
        #[test]
        fn any_valid_scene_has_finite_quantities(h in -12.0..15.0_f64, l in -12.0..15.0_f64, v in -12.0..15.0_f64) {
            let scene = Scene { h_m: 10_f64.powf(h), l_m: 10_f64.powf(l), velocity_m_per_s: 10_f64.powf(v), ..Scene::default() };
            if scene.validate().is_ok() {
                let c = defect_contact(&scene).unwrap();
                for value in [c.f_max_n, c.tau_s, c.alpha_max_m, c.d_max_m, c.k_f_n_per_m, c.lambda_f] {
                    prop_assert!(value.is_finite() && value >= 0.0, "{c:?}");
                }
            }
        }
    }
}
