//! The domain of a contact model: the ratios that say whether its assumptions hold in a scene.

use std::ops::RangeInclusive;

use crate::{DampingLaw, Rung, Scene};

/// One ratio of a scene and the bounds within which a model's assumptions hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DomainCheck {
    /// Which ratio: one of [`Flags::NAMES`].
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Smallest value within the domain.
    pub low: f64,
    /// Largest value within the domain.
    pub high: f64,
}

impl DomainCheck {
    /// Whether the value is outside the bounds; NaN is.
    pub fn is_raised(&self) -> bool {
        !(self.low..=self.high).contains(&self.value)
    }
}

/// The domain of one answer: five ratios with the bounds of its rung.
///
/// | name | ratio | bound | reason |
/// |---|---|---|---|
/// | `h_per_l` | h/l | closed, plate: to 0.2; full: to 0.5; integral: from 1 | a thin plate bends; shear softens it (by a seventh at 0.2), and beyond 0.5 it is no plate; the integral model assumes no layer at all |
/// | `deflection_per_h` | deflection of the layer/h | closed, integral, plate: to 0.25; full: to 2 | the membrane carries part of the load (9 % at 0.25), later all of it |
/// | `contact_radius_per_h` | sqrt(r alpha)/h | to 0.2 | Hertz's contact is on a half-space |
/// | `restitution` | e | closed: from 0.95; else from [`DampingLaw::restitution_min`] | the closed form has no damping; laws are wrong for a small e |
/// | `l_per_w` | l/w | closed, plate, full: to 1 | Table 1 of effective lengths ends at w/l = 1 |
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flags([DomainCheck; 5]);

impl Flags {
    /// Names of the ratios, in their order.
    pub const NAMES: [&'static str; 5] =
        ["h_per_l", "deflection_per_h", "contact_radius_per_h", "restitution", "l_per_w"];

    /// The domain of `rung` with damping `law` in `scene`, for a contact that deformed by `alpha_max_m` and bent the layer
    /// by `deflection_m`.
    pub fn new(rung: Rung, law: DampingLaw, scene: &Scene, alpha_max_m: f64, deflection_m: f64) -> Self {
        let contact_radius_m = (scene.contact_radius_m() * alpha_max_m).sqrt();
        let [h_name, deflection_name, radius_name, restitution_name, l_name] = Self::NAMES;
        let check = |name, value, bounds: RangeInclusive<f64>| DomainCheck {
            name,
            value,
            low: *bounds.start(),
            high: *bounds.end(),
        };
        let e_min = if rung == Rung::Closed { 0.95 } else { law.restitution_min() };
        Self([
            check(h_name, scene.h_m / scene.l_m, h_per_l(rung)),
            check(deflection_name, deflection_m / scene.h_m, 0.0..=if rung == Rung::Full { 2.0 } else { 0.25 }),
            check(radius_name, contact_radius_m / scene.h_m, 0.0..=0.2),
            check(restitution_name, scene.restitution, e_min..=1.0),
            check(l_name, scene.l_m / scene.w_m, 0.0..=if rung == Rung::Integral { f64::INFINITY } else { 1.0 }),
        ])
    }

    /// All five ratios with their bounds.
    pub fn all(&self) -> &[DomainCheck; 5] {
        &self.0
    }

    /// The ratios that are outside their bounds.
    pub fn raised(&self) -> impl Iterator<Item = &DomainCheck> {
        self.0.iter().filter(|check| check.is_raised())
    }
}

fn h_per_l(rung: Rung) -> RangeInclusive<f64> {
    match rung {
        Rung::Closed | Rung::Plate => 0.0..=0.2,
        Rung::Integral => 1.0..=f64::INFINITY,
        Rung::Full => 0.0..=0.5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a ratio put upside down, compared with another's bound, or a bound that belongs to another rung.
    #[test]
    fn flags_are_raised_where_assumptions_end() {
        let raised = |rung, scene: &Scene, alpha, deflection| -> Vec<&str> {
            Flags::new(rung, DampingLaw::Exact, scene, alpha, deflection).raised().map(|c| c.name).collect()
        };
        let thin = Scene { h_m: 4e-3, l_m: 40e-3, restitution: 0.96, ..Scene::default() };
        for rung in [Rung::Closed, Rung::Plate, Rung::Full] {
            assert_eq!(raised(rung, &thin, 1e-6, 1e-4), [""; 0]);
            assert_eq!(raised(rung, &Scene { l_m: 60e-3, ..thin }, 1e-6, 1e-4), ["l_per_w"]);
            // sqrt(6.71 mm 0.6 mm) = 2 mm, half of h.
            assert_eq!(raised(rung, &thin, 0.6e-3, 1e-4), ["contact_radius_per_h"]);
        }
        let thick = Scene { l_m: 12e-3, ..thin };
        assert_eq!(raised(Rung::Plate, &thick, 1e-6, 1e-4), ["h_per_l"]);
        assert_eq!(raised(Rung::Full, &thick, 1e-6, 2e-3), [""; 0]);
        assert_eq!(raised(Rung::Plate, &thin, 1e-6, 2e-3), ["deflection_per_h"]);
        assert_eq!(raised(Rung::Full, &Scene { l_m: 7e-3, ..thin }, 1e-6, 9e-3), ["h_per_l", "deflection_per_h"]);
        let deep = Scene { h_m: 50e-3, l_m: 20e-3, restitution: 0.5, ..thin };
        assert_eq!(raised(Rung::Integral, &deep, 1e-6, 1e-6), [""; 0]);
        assert_eq!(raised(Rung::Closed, &deep, 1e-6, 1e-6), ["h_per_l", "restitution"]);
        assert_eq!(raised(Rung::Integral, &thin, 1e-6, f64::NAN), ["h_per_l", "deflection_per_h"]);
        let law =
            Flags::new(Rung::Plate, DampingLaw::LankaraniNikravesh, &Scene { restitution: 0.5, ..thin }, 1e-6, 1e-6);
        assert_eq!(law.raised().map(|c| (c.name, c.low)).collect::<Vec<_>>(), [("restitution", 0.8)]);
    }
}
