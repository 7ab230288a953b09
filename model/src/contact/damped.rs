//! The damped contact on a rigid target, from a table over chi instead of its differential equation.

use crate::Error;
use crate::contact::damped_table::{CHI_MAX, CHI_MIN, SERIES};
use crate::error::within;

/// The contact a'' = -a^1.5 (1 + chi a') that begins with a = 0 and a' = 1.
///
/// In these units, lengths are in L = (m V^2/K_c)^0.4, times in T = L/V and forces in m V^2/L, so that chi alone
/// describes every contact of a mass m with a rigid target. The values are within 1e-7 of the differential equation's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DampedContact {
    /// Peak force.
    pub f_max: f64,
    /// Time at which the force is 0 again.
    pub contact_time: f64,
    /// Largest deformation.
    pub alpha_max: f64,
    /// Velocity at the end, reversed.
    pub restitution: f64,
}

impl DampedContact {
    /// Elastic contact, chi = 0, which has a closed form (Eqs. 15 and 16; 2.943275184 = 2 int_0^1 dx/sqrt(1 - x^2.5)).
    const ELASTIC: Self = Self {
        f_max: 1.143_262_629_818_316,
        contact_time: 3.218_065_459_719_043,
        alpha_max: 1.093_362_073_943_278_1,
        restitution: 1.0,
    };

    /// The contact with damping ratio `chi`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a chi outside 0 to 16, more than any [`DampingLaw`](crate::DampingLaw) asks for.
    pub fn new(chi: f64) -> Result<Self, Error> {
        let chi = within("chi", chi, 0.0, CHI_MAX)?;
        if chi >= CHI_MIN {
            return Ok(Self::from_table(chi));
        }
        // ln chi is unbounded towards elastic contact; below the table, a straight line is within 1e-9.
        let (share, end) = (chi / CHI_MIN, Self::from_table(CHI_MIN));
        let between = |from: f64, to: f64| from + share * (to - from);
        Ok(Self {
            f_max: between(Self::ELASTIC.f_max, end.f_max),
            contact_time: between(Self::ELASTIC.contact_time, end.contact_time),
            alpha_max: between(Self::ELASTIC.alpha_max, end.alpha_max),
            restitution: between(Self::ELASTIC.restitution, end.restitution),
        })
    }

    fn from_table(chi: f64) -> Self {
        let x = 2.0 * (chi / CHI_MIN).ln() / (CHI_MAX / CHI_MIN).ln() - 1.0;
        let [f_max, contact_time, alpha_max, restitution] = chebyshev(x);
        Self { f_max, contact_time, alpha_max, restitution }
    }
}

/// Sums of the four Chebyshev series at `x` (Clenshaw's recurrence), computed side by side: each step of one series depends
/// on the step before it.
fn chebyshev(x: f64) -> [f64; 4] {
    let (mut b_1, mut b_2) = ([0.0; 4], [0.0; 4]);
    for row in SERIES[1..].iter().rev() {
        let next = std::array::from_fn(|i| 2.0 * x * b_1[i] - b_2[i] + row[i]);
        (b_1, b_2) = (next, b_1);
    }
    std::array::from_fn(|i| x * b_1[i] - b_2[i] + SERIES[0][i])
}

#[cfg(test)]
#[path = "damped_tests.rs"]
mod tests;
