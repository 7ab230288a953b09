//! Curves over the shades of planted cracks.

use anyhow::Result;
use plotters::prelude::*;
use tapline_draw::canvas::{Area, Point, units};

use super::{Shade, dot, shade};
use tapline_draw::axes::{Axis, Frame, axes};

/// One curve.
#[derive(Debug, Clone)]
pub(in crate::experiment) struct Curve {
    /// A NaN point interrupts it.
    pub points: Vec<Point>,
    pub color: RGBColor,
    /// Width of the line or radius of the dots, pixels.
    pub width: f64,
    /// Dots in place of a line.
    pub has_dots: bool,
}

pub(super) fn draw(
    area: &Area<'_>,
    frame: &Frame,
    (x, y): (&Axis, &Axis),
    curves: &[Curve],
    shades: &[Shade],
) -> Result<()> {
    let mut chart = axes(area, frame, x, y)?;
    let (low, high) = y.range;
    let under = |s: &Shade| Rectangle::new([(s.from, low), (s.to, high)], shade(s.severity).filled());
    chart.draw_series(shades.iter().map(under))?;
    for curve in curves {
        if curve.has_dots {
            let points = curve.points.iter().filter(|p| p.1.is_finite());
            chart.draw_series(points.map(|&p| dot(p, curve.width, curve.color)))?;
            continue;
        }
        for run in curve.points.split(|p| !p.1.is_finite()).filter(|run| !run.is_empty()) {
            let style = curve.color.stroke_width(units(curve.width).unsigned_abs());
            chart.draw_series([PathElement::new(run.to_vec(), style)])?;
        }
    }
    Ok(())
}
