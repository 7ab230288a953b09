//! A pair of axes, in the one style that all axes have.

use anyhow::Result;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use crate::canvas::{Area, GRID, INK, PALE_INK, Point, at, font, line, units};

/// A chart with linear coordinates in both directions.
pub type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Position of the curves on the canvas, in pixels; the labels of the axes are left of it and below.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// Left end of the abscissa.
    pub left: f64,
    /// Right end of the abscissa.
    pub right: f64,
    /// Upper end of the ordinate.
    pub top: f64,
    /// Lower end of the ordinate.
    pub bottom: f64,
    /// Room for the labels on the left.
    pub left_room: f64,
    /// Room for the labels below.
    pub bottom_room: f64,
}

/// One axis: its quantity, its range, and about how many labels it has; 0 for none.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Its quantity, with the unit.
    pub label: String,
    /// Its two ends.
    pub range: Point,
    /// About how many numbers label it.
    pub label_count: usize,
    /// The text of such a number.
    pub text: fn(f64) -> String,
}

/// Draws the axes `x` and `y` around `frame`, and returns their coordinates.
///
/// # Errors
/// Those of the library.
pub fn axes<'b>(area: &Area<'b>, frame: &Frame, x: &Axis, y: &Axis) -> Result<Chart<'b, 'b>> {
    let &Frame { left, right, top, bottom, left_room, bottom_room } = frame;
    let size = (units(right - left + left_room), units(bottom - top + bottom_room));
    let place = area.clone().shrink(at((left - left_room, top)), size);
    let mut chart = ChartBuilder::on(&place)
        .set_label_area_size(LabelAreaPosition::Left, units(left_room))
        .set_label_area_size(LabelAreaPosition::Bottom, units(bottom_room))
        .build_cartesian_2d(x.range.0..x.range.1, y.range.0..y.range.1)?;
    chart
        .configure_mesh()
        .x_desc(x.label.as_str())
        .y_desc(y.label.as_str())
        .x_labels(x.label_count)
        .y_labels(y.label_count)
        .x_label_formatter(&|place| (x.text)(*place))
        .y_label_formatter(&|place| (y.text)(*place))
        .light_line_style(TRANSPARENT)
        .bold_line_style(line(GRID, 1.0))
        .axis_style(line(PALE_INK, 1.0))
        .label_style(font(12.0, PALE_INK, HPos::Center, false))
        .axis_desc_style(font(13.0, INK, HPos::Center, false))
        .draw()?;
    Ok(chart)
}
