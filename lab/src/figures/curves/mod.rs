//! The dissertation's figures of its theory, as numbers: its closed form, and the more accurate rungs.

mod plans;
mod quantity;

use anyhow::{Context as _, Result};
use tapline_model::Rung;

/// One figure of the dissertation's theory.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// Its number in the dissertation.
    pub number: u8,
    /// What is drawn, and for which block.
    pub title: &'static str,
    /// What is varied.
    pub x: Axis,
    /// What is computed.
    pub y: Axis,
    /// The curves; those of one name lie next to each other, the closed form first.
    pub curves: Vec<Curve>,
}

/// What one axis of a figure measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    /// Name with its SI unit, as tables call it.
    pub name: &'static str,
    /// Name as people read it.
    pub label: &'static str,
    /// Unit to draw in; empty for a number without one.
    pub unit: &'static str,
    /// How many of that unit one SI unit is.
    pub per_si: f64,
}

/// One quantity on one rung, over what the figure varies.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    /// What distinguishes it from others in the figure: the factor that is varied, or the crack.
    pub name: &'static str,
    /// The rung that it is computed by; `Closed` is what the dissertation drew.
    pub rung: Rung,
    /// Its points, from left to right.
    pub points: Vec<Point>,
}

/// One point of a curve, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub x: f64,
    pub y: f64,
    /// Whether h/l is within the rung's domain: beyond it the layer above the crack is not the plate that the rung
    /// takes it for. True where there is no crack. For the other ratios see [`Flags`](tapline_model::Flags).
    pub in_domain: bool,
}

impl Figure {
    pub(super) const NUMBERS: [u8; 19] = [11, 12, 13, 16, 17, 18, 19, 20, 22, 23, 24, 25, 26, 27, 31, 32, 36, 37, 38];
}

/// Figure `number` of the dissertation.
///
/// The closed form comes with more accurate rungs: without a crack the damped contact (e = 0.5), with a
/// crack the plate in time and the full rung, all with exact damping. Their numbers are those of
/// [`Rung::contact`]; their duration is the contact's own. The flexural energy loss of the rungs in time is 1 - e^2
/// (Eq. 3) of an impact whose contact loses nothing (e = 1), so that all lost energy is in the layer.
///
/// As [`Impact::plate`](tapline_model::Impact::plate) has it, K_c of the rungs in time is that of the baseline's masses: under
/// the factor m_1 they show the effect of the mass alone.
///
/// # Errors
/// A number that is not in [`Figure::NUMBERS`], or an integration that does not end.
pub(super) fn figure(number: u8) -> Result<Figure> {
    let plan = plans::plan(number).with_context(|| {
        format!("there is no figure {number}; the figures are 11-13, 16-20, 22-27, 31, 32 and 36-38")
    })?;
    let mut curves = Vec::new();
    for family in &plan.families {
        for &rung in family.subject.rungs() {
            let points = plan.x.values().map(|x| family.point(plan.x, rung, x)).collect::<Result<_, _>>()?;
            curves.push(Curve { name: family.name, rung, points });
        }
    }
    Ok(Figure { number, title: plan.title, x: plan.x.axis(), y: plan.y, curves })
}

#[cfg(test)]
mod tests;
