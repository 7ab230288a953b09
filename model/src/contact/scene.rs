//! The scene of one impact: the bodies, and the constants that follow from them.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::error::within;

/// Smallest positive quantity of a scene, in SI units.
///
/// Together with [`QUANTITY_MAX`] it keeps every closed form far from overflow and underflow.
const QUANTITY_MIN: f64 = 1e-12;
/// Largest quantity of a scene, in SI units.
const QUANTITY_MAX: f64 = 1e15;
/// Smallest restitution: below it the damped contact's peak exceeds the elastic one, which is unphysical.
pub(crate) const RESTITUTION_MIN: f64 = 0.1;

/// How the effective length l_e of a crack follows from its length l and the block's width w.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EffectiveLength {
    /// As used in the dissertation's tables of results: two straight lines in w/l.
    #[default]
    Published,
    /// As its text describes it: Table 1, interpolated.
    Table1,
}

impl EffectiveLength {
    /// Table 1: w/l, and l_e/l under a central load.
    const TABLE_1: [(f64, f64); 4] = [(1.0, 0.568), (1.2, 0.599), (1.6, 0.633), (2.0, 0.648)];
    /// Table 1's last column: l_e/l for w/l = infinity.
    const TABLE_1_WIDE: f64 = 0.656;

    /// l_e/l for the aspect ratio w/l.
    ///
    /// Both rules are continuous. The dissertation gives no values below w/l = 1: there `Published` continues its line,
    /// and `Table1` keeps its first column.
    pub fn ratio(self, w_per_l: f64) -> f64 {
        match self {
            Self::Published if w_per_l <= 2.0 => 0.568 + 0.08 * (w_per_l - 1.0),
            Self::Published => 0.648 + 0.00045 * (w_per_l - 2.0),
            Self::Table1 => Self::interpolated(w_per_l),
        }
    }

    fn interpolated(w_per_l: f64) -> f64 {
        let (first, last) = (Self::TABLE_1[0], Self::TABLE_1[3]);
        if w_per_l <= first.0 {
            return first.1;
        }
        if w_per_l > last.0 {
            // Linear in l/w, in which a column at infinity is at 0.
            return Self::TABLE_1_WIDE + (last.1 - Self::TABLE_1_WIDE) * last.0 / w_per_l;
        }
        for pair in Self::TABLE_1.windows(2) {
            let [(x_0, y_0), (x_1, y_1)] = [pair[0], pair[1]];
            if w_per_l <= x_1 {
                return y_0 + (y_1 - y_0) * (w_per_l - x_0) / (x_1 - x_0);
            }
        }
        last.1
    }
}

/// One impact: body 1 is the impactor, body 2 the block with a crack of length l at depth h.
///
/// The default is the baseline of Tables 2, 3 and 7.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// Impact velocity V.
    pub velocity_m_per_s: f64,
    /// Mass of the impactor.
    pub m_1_kg: f64,
    /// Mass of the target.
    pub m_2_kg: f64,
    /// Young's modulus of the impactor.
    pub e_1_pa: f64,
    /// Young's modulus of the target.
    pub e_2_pa: f64,
    /// Poisson's ratio of the impactor.
    pub nu_1: f64,
    /// Poisson's ratio of the target.
    pub nu_2: f64,
    /// Density of the impactor.
    pub rho_1_kg_per_m3: f64,
    /// Density of the target.
    pub rho_2_kg_per_m3: f64,
    /// Depth h of the crack.
    pub h_m: f64,
    /// Length l of the crack.
    pub l_m: f64,
    /// Width w of the block.
    pub w_m: f64,
    /// Restitution coefficient e of the contact, for the models with damping.
    pub restitution: f64,
    /// Rebound resilience R of the target, for its loss tangent.
    pub resilience: f64,
    /// Rule for the effective length.
    pub effective_length: EffectiveLength,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            velocity_m_per_s: 1.85,
            m_1_kg: 0.0045,
            m_2_kg: 1.6483,
            e_1_pa: 70e9,
            e_2_pa: 17.9e6,
            nu_1: 0.30,
            nu_2: 0.49,
            rho_1_kg_per_m3: 2700.0,
            rho_2_kg_per_m3: 1143.0,
            h_m: 25.4e-3,
            l_m: 25.4e-3,
            w_m: 50.8e-3,
            restitution: 0.5,
            resilience: 0.25,
            effective_length: EffectiveLength::Published,
        }
    }
}

impl Scene {
    /// Checks every quantity against its bounds.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first that is not finite, not positive, or absurdly small or large.
    pub fn validate(&self) -> Result<(), Error> {
        for (name, value) in [
            ("velocity_m_per_s", self.velocity_m_per_s),
            ("m_1_kg", self.m_1_kg),
            ("m_2_kg", self.m_2_kg),
            ("e_1_pa", self.e_1_pa),
            ("e_2_pa", self.e_2_pa),
            ("rho_1_kg_per_m3", self.rho_1_kg_per_m3),
            ("rho_2_kg_per_m3", self.rho_2_kg_per_m3),
            ("h_m", self.h_m),
            ("l_m", self.l_m),
            ("w_m", self.w_m),
        ] {
            within(name, value, QUANTITY_MIN, QUANTITY_MAX)?;
        }
        within("nu_1", self.nu_1, 0.0, 0.5)?;
        within("nu_2", self.nu_2, 0.0, 0.5)?;
        within("restitution", self.restitution, RESTITUTION_MIN, 1.0)?;
        within("resilience", self.resilience, QUANTITY_MIN, 1.0)?;
        Ok(())
    }

    /// Equivalent radius r of the two bodies (Eqs. 10 and 11).
    pub(crate) fn contact_radius_m(&self) -> f64 {
        let r_1 = equivalent_radius_m(self.m_1_kg, self.rho_1_kg_per_m3);
        let r_2 = equivalent_radius_m(self.m_2_kg, self.rho_2_kg_per_m3);
        r_1 * r_2 / (r_1 + r_2)
    }

    /// Contact stiffness K_c in N/m^1.5 (Eq. 9, without its pi, which belongs in k_i and cancels).
    pub fn k_c_n_per_m1_5(&self) -> f64 {
        let r = self.contact_radius_m();
        let compliance = (1.0 - self.nu_1 * self.nu_1) / self.e_1_pa + (1.0 - self.nu_2 * self.nu_2) / self.e_2_pa;
        4.0 / 3.0 * r.sqrt() / compliance
    }

    /// Mass factor M = 1/m_1 + 1/m_2 in 1/kg (Eq. 14).
    pub fn mass_factor_per_kg(&self) -> f64 {
        1.0 / self.m_1_kg + 1.0 / self.m_2_kg
    }

    /// Effective length l_e of the crack.
    pub fn l_e_m(&self) -> f64 {
        self.l_m * self.effective_length.ratio(self.w_m / self.l_m)
    }

    /// Bending stiffness K_f in N/m of the layer above the crack (Eq. 23).
    pub fn k_f_n_per_m(&self) -> f64 {
        let l_e = self.l_e_m();
        let nu = self.nu_2;
        4.0 * PI * self.h_m.powi(3) / (3.0 * l_e * l_e) * self.e_2_pa / ((1.0 - nu) * (3.0 + nu))
    }

    /// Factor by which shear softens the layer above the crack: 1 + 2 (1 + nu_2) (h/l)^2/kappa, kappa = 5/6.
    ///
    /// Timoshenko's correction of the bending stiffness, with l instead of l_e. It makes the layer's stiffness
    /// independent of l where h > l; such a layer is not a plate, as the domain's ratio h/l shows.
    pub fn shear_factor(&self) -> f64 {
        /// Fraction of a rectangular section that carries the shear.
        const KAPPA: f64 = 5.0 / 6.0;
        1.0 + 2.0 * (1.0 + self.nu_2) * (self.h_m / self.l_m).powi(2) / KAPPA
    }

    /// c in K_f (x + c x^3/h^2), the force that deflects the layer above the crack by x.
    ///
    /// K_f is that of a circular plate of radius l_e, simply supported, loaded at its centre. Its membrane energy follows
    /// from the shape of its small deflection, w/x = (1 + nu)/(3 + nu) ((3 + nu)/(1 + nu) (1 - s^2) + 2 s^2 ln s) with
    /// s = r/l_e, and from in-plane equilibrium (von Karman) at an edge that does not move, as the casing around the
    /// crack holds it: c = (35465 + 28389 nu + 5242 nu^2 - 2710 nu^3 - 1395 nu^4 - 191 nu^5)/(864 (3 + nu)^3). That is
    /// 1.429 for nu = 0.3, where Timoshenko and Woinowsky-Krieger (Theory of Plates and Shells, art. 101) have 1.430.
    /// Bending is softened by shear, the membrane is not.
    pub fn membrane_coefficient(&self) -> f64 {
        const OF_NU: [f64; 6] = [35465.0, 28389.0, 5242.0, -2710.0, -1395.0, -191.0];
        let nu = self.nu_2;
        OF_NU.iter().rev().fold(0.0, |sum, k| sum * nu + k) / (864.0 * (3.0 + nu).powi(3))
    }

    /// Loss tangent tan d of the target (Eq. 26).
    pub fn loss_tangent(&self) -> f64 {
        -self.resilience.ln() / PI
    }

    /// cos^2 d of the loss angle.
    pub fn cos2_d(&self) -> f64 {
        let tan_d = self.loss_tangent();
        1.0 / (1.0 + tan_d * tan_d)
    }
}

/// Radius of the sphere of that mass and density (Eq. 11).
fn equivalent_radius_m(mass_kg: f64, rho_kg_per_m3: f64) -> f64 {
    (3.0 * mass_kg / (4.0 * PI * rho_kg_per_m3)).cbrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a wrong column, slope or branch of either rule, and two identical rules.
    #[test]
    fn effective_lengths_are_those_of_the_method() {
        let cases = [
            // w/l, published, Table 1 by hand
            (1.0, 0.568, 0.568),
            (1.1, 0.576, 0.5835),
            (1.2, 0.584, 0.599),
            (1.4, 0.600, 0.616),
            (1.8, 0.632, 0.6405),
            (2.0, 0.648, 0.648),
            (4.0, 0.6489, 0.652),
            (20.0, 0.6561, 0.6552),
        ];
        for (w_per_l, published, table_1) in cases {
            assert!((EffectiveLength::Published.ratio(w_per_l) - published).abs() < 1e-12, "published at {w_per_l}");
            assert!((EffectiveLength::Table1.ratio(w_per_l) - table_1).abs() < 1e-12, "table1 at {w_per_l}");
        }
        let scene = Scene { l_m: 50.8e-3 / 1.4, ..Scene::default() };
        let table_1 = Scene { effective_length: EffectiveLength::Table1, ..scene };
        assert!((scene.l_e_m() - 0.600 * scene.l_m).abs() < 1e-15);
        assert!((table_1.l_e_m() - 0.616 * scene.l_m).abs() < 1e-15);
    }

    /// Catches the rounded 0.44, and a resilience used as the restitution.
    #[test]
    fn loss_tangent_is_not_rounded() {
        assert!((Scene::default().loss_tangent() - 0.441_271_2).abs() < 1e-7);
    }

    /// Catches a quantity that is not checked, and an error that names another one.
    #[test]
    fn every_quantity_is_checked() {
        type Field = fn(&mut Scene) -> &mut f64;
        let fields: [(&str, Field); 14] = [
            ("velocity_m_per_s", |s| &mut s.velocity_m_per_s),
            ("m_1_kg", |s| &mut s.m_1_kg),
            ("m_2_kg", |s| &mut s.m_2_kg),
            ("e_1_pa", |s| &mut s.e_1_pa),
            ("e_2_pa", |s| &mut s.e_2_pa),
            ("nu_1", |s| &mut s.nu_1),
            ("nu_2", |s| &mut s.nu_2),
            ("rho_1_kg_per_m3", |s| &mut s.rho_1_kg_per_m3),
            ("rho_2_kg_per_m3", |s| &mut s.rho_2_kg_per_m3),
            ("h_m", |s| &mut s.h_m),
            ("l_m", |s| &mut s.l_m),
            ("w_m", |s| &mut s.w_m),
            ("restitution", |s| &mut s.restitution),
            ("resilience", |s| &mut s.resilience),
        ];
        assert_eq!(Scene::default().validate(), Ok(()));
        for (name, field) in fields {
            for bad in [-1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut scene = Scene::default();
                *field(&mut scene) = bad;
                let Err(Error::OutOfRange { name: named, value, .. }) = scene.validate() else {
                    panic!("{name} = {bad} passed");
                };
                assert_eq!(named, name);
                assert_eq!(value.to_bits(), bad.to_bits());
            }
        }
        let text = Scene { h_m: 0.0, ..Scene::default() }.validate().unwrap_err().to_string();
        assert!(text.contains("h_m is 0;") && text.contains("1000000000000000"), "{text}");
    }
}
