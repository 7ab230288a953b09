//! One figure as a picture: a colour for each name of curves, a stroke for each rung.

use anyhow::Result;
use plotters::style::RGBColor;
use tapline_draw::canvas::{self, BLUE, ORANGE, Point, VERMILLION, units};
use tapline_draw::palette::{GREEN, PURPLE};
use tapline_draw::stats::extent;
use tapline_model::Rung;

use super::curves::{self, Axis, Curve, Figure};
use crate::evaluation::{Key, Mark, Picture, Plot, axis};

/// Height of the axes.
const HEIGHT: f64 = 340.0;

/// The colour of the curves called `name`, which come as number `place` in their figure: a factor has its own.
fn color(name: &str, place: usize) -> RGBColor {
    match name {
        "v_i" => BLUE,
        "m_1" => VERMILLION,
        "e_2" => GREEN,
        "m_2" | "h" => PURPLE,
        "e_1" | "l" => ORANGE,
        _ => [BLUE, VERMILLION, GREEN, PURPLE][place % 4],
    }
}

/// How a rung is drawn: width in pixels, dashes in units of the picture, and what the note says of them.
const fn stroke(rung: Rung) -> (f64, &'static str, &'static str) {
    match rung {
        Rung::Closed => (2.25, "", "solid: closed form"),
        Rung::Integral => (1.75, "28 14", "dashed: integral, without a crack"),
        Rung::Plate => (1.5, "7 10", "dotted: plate (in time)"),
        Rung::Full => (1.75, "28 14", "dashed: full, over a crack"),
    }
}

/// The strokes are known by their widths; the integral rung has that of the full one.
pub(super) fn svg(figure: &Figure) -> Result<String> {
    let mut svg = picture(figure).svg()?;
    for (width, dashes, _) in [Rung::Plate, Rung::Full].map(stroke) {
        svg = canvas::dashed(&svg, units(width).unsigned_abs(), dashes);
    }
    Ok(svg)
}

fn picture(figure: &Figure) -> Picture {
    let points = || figure.curves.iter().flat_map(|curve| &curve.points).map(|point| drawn(figure, point));
    let x = extent(points().map(|point| point.0)).unwrap_or((0.0, 1.0));
    let y = (0.0, 1.04 * extent(points().map(|point| point.1)).map_or(1.0, |y| y.1));
    // Whether two curves are apart by more than the width of a line somewhere.
    let width = stroke(Rung::Closed).0 / HEIGHT * y.1 / figure.y.per_si;
    let differ = |a: &Curve, b: &Curve| a.points.iter().zip(&b.points).any(|(a, b)| (a.y - b.y).abs() > width);
    let (mut keys, mut seen): (_, Vec<(&Curve, RGBColor)>) = (Vec::new(), Vec::new());
    for (place, of_name) in figure.curves.chunk_by(|a, b| a.name == b.name).enumerate() {
        let (color, first) = (color(of_name[0].name, place), seen.len());
        keys.push(Key::Line(printed(of_name[0].name).to_owned(), color));
        for curve in of_name {
            if seen[first..].iter().all(|(other, _)| differ(other, curve)) {
                seen.push((curve, color));
            }
        }
    }
    let is_seen = |rung: &Rung| seen.iter().any(|(curve, _)| curve.rung == *rung);
    let mut note: Vec<&str> = Rung::ALL.into_iter().filter(is_seen).map(|rung| stroke(rung).2).collect();
    if seen.iter().any(|(curve, _)| curve.points.iter().any(|point| is_pale(curve, point))) {
        note.push("pale: h/l outside its domain");
    }
    // The closed form comes last, on top.
    let marks = seen.iter().rev().flat_map(|(curve, color)| lines(figure, curve, *color)).collect();
    Picture {
        title: format!("Fig. {}: {}", figure.number, figure.title),
        note: note.join("; "),
        keys,
        columns: 1,
        height: HEIGHT,
        plots: vec![Plot::new(
            String::new(),
            axis(&described(&figure.x), x, 10),
            axis(&described(&figure.y), y, 8),
            marks,
        )],
        ..Picture::default()
    }
}

/// A point in the units of the axes.
fn drawn(figure: &Figure, point: &curves::Point) -> Point {
    (point.x * figure.x.per_si, point.y * figure.y.per_si)
}

fn described(axis: &Axis) -> String {
    if axis.unit.is_empty() { axis.label.to_owned() } else { format!("{} in {}", axis.label, axis.unit) }
}

/// Whether h/l is outside of the domain of a rung that should be better than the closed form.
fn is_pale(curve: &Curve, point: &curves::Point) -> bool {
    !point.in_domain && curve.rung != Rung::Closed
}

/// A curve in parts, some of them pale.
fn lines(figure: &Figure, curve: &Curve, color: RGBColor) -> Vec<Mark> {
    let (mut lines, mut rest) = (Vec::new(), curve.points.as_slice());
    while let Some(first) = rest.first() {
        let count = rest.iter().take_while(|point| is_pale(curve, point) == is_pale(curve, first)).count();
        // One more, where there is one, so that the curve has no gap.
        let points = rest[..rest.len().min(count + 1)].iter().map(|point| drawn(figure, point)).collect();
        let color = if is_pale(curve, first) { pale(color) } else { color };
        lines.push(Mark::Line(points, color, stroke(curve.rung).0));
        rest = &rest[count..];
    }
    lines
}

fn pale(RGBColor(r, g, b): RGBColor) -> RGBColor {
    let [r, g, b] = [r, g, b].map(|part| part.midpoint(255));
    RGBColor(r, g, b)
}

/// The name of a curve with the indices that it has in print.
fn printed(name: &str) -> &str {
    match name {
        "v_i" => "V",
        "m_1" => "m₁",
        "m_2" => "m₂",
        "e_1" => "E₁",
        "e_2" => "E₂",
        _ => name,
    }
}
