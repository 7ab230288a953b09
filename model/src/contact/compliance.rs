//! Bounds of the effect of the layer above a crack on a contact, without an integration.
//!
//! In the contact's own units (lengths in L = (m_1 V^2/K_c)^0.4, times in T = L/V) the layer is two numbers beside its
//! loss tangent: its stiffness kappa = K T^2/m_1 and the square of its frequency, rho = kappa m_1/m_p. A stiff layer
//! changes each quantity of the contact in proportion to 1/kappa; the largest of the four relative changes, times
//! kappa, is the [map](crate::contact::compliance_map) A(e, rho). The bounds were checked against the differential equation
//! all over the map (`compliance_tests`); outside the map there is none.

use std::ops::RangeInclusive;

use crate::contact::compliance_map::{EFFECT, RESTITUTIONS, RHO_MAX, RHO_MIN, RHOS};
use crate::{DampedContact, Impact};

/// Loss tangent of the map, that of a resilience of 0.25.
pub(crate) const LOSS_TANGENT: f64 = 0.441_271_200_305;

/// A layer under a contact, within the map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Compliance {
    /// A/kappa: first-order change of the quantity that changes most.
    pub epsilon: f64,
    /// Largest fraction of the layer's force that the membrane can carry.
    pub membrane: f64,
}

impl Compliance {
    /// The compliance of the layer under `impact`, where `rigid` is the same contact on a rigid target; `None` outside the map.
    pub(crate) fn new(impact: &Impact, rigid: &DampedContact, loss_tangent: f64) -> Option<Self> {
        let Some(plate) = impact.plate else { return Some(Self { epsilon: 0.0, membrane: 0.0 }) };
        let e = within(rigid.restitution, RESTITUTIONS[0]..=1.0 + 1e-6)?;
        within(loss_tangent, 0.99 * LOSS_TANGENT..=1.01 * LOSS_TANGENT)?;
        let (length_m, time_s) = impact.units();
        let kappa = plate.stiffness_n_per_m * time_s * time_s / impact.mass_kg;
        let rho = plate.stiffness_n_per_m * time_s * time_s / plate.mass_kg;
        within(rho, RHO_MIN..=RHO_MAX)?;
        let epsilon = within(effect(e, rho) / kappa, 0.0..=epsilon_max(e))?;
        // The layer goes no farther than twice its static deflection, and no farther than the impulse throws it.
        let (pushed, thrown) = (2.0 * rigid.f_max / kappa, (1.0 + e) * rho.sqrt() / kappa);
        let deflection_m = length_m * if pushed < thrown { pushed } else { thrown };
        let membrane = plate.membrane_n_per_m3 * deflection_m * deflection_m / plate.stiffness_n_per_m;
        Some(Self { epsilon, membrane: within(membrane, 0.0..=0.25)? })
    }

    /// Upper bound of the relative difference of any quantity between a rigid target and this layer.
    pub(crate) fn bound(&self) -> f64 {
        self.epsilon * (FIRST_ORDER + SECOND_ORDER * self.epsilon + self.membrane)
    }

    /// Whether the layer under `impact` is known to change no quantity of the contact by more than `tolerance`. The
    /// target is then as good as rigid: such a deep crack is a sound casing.
    pub(crate) fn is_rigid(impact: &Impact, rigid: &DampedContact, loss_tangent: f64, tolerance: f64) -> bool {
        Self::new(impact, rigid, loss_tangent).is_some_and(|compliance| compliance.bound() <= tolerance)
    }
}

/// Safety factor for the linear interpolation between the nodes of the map.
const FIRST_ORDER: f64 = 1.15;
/// Second-order coefficient; larger than any found for 40 000 random layers.
const SECOND_ORDER: f64 = 1.0;

/// `value` if it lies within `bounds`; NaN does not.
fn within(value: f64, bounds: RangeInclusive<f64>) -> Option<f64> {
    bounds.contains(&value).then_some(value)
}

/// Largest epsilon of the map: the layer soon leaves behind a body that rebounds slowly, or hits it a second time.
fn epsilon_max(e: f64) -> f64 {
    (0.015 + (e - 0.3) * 0.9).clamp(0.015, 0.6)
}

/// A(e, rho), interpolated linearly in e and ln rho between the nodes.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a place within the map, clamped to it"
)]
fn effect(e: f64, rho: f64) -> f64 {
    let steps = (RHOS - 1) as f64;
    let x = ((rho / RHO_MIN).ln() / (RHO_MAX / RHO_MIN).ln() * steps).clamp(0.0, steps);
    let column = (x as usize).min(RHOS - 2);
    let x_share = x - column as f64;
    let row = RESTITUTIONS[1..RESTITUTIONS.len() - 1].iter().take_while(|&&node| node <= e).count();
    let y_share = (e - RESTITUTIONS[row]) / (RESTITUTIONS[row + 1] - RESTITUTIONS[row]);
    let along = |row: usize| EFFECT[row][column] + x_share * (EFFECT[row][column + 1] - EFFECT[row][column]);
    along(row) + y_share * (along(row + 1) - along(row))
}

#[cfg(test)]
#[path = "compliance_tests.rs"]
mod tests;
