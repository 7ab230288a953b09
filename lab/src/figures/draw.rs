//! One figure in one picture, in the single style of all figures.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_model::Rung;

use super::curves::{Axis, Curve, Figure};

use super::labels::{printed, spread};
use tapline_draw::axes::{self, Chart, Frame, axes};
use tapline_draw::canvas::{
    self, Area, BLUE, INK, ORANGE, PALE_INK, Point, VERMILLION, at, line, number, units, write,
};
use tapline_draw::palette::{GREEN, PURPLE};
use tapline_draw::stats::extent;

const SIZE: (u32, u32) = (760, 440);
/// Where the axes begin and end.
const LEFT: f64 = 72.0;
const RIGHT: f64 = 644.0;
const TOP: f64 = 78.0;
const BOTTOM: f64 = 390.0;
/// Where writing begins.
const EDGE: f64 = 14.0;
/// Height of a name beside its curve.
const NAME: f64 = 15.0;

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

/// How a rung is drawn: width in pixels, and dashes in units of the picture.
struct Stroke {
    width: f64,
    dashes: Option<&'static str>,
}

/// The library would write every dash as an element, at ten times the size: dashes are added to the lines afterwards, which
/// are known by their widths.
const fn stroke(rung: Rung) -> Stroke {
    match rung {
        Rung::Closed => Stroke { width: 2.25, dashes: None },
        Rung::Plate => Stroke { width: 1.5, dashes: Some("7 10") },
        Rung::Integral | Rung::Full => Stroke { width: 1.75, dashes: Some("28 14") },
    }
}

pub(super) fn svg(figure: &Figure) -> Result<String> {
    let picture = Picture::new(figure);
    let mut svg = canvas::svg(SIZE, |area| picture.draw(area))?;
    // The integral rung has the stroke of the full one.
    for rung in [Rung::Plate, Rung::Full] {
        let Stroke { width, dashes } = stroke(rung);
        if let Some(dashes) = dashes {
            let width = format!("stroke-width=\"{}\"", units(width));
            svg = svg.replace(&width, &format!("{width} stroke-dasharray=\"{dashes}\""));
        }
    }
    Ok(svg)
}

struct Picture<'a> {
    figure: &'a Figure,
    /// Curves that visibly differ from those before them, with their colours.
    curves: Vec<(&'a Curve, RGBColor)>,
    x: Point,
    y: Point,
}

impl<'a> Picture<'a> {
    fn new(figure: &'a Figure) -> Self {
        let (x, y) = (range(figure, |p| p.x * figure.x.per_si), range(figure, |p| p.y * figure.y.per_si));
        let mut picture = Self { figure, curves: Vec::new(), x, y: (0.0, y.1 * 1.04) };
        let mut names: Vec<&str> = Vec::new();
        for curve in &figure.curves {
            if names.last() != Some(&curve.name) {
                names.push(curve.name);
            }
            let color = color(curve.name, names.len() - 1);
            let like_it = |drawn: &&Curve| drawn.name == curve.name;
            let is_seen =
                picture.curves.iter().map(|(drawn, _)| *drawn).filter(like_it).all(|c| picture.differ(c, curve));
            if is_seen {
                picture.curves.push((curve, color));
            }
        }
        picture
    }

    /// Height of `y` on the picture, in pixels.
    fn height(&self, y: f64) -> f64 {
        BOTTOM - (y * self.figure.y.per_si - self.y.0) / (self.y.1 - self.y.0) * (BOTTOM - TOP)
    }

    /// Whether two curves are apart by more than the width of a line somewhere.
    fn differ(&self, a: &Curve, b: &Curve) -> bool {
        let width = stroke(Rung::Closed).width;
        a.points.iter().zip(&b.points).any(|(a, b)| (self.height(a.y) - self.height(b.y)).abs() > width)
    }

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        let title = format!("Fig. {}: {}", self.figure.number, self.figure.title);
        write(area, &title, (EDGE, 22.0), 17.0, INK, HPos::Left, true)?;
        self.legend(area)?;
        let mut chart = self.axes(area)?;
        // The closed form comes last, on top.
        for (curve, color) in self.curves.iter().rev() {
            trace(&mut chart, self.figure, curve, *color)?;
        }
        self.names(area)
    }

    fn axes<'b>(&self, area: &Area<'b>) -> Result<Chart<'b, 'b>> {
        let frame =
            Frame { left: LEFT, right: RIGHT, top: TOP, bottom: BOTTOM, left_room: LEFT - EDGE, bottom_room: 46.0 };
        let axis =
            |axis: &Axis, range, label_count| axes::Axis { label: described(axis), range, label_count, text: number };
        axes(area, &frame, &axis(&self.figure.x, self.x, 10), &axis(&self.figure.y, self.y, 8))
    }

    /// What the strokes mean.
    fn legend(&self, area: &Area<'_>) -> Result<()> {
        let mut x = EDGE;
        for rung in Rung::ALL.into_iter().filter(|&rung| self.curves.iter().any(|(c, _)| c.rung == rung)) {
            let ends = [(x, 47.0), (x + 34.0, 47.0)];
            area.draw(&PathElement::new(ends.map(at).to_vec(), line(INK, stroke(rung).width)))?;
            let words = meaning(rung);
            write(area, words, (x + 40.0, 47.0), 12.0, PALE_INK, HPos::Left, false)?;
            x += 60.0 + 6.3 * words.chars().count() as f64;
        }
        if self.curves.iter().any(|(c, _)| c.rung != Rung::Closed && c.points.iter().any(|p| !p.in_domain)) {
            let words = "pale: h/l is outside the rung's domain";
            write(area, words, (RIGHT, 66.0), 11.0, PALE_INK, HPos::Right, false)?;
        }
        Ok(())
    }

    /// Names of the curves at the right end of their closed form.
    fn names(&self, area: &Area<'_>) -> Result<()> {
        let closed: Vec<_> = self.curves.iter().filter(|(c, _)| c.rung == Rung::Closed).collect();
        let ends: Vec<f64> = closed.iter().map(|(c, _)| c.points.last().map_or(TOP, |p| self.height(p.y))).collect();
        for ((curve, color), y) in closed.into_iter().zip(spread(&ends, NAME, (TOP, BOTTOM))) {
            write(area, printed(curve.name), (RIGHT + 8.0, y), 13.0, *color, HPos::Left, true)?;
        }
        Ok(())
    }
}

fn meaning(rung: Rung) -> &'static str {
    match rung {
        Rung::Closed => "closed form",
        Rung::Integral => "integral (damped contact)",
        Rung::Plate => "plate (in time)",
        Rung::Full => "full (shear, membrane)",
    }
}

fn described(axis: &Axis) -> String {
    if axis.unit.is_empty() { axis.label.to_owned() } else { format!("{} in {}", axis.label, axis.unit) }
}

fn range(figure: &Figure, value: impl Fn(&super::curves::Point) -> f64) -> Point {
    extent(figure.curves.iter().flat_map(|c| c.points.iter().map(&value))).unwrap_or((0.0, 1.0))
}

/// Draws `curve`, paler where h/l is outside the domain of a rung that should be better.
fn trace(chart: &mut Chart<'_, '_>, figure: &Figure, curve: &Curve, color: RGBColor) -> Result<()> {
    let width = units(stroke(curve.rung).width).unsigned_abs();
    let mut rest = curve.points.as_slice();
    while let Some(first) = rest.first() {
        let count = rest.iter().take_while(|p| p.in_domain == first.in_domain).count();
        // One more, where there is one, so that the curve has no gap.
        let points = rest[..rest.len().min(count + 1)].iter();
        let points: Vec<Point> = points.map(|p| (p.x * figure.x.per_si, p.y * figure.y.per_si)).collect();
        let shade = if first.in_domain || curve.rung == Rung::Closed { 1.0 } else { 0.5 };
        chart.draw_series([PathElement::new(points, color.mix(shade).stroke_width(width))])?;
        rest = &rest[count..];
    }
    Ok(())
}
