//! The integral model: an elastic sphere hits a block without a crack (section 3.3.3 of the dissertation).

use std::f64::consts::PI;

use crate::{Error, Scene};

/// Contact quantities of a casing without a crack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntegralContact {
    /// Peak force (Eq. 16).
    pub f_max_n: f64,
    /// Impact duration by Eq. 20; the elastic contact itself lasts 2.9432 alpha/V, which is longer.
    pub tau_s: f64,
    /// Largest local deformation alpha (Eq. 15).
    pub alpha_max_m: f64,
}

/// Closed form of the integral model for `scene`.
///
/// # Errors
/// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds.
pub fn integral_contact(scene: &Scene) -> Result<IntegralContact, Error> {
    scene.validate()?;
    let (v, k_c, m) = (scene.velocity_m_per_s, scene.k_c_n_per_m1_5(), scene.mass_factor_per_kg());
    let alpha_max_m = (5.0 * v * v / (4.0 * k_c * m)).powf(0.4); // Eq. 15
    let f_max_n = k_c * alpha_max_m * alpha_max_m.sqrt(); // Eq. 16
    let tau_s = PI * scene.m_1_kg * v / f_max_n; // Eq. 20
    Ok(IntegralContact { f_max_n, tau_s, alpha_max_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a stray pi in K_c, a wrong mass or a wrong power: Tables 4, 5 and 6 at the baseline.
    #[test]
    fn baseline_is_that_of_the_tables() {
        let contact = integral_contact(&Scene::default()).unwrap();
        assert!((contact.f_max_n / 34.149_113 - 1.0).abs() < 1e-6);
        assert!((contact.tau_s / 0.765_869_3e-3 - 1.0).abs() < 1e-6);
        assert!((contact.alpha_max_m / 0.562_215_1e-3 - 1.0).abs() < 1e-6);
    }
}
