//! Figures of plots on axes.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use tapline_draw::axes::{Axis, Chart, Frame, axes};
use tapline_draw::canvas::{self, Area, INK, PALE_INK, Point, at, line, units, write};

const WIDTH: f64 = 900.0;
const EDGE: f64 = 14.0;
/// Where the first plot begins.
const HEAD: f64 = 96.0;
const LEFT_ROOM: f64 = 58.0;
const BOTTOM_ROOM: f64 = 46.0;
const RIGHT_ROOM: f64 = 20.0;
/// Space above a plot, for its name.
const NAME_ROOM: f64 = 26.0;

/// What is drawn on a pair of axes.
#[derive(Debug, Clone)]
pub(crate) enum Mark {
    /// A line through points, of a width in pixels.
    Line(Vec<Point>, RGBColor, f64),
    /// Dots of a radius in pixels.
    Dots(Vec<Point>, RGBColor, f64),
    /// Circles around dots.
    Rings(Vec<Point>, RGBColor, f64),
    /// From the one to the other end.
    Bar(Point, Point, RGBColor),
}

/// A pair of axes with what is on it.
#[derive(Debug, Clone)]
pub(crate) struct Plot {
    pub name: String,
    pub x: Axis,
    pub y: Axis,
    /// Names of the rows, from the top, in place of the labels of the ordinate; then y is the row, from 0.
    pub rows: Vec<String>,
    pub marks: Vec<Mark>,
}

/// One picture.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub name: &'static str,
    /// Name of the table it belongs to.
    pub beside: &'static str,
    pub title: &'static str,
    pub note: String,
    pub keys: Vec<(String, RGBColor)>,
    pub columns: usize,
    /// Height of the axes of a plot.
    pub height: f64,
    pub plots: Vec<Plot>,
}

pub(crate) fn axis(label: &str, range: Point, label_count: usize) -> Axis {
    Axis { label: label.to_owned(), range, label_count }
}

impl Picture {
    /// The picture as SVG.
    pub(crate) fn svg(&self) -> Result<String> {
        let rows = self.plots.len().div_ceil(self.columns);
        let height = HEAD + rows as f64 * self.row_height() + EDGE;
        let svg = canvas::svg((WIDTH as u32, height.ceil() as u32), |area| self.draw(area))?;
        Ok(svg.replace(" opacity=\"1\"", "").replace(" stroke=\"none\"", ""))
    }

    fn row_height(&self) -> f64 {
        NAME_ROOM + self.height + BOTTOM_ROOM
    }

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        write(area, self.title, (EDGE, 22.0), 17.0, INK, HPos::Left, true)?;
        write(area, &self.note, (EDGE, 46.0), 12.0, PALE_INK, HPos::Left, false)?;
        let mut x = EDGE;
        for (name, color) in &self.keys {
            area.draw(&PathElement::new([(x, 72.0), (x + 22.0, 72.0)].map(at).to_vec(), line(*color, 3.0)))?;
            write(area, name, (x + 28.0, 72.0), 12.0, INK, HPos::Left, false)?;
            x += 48.0 + 6.6 * name.chars().count() as f64;
        }
        let width = (WIDTH - 2.0 * EDGE) / self.columns as f64;
        for (number, plot) in self.plots.iter().enumerate() {
            let (row, column) = (number / self.columns, number % self.columns);
            let left_room = LEFT_ROOM + if plot.rows.is_empty() { 0.0 } else { 40.0 };
            let left = EDGE + column as f64 * width;
            let top = HEAD + row as f64 * self.row_height() + NAME_ROOM;
            let frame = Frame {
                left: left + left_room,
                right: left + width - RIGHT_ROOM,
                top,
                bottom: top + self.height,
                left_room,
                bottom_room: BOTTOM_ROOM,
            };
            write(area, &plot.name, (frame.left, top - 13.0), 13.0, INK, HPos::Left, true)?;
            plot.draw(area, &frame)?;
        }
        Ok(())
    }
}

impl Plot {
    fn draw(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        let row_count = self.rows.len() as f64;
        let by_rows = axis("", (row_count, 0.0), 0);
        let y = if self.rows.is_empty() { &self.y } else { &by_rows };
        let mut chart = axes(area, frame, &self.x, y)?;
        for mark in &self.marks {
            mark.draw(&mut chart)?;
        }
        for (row, name) in self.rows.iter().enumerate() {
            let height = frame.top + (row as f64 + 0.5) / row_count * (frame.bottom - frame.top);
            write(area, name, (frame.left - 8.0, height), 12.0, INK, HPos::Right, false)?;
        }
        Ok(())
    }
}

impl Mark {
    fn draw(&self, chart: &mut Chart<'_, '_>) -> Result<()> {
        let is_number = |p: &&Point| p.0.is_finite() && p.1.is_finite();
        match self {
            Self::Line(points, color, width) => {
                let points: Vec<Point> = points.iter().filter(is_number).copied().collect();
                chart.draw_series([PathElement::new(points, line(*color, *width))])?;
            }
            Self::Dots(points, color, radius) => {
                let dot = |&p: &Point| Circle::new(p, units(*radius), color.filled());
                chart.draw_series(points.iter().filter(is_number).map(dot))?;
            }
            Self::Rings(points, color, radius) => {
                let ring = |&p: &Point| Circle::new(p, units(*radius), line(*color, 2.0));
                chart.draw_series(points.iter().filter(is_number).map(ring))?;
            }
            Self::Bar(from, to, color) => {
                chart.draw_series([PathElement::new(vec![*from, *to], line(*color, 2.0))])?;
            }
        }
        Ok(())
    }
}
