//! A picture of half the width, with named columns instead of an x axis; two fit side by side on a telephone.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{self, GRID, INK, PALE_INK, font, line, units, write};

use crate::report::figures::axis::{Axis, Ticked};
use crate::report::figures::chart::Chart;
use crate::report::figures::inline;

const SIZE: (u32, u32) = (180, 210);

/// Columns side by side, on one scale.
pub(crate) struct Small {
    pub title: String,
    /// Name and unit of the values.
    pub label: String,
    /// Names of the columns; column k is centred at x = k + 0.5.
    pub columns: Vec<String>,
    pub y: Axis,
}

impl Small {
    /// The picture as an element of a page; `draw` draws within the axes.
    pub(crate) fn svg(&self, draw: impl FnOnce(&mut Chart<'_, '_>) -> Result<()>) -> Result<String> {
        let count = self.columns.len() as f64;
        let unnumbered = Axis { label: String::new(), range: (0.0, count), ticks: Vec::new() };
        let svg = canvas::svg(SIZE, |area| {
            write(area, &self.title, (6.0, 10.0), 12.0, INK, HPos::Left, true)?;
            let mut chart = ChartBuilder::on(area)
                .margin_top(units(24.0))
                .margin_right(units(6.0))
                .margin_bottom(units(20.0))
                .set_label_area_size(LabelAreaPosition::Left, units(50.0))
                .build_cartesian_2d(Ticked::new(&unnumbered), Ticked::new(&self.y))?;
            chart
                .configure_mesh()
                .y_desc(&self.label)
                .light_line_style(TRANSPARENT)
                .bold_line_style(line(GRID, 1.0))
                .axis_style(line(PALE_INK, 1.0))
                .label_style(font(10.5, PALE_INK, HPos::Center, false))
                .axis_desc_style(font(11.0, INK, HPos::Center, false))
                .draw()?;
            let width = (f64::from(SIZE.0) - 56.0) / count;
            for (order, words) in (0..).zip(&self.columns) {
                let x = 50.0 + width * (f64::from(order) + 0.5);
                write(area, words, (x, f64::from(SIZE.1) - 9.0), 10.5, INK, HPos::Center, false)?;
            }
            draw(&mut chart)
        })?;
        Ok(inline::svg(&svg, &self.title))
    }
}
