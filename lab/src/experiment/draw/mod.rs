//! The pictures of the experiment: a title, what the colours mean, and plots in rows.

mod boxes;
mod curves;
mod map;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

pub(super) use boxes::{Bar, Category};
pub(super) use curves::Curve;
pub(super) use map::{Map, level_colors};

use tapline_draw::canvas::{self, Area, INK, PALE_INK, Point, at, line, units, write};

use tapline_draw::axes::{Axis, Frame};

/// One more of Okabe and Ito's colours.
const SKY: RGBColor = RGBColor(86, 180, 233);

const WIDTH: f64 = 900.0;
/// Where the first row of plots begins.
const HEAD: f64 = 92.0;
const EDGE: f64 = 14.0;
/// Room for the labels of a plot.
const LEFT_ROOM: f64 = 58.0;
const BOTTOM_ROOM: f64 = 42.0;
/// Space right of a plot.
const RIGHT_ROOM: f64 = 18.0;

/// What a colour means.
#[derive(Debug, Clone)]
pub(super) enum Key {
    Line(String, RGBColor),
    /// The shades under cracked places, by severity.
    Severity,
    /// Steps of a map, and the words at both ends.
    Scale(String, String),
}

/// What is in a plot.
#[derive(Debug, Clone)]
pub(super) enum Content {
    /// Curves, over shades where a crack is planted.
    Curves {
        curves: Vec<Curve>,
        shades: Vec<Shade>,
    },
    /// Boxes of groups; their means joined if asked for.
    Boxes {
        categories: Vec<Category>,
        joins_means: bool,
    },
    /// Bars from zero.
    Bars(Vec<Bar>),
    Map(Map),
}

/// A stretch of the abscissa over a planted crack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shade {
    pub from: f64,
    pub to: f64,
    pub severity: u8,
}

/// One pair of axes.
#[derive(Debug, Clone)]
pub(super) struct Plot {
    pub name: String,
    pub x_label: &'static str,
    /// Range of the abscissa; groups and bars have their own.
    pub x: Point,
    pub y_label: &'static str,
    /// Range of the ordinate; that of the content when left out.
    pub y: Option<Point>,
    pub content: Content,
}

/// One picture.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub title: String,
    pub note: String,
    pub keys: Vec<Key>,
    /// Panels in a row.
    pub columns: usize,
    /// Height of the axes of one.
    pub height: f64,
    pub plots: Vec<Plot>,
}

impl Picture {
    /// The picture as SVG.
    pub(super) fn svg(&self) -> Result<String> {
        let rows = self.plots.len().div_ceil(self.columns);
        let height = HEAD + rows as f64 * self.row_height() + EDGE;
        let svg = canvas::svg((WIDTH as u32, height.ceil() as u32), |area| self.draw(area))?;
        // Otherwise lines of half-covered pixels would separate neighbours in a map.
        let has_map = self.plots.iter().any(|plot| matches!(plot.content, Content::Map(_)));
        let svg = if has_map { svg.replacen("<svg ", "<svg shape-rendering=\"crispEdges\" ", 1) } else { svg };
        // The library writes out these default values.
        Ok(svg.replace(" opacity=\"1\"", "").replace(" stroke=\"none\"", ""))
    }

    /// Space above a plot: for its name, if one of them has a name.
    fn top_room(&self) -> f64 {
        if self.plots.iter().all(|plot| plot.name.is_empty()) { 4.0 } else { 24.0 }
    }

    fn row_height(&self) -> f64 {
        self.top_room() + self.height + BOTTOM_ROOM
    }

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        write(area, &self.title, (EDGE, 22.0), 17.0, INK, HPos::Left, true)?;
        write(area, &self.note, (EDGE, 45.0), 12.0, PALE_INK, HPos::Left, false)?;
        self.write_keys(area)?;
        let width = (WIDTH - 2.0 * EDGE) / self.columns as f64;
        for (number, plot) in self.plots.iter().enumerate() {
            let (row, column) = (number / self.columns, number % self.columns);
            let left = EDGE + column as f64 * width;
            let top = HEAD + row as f64 * self.row_height() + self.top_room();
            let frame = Frame {
                left: left + LEFT_ROOM,
                right: left + width - RIGHT_ROOM,
                top,
                bottom: top + self.height,
                left_room: LEFT_ROOM,
                bottom_room: BOTTOM_ROOM,
            };
            write(area, &plot.name, (frame.left, top - 12.0), 13.0, INK, HPos::Left, true)?;
            plot.draw(area, &frame)?;
        }
        Ok(())
    }

    fn write_keys(&self, area: &Area<'_>) -> Result<()> {
        const Y: f64 = 70.0;
        let mut x = EDGE;
        let words = |text: &str, x: f64| write(area, text, (x, Y), 12.0, INK, HPos::Left, false);
        let width_of = |text: &str| 6.6 * text.chars().count() as f64;
        let patch = |x: f64, width: f64, color: RGBAColor| -> Result<()> {
            Ok(area.draw(&Rectangle::new([at((x, Y - 6.0)), at((x + width, Y + 6.0))], color.filled()))?)
        };
        for key in &self.keys {
            match key {
                Key::Line(name, color) => {
                    area.draw(&PathElement::new([(x, Y), (x + 24.0, Y)].map(at).to_vec(), line(*color, 2.5)))?;
                    words(name, x + 30.0)?;
                    x += 48.0 + width_of(name);
                }
                Key::Severity => {
                    for severity in 1..=3 {
                        patch(x, 24.0, shade(severity))?;
                        x += 24.0;
                    }
                    let text = "planted crack, severity 1, 2, 3";
                    words(text, x + 6.0)?;
                    x += 24.0 + width_of(text);
                }
                Key::Scale(low, high) => {
                    words(low, x)?;
                    x += width_of(low) + 6.0;
                    for color in level_colors() {
                        patch(x, 20.0, color.to_rgba())?;
                        x += 20.0;
                    }
                    words(high, x + 6.0)?;
                    x += 24.0 + width_of(high);
                }
            }
        }
        Ok(())
    }
}

/// The shade under a crack.
fn shade(severity: u8) -> RGBAColor {
    SKY.mix(0.16 * f64::from(severity))
}

impl Plot {
    fn draw(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        let y = self.y.unwrap_or_else(|| self.content.range());
        let axis = |label: &str, range, label_count| Axis { label: label.to_owned(), range, label_count };
        let y = axis(self.y_label, y, if frame.bottom - frame.top < 160.0 { 5 } else { 7 });
        let wide = frame.right - frame.left > 500.0;
        match &self.content {
            Content::Curves { curves, shades } => {
                let x = axis(self.x_label, self.x, if wide { 14 } else { 8 });
                curves::draw(area, frame, (&x, &y), curves, shades)
            }
            Content::Map(map) => map.draw(area, frame, (&axis(self.x_label, self.x, 14), &y)),
            Content::Boxes { categories, joins_means } => {
                boxes::draw(area, frame, (self.x_label, &y), categories, *joins_means)
            }
            Content::Bars(bars) => boxes::draw_bars(area, frame, (self.x_label, &y), bars),
        }
    }
}

impl Content {
    /// From the least to the greatest value, with a margin; bars begin at zero.
    fn range(&self) -> Point {
        let mut values: Vec<f64> = match self {
            Self::Curves { curves, .. } => curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)).collect(),
            Self::Boxes { categories, .. } => categories.iter().flat_map(Category::extremes).collect(),
            Self::Bars(bars) => bars.iter().map(|bar| bar.value).chain([0.0]).collect(),
            Self::Map(map) => vec![map.y.0, map.y.1],
        };
        values.sort_by(f64::total_cmp);
        let (low, high) = (values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(1.0));
        match self {
            Self::Map(_) => (low, high),
            Self::Bars(_) => (0.0, high * 1.12),
            _ if high > low => (low - 0.06 * (high - low), high + 0.06 * (high - low)),
            _ => (low - 0.5, high + 0.5),
        }
    }
}

/// A dot of `radius` pixels.
fn dot<C>(place: C, radius: f64, color: RGBColor) -> Circle<C, i32> {
    Circle::new(place, units(radius), color.filled())
}
