//! Figures of plots on axes.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use tapline_draw::axes::{Axis, Chart, Frame, axes};
use tapline_draw::boxplot::BoxStats;
use tapline_draw::canvas::{self, Area, INK, PALE_INK, Point, at, line, number, units, write};
use tapline_draw::palette::COLORS;

const WIDTH: f64 = 900.0;
const EDGE: f64 = 14.0;
/// From the last row of keys to the first plot.
const KEY_ROOM: f64 = 24.0;
const LEFT_ROOM: f64 = 58.0;
const BOTTOM_ROOM: f64 = 46.0;
const RIGHT_ROOM: f64 = 20.0;
/// Space above a plot, for its name.
const NAME_ROOM: f64 = 26.0;
/// Height of the first row of keys, and from one row to the next.
const KEYS: (f64, f64) = (72.0, 20.0);
/// Half the width of a box, where columns are 1 apart.
pub(crate) const HALF_BOX: f64 = 0.28;

/// What is drawn on a pair of axes.
#[derive(Debug, Clone)]
pub(crate) enum Mark {
    /// A line through points, of a width in pixels; a point that is not finite interrupts it.
    Line(Vec<Point>, RGBColor, f64),
    /// Dots of a radius in pixels.
    Dots(Vec<Point>, RGBColor, f64),
    /// Circles around dots.
    Rings(Vec<Point>, RGBColor, f64),
    /// A rectangle between two corners.
    Filled([Point; 2], RGBAColor),
    /// Rectangles that touch each other.
    Cells(Vec<([Point; 2], RGBColor)>),
    /// A boxplot around an abscissa.
    Box(f64, BoxStats, RGBColor),
}

/// What a colour means.
#[derive(Debug, Clone)]
pub(crate) enum Key {
    /// That of a line.
    Line(String, RGBColor),
    /// That of a line with rings.
    Rings(String, RGBColor),
    /// Those of patches side by side, with words before and after.
    Patches(String, Vec<RGBAColor>, String),
}

/// A pair of axes with what is on it.
#[derive(Debug, Clone)]
pub(crate) struct Plot {
    pub name: String,
    pub x: Axis,
    pub y: Axis,
    /// Names of the rows, from the top, in place of the labels of the ordinate; then y is the row, from 0.
    pub rows: Vec<String>,
    /// The same of columns, below the abscissa.
    pub columns: Vec<String>,
    pub marks: Vec<Mark>,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Picture {
    /// Name of its file.
    pub name: &'static str,
    /// Name of the table it belongs to.
    pub beside: &'static str,
    pub title: String,
    pub note: String,
    pub keys: Vec<Key>,
    pub columns: usize,
    /// Height of the axes of a plot.
    pub height: f64,
    pub plots: Vec<Plot>,
}

pub(crate) fn axis(label: &str, range: Point, label_count: usize) -> Axis {
    Axis { label: label.to_owned(), range, label_count, text: number }
}

/// Keys of lines in the palette's colours.
pub(crate) fn keys(names: &[&str]) -> Vec<Key> {
    names.iter().zip(COLORS).map(|(&name, color)| Key::Line(name.to_owned(), color)).collect()
}

impl Picture {
    pub(crate) fn svg(&self) -> Result<String> {
        let rows = self.plots.len().div_ceil(self.columns);
        let height = self.head() + rows as f64 * self.row_height() + EDGE;
        let svg = canvas::svg((WIDTH as u32, height.ceil() as u32), |area| self.draw(area))?;
        // Otherwise lines of half-covered pixels would separate the cells.
        let has_cells = self.plots.iter().flat_map(|plot| &plot.marks).any(|mark| matches!(mark, Mark::Cells(_)));
        let svg = if has_cells { svg.replacen("<svg ", "<svg shape-rendering=\"crispEdges\" ", 1) } else { svg };
        Ok(canvas::slim(&svg))
    }

    /// Where each key is: one that finds no room in its row begins another.
    fn key_places(&self) -> Vec<Point> {
        let (mut x, mut y) = (EDGE, KEYS.0);
        let place = |key: &Key| {
            if x + key.width() > WIDTH {
                (x, y) = (EDGE, y + KEYS.1);
            }
            x += key.width();
            (x - key.width(), y)
        };
        self.keys.iter().map(place).collect()
    }

    /// Where the first plot begins.
    fn head(&self) -> f64 {
        self.key_places().last().map_or(KEYS.0, |place| place.1) + KEY_ROOM
    }

    /// Space above a plot, less if none has a name.
    fn name_room(&self) -> f64 {
        if self.plots.iter().all(|plot| plot.name.is_empty()) { 4.0 } else { NAME_ROOM }
    }

    fn row_height(&self) -> f64 {
        self.name_room() + self.height + BOTTOM_ROOM
    }

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        write(area, &self.title, (EDGE, 22.0), 17.0, INK, HPos::Left, true)?;
        write(area, &self.note, (EDGE, 46.0), 12.0, PALE_INK, HPos::Left, false)?;
        for (key, place) in self.keys.iter().zip(self.key_places()) {
            key.draw(area, place)?;
        }
        let width = (WIDTH - 2.0 * EDGE) / self.columns as f64;
        for (number, plot) in self.plots.iter().enumerate() {
            let (row, column) = (number / self.columns, number % self.columns);
            let left_room = LEFT_ROOM + if plot.rows.is_empty() { 0.0 } else { 40.0 };
            let left = EDGE + column as f64 * width;
            let top = self.head() + row as f64 * self.row_height() + self.name_room();
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

impl Key {
    /// From its left end to the next key.
    fn width(&self) -> f64 {
        match self {
            Self::Line(name, _) | Self::Rings(name, _) => 48.0 + width_of(name),
            Self::Patches(before, colors, after) => {
                30.0 + 22.0 * colors.len() as f64 + width_of(before) + width_of(after)
            }
        }
    }

    fn draw(&self, area: &Area<'_>, (mut x, y): Point) -> Result<()> {
        let words = |text: &str, x: f64| write(area, text, (x, y), 12.0, INK, HPos::Left, false);
        match self {
            Self::Line(name, color) | Self::Rings(name, color) => {
                area.draw(&PathElement::new([(x, y), (x + 22.0, y)].map(at).to_vec(), line(*color, 3.0)))?;
                if matches!(self, Self::Rings(..)) {
                    area.draw(&Circle::new(at((x + 11.0, y)), units(5.0), line(*color, 2.0)))?;
                }
                words(name, x + 28.0)
            }
            Self::Patches(before, colors, after) => {
                words(before, x)?;
                x += width_of(before) + 6.0;
                for color in colors {
                    let corners = [(x, y - 6.0), (x + 22.0, y + 6.0)].map(at);
                    area.draw(&Rectangle::new(corners, color.filled()))?;
                    x += 22.0;
                }
                words(after, x + 6.0)
            }
        }
    }
}

/// About how wide the words of a key are.
fn width_of(text: &str) -> f64 {
    6.6 * text.chars().count() as f64
}

impl Plot {
    pub(crate) fn new(name: String, x: Axis, y: Axis, marks: Vec<Mark>) -> Self {
        Self { name, x, y, rows: Vec::new(), columns: Vec::new(), marks }
    }

    fn draw(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        let (row_count, column_count) = (self.rows.len() as f64, self.columns.len() as f64);
        let by_rows = axis("", (row_count, 0.0), 0);
        let by_columns = axis(&self.x.label, (0.0, column_count), 0);
        let x = if self.columns.is_empty() { &self.x } else { &by_columns };
        let y = if self.rows.is_empty() { &self.y } else { &by_rows };
        let mut chart = axes(area, frame, x, y)?;
        for mark in &self.marks {
            mark.draw(&mut chart)?;
        }
        for (row, name) in self.rows.iter().enumerate() {
            let height = frame.top + (row as f64 + 0.5) / row_count * (frame.bottom - frame.top);
            write(area, name, (frame.left - 8.0, height), 12.0, INK, HPos::Right, false)?;
        }
        for (column, name) in self.columns.iter().enumerate() {
            let middle = frame.left + (column as f64 + 0.5) / column_count * (frame.right - frame.left);
            write(area, name, (middle, frame.bottom + 12.0), 12.0, PALE_INK, HPos::Center, false)?;
        }
        Ok(())
    }
}

impl Mark {
    fn draw(&self, chart: &mut Chart<'_, '_>) -> Result<()> {
        let is_number = |p: &Point| p.0.is_finite() && p.1.is_finite();
        match self {
            Self::Line(points, color, width) => {
                for run in points.split(|p| !is_number(p)).filter(|run| !run.is_empty()) {
                    chart.draw_series([PathElement::new(run.to_vec(), line(*color, *width))])?;
                }
            }
            Self::Dots(points, color, radius) => {
                let dot = |&p: &Point| Circle::new(p, units(*radius), color.filled());
                chart.draw_series(points.iter().filter(|p| is_number(p)).map(dot))?;
            }
            Self::Rings(points, color, radius) => {
                let ring = |&p: &Point| Circle::new(p, units(*radius), line(*color, 2.0));
                chart.draw_series(points.iter().filter(|p| is_number(p)).map(ring))?;
            }
            Self::Filled(corners, color) => {
                chart.draw_series([Rectangle::new(*corners, color.filled())])?;
            }
            Self::Cells(cells) => {
                chart.draw_series(cells.iter().map(|(corners, color)| Rectangle::new(*corners, color.filled())))?;
            }
            Self::Box(x, stats, color) => stats.draw(chart, (*x, HALF_BOX), *color)?,
        }
        Ok(())
    }
}
