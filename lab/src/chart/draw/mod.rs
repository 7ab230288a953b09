//! A facet as a picture: points with their intervals and names, and the front.

mod layout;
mod names;
mod scales;
mod theme;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{self, Area, GRID, INK, PALE_INK, Point as Place, at, line, units, write};
use tapline_draw::palette::COLORS;

pub(crate) use self::theme::{DARK_STYLE, themed};

use self::layout::{LINE_PX, TEXT_PX, layout, width_of};
use self::names::{Line, Named, Rect, place};
use self::scales::{scale_of_costs, scale_of_errors};
use super::panel::{Facet, Panel};
use super::point::Point;

/// Size of a facet on a wide screen and in print.
pub(crate) const WIDE: Place = (560.0, 460.0);
/// Size of a facet on a phone.
pub(crate) const NARROW: Place = (358.0, 430.0);
/// Size of a facet if two are side by side on a page of a repository.
const HALF: Place = (440.0, 440.0);

/// Height of the room below the axes, for ticks and the cost.
const BELOW: f64 = 44.0;
/// Width of the room left of them, for ticks.
const LEFT: f64 = 50.0;
const RIGHT: f64 = 14.0;
/// Radius of a point.
const RADIUS: f64 = 4.5;
/// Distance of a default's ring from its point.
const RING: f64 = 4.5;

/// The picture of one facet.
pub(crate) fn facet(facet: &Facet, size: Place) -> Result<String> {
    picture(std::slice::from_ref(facet), 1, size)
}

/// All facets of a panel in one picture, in one or two columns.
pub(crate) fn sheet(panel: &Panel, is_narrow: bool) -> Result<String> {
    let (columns, size) = if is_narrow || panel.facets.len() == 1 { (1, NARROW) } else { (2, HALF) };
    Ok(themed(&picture(&panel.facets, columns, size)?))
}

/// `facets` in `columns`, each of `size`.
fn picture(facets: &[Facet], columns: usize, size: Place) -> Result<String> {
    let rows = facets.len().div_ceil(columns);
    let svg = canvas::svg(((columns as f64 * size.0) as u32, (rows as f64 * size.1) as u32), |area| {
        for (number, facet) in facets.iter().enumerate() {
            let corner = ((number % columns) as f64 * size.0, (number / columns) as f64 * size.1);
            Drawing::new(facet, corner, size).draw(area)?;
        }
        Ok(())
    })?;
    Ok(outlined(&canvas::slim(&svg)))
}

/// Outlines every letter in white, so that lines do not cross it.
fn outlined(svg: &str) -> String {
    let halo = format!(
        "<text paint-order=\"stroke\" stroke=\"#FFFFFF\" stroke-width=\"{}\" stroke-linejoin=\"round\" ",
        units(3.0)
    );
    svg.replace("<text ", &halo)
}

/// A facet that is being drawn.
struct Drawing<'a> {
    facet: &'a Facet,
    corner: Place,
    size: Place,
    front: Vec<bool>,
}

/// The axes on the area: corners in pixels, and scales.
struct Frame {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: tapline_draw::scale::Scale,
    y: tapline_draw::scale::Scale,
}

impl Frame {
    fn x(&self, value: f64) -> f64 {
        self.left + self.x.part(value) * (self.right - self.left)
    }

    fn y(&self, value: f64) -> f64 {
        self.bottom - self.y.part(value) * (self.bottom - self.top)
    }

    fn of(&self, point: &Point) -> Place {
        (self.x(point.cost.median), self.y(point.error.value))
    }
}

impl<'a> Drawing<'a> {
    fn new(facet: &'a Facet, corner: Place, size: Place) -> Self {
        Self { facet, corner, size, front: facet.front() }
    }

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        let (left, top) = self.corner;
        let y = layout(self.facet, self.size.0).draw(area, (left, top + 8.0))?;
        let frame = Frame {
            left: left + LEFT,
            right: left + self.size.0 - RIGHT,
            top: y + 6.0,
            bottom: top + self.size.1 - BELOW,
            x: scale_of_costs(self.facet),
            y: scale_of_errors(self.facet),
        };
        self.guides(area, &frame)?;
        self.axes(area, &frame)?;
        self.front_lines(area, &frame)?;
        for point in &self.facet.points {
            intervals(area, &frame, point)?;
        }
        for point in &self.facet.points {
            mark(area, point, frame.of(point))?;
        }
        self.names(area, &frame)
    }

    /// Bands of published or required values.
    fn guides(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        for guide in &self.facet.guides {
            let [from, to] = [guide.cost.0, guide.cost.1].map(|cost| frame.x(cost));
            area.draw(&Rectangle::new([(from, frame.top), (to, frame.bottom)].map(at), GRID.filled()))?;
        }
        Ok(())
    }

    fn axes(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        let lines = |from: Place, to: Place| PathElement::new([from, to].map(at).to_vec(), line(GRID, 1.0));
        let across = ((frame.right - frame.left) / 70.0) as usize;
        let mut last = f64::NEG_INFINITY;
        for tick in frame.x.ticks(across) {
            let x = frame.x(tick.value);
            area.draw(&lines((x, frame.top), (x, frame.bottom)))?;
            let half = 0.5 * width_of(&tick.label, TEXT_PX, false);
            if !tick.label.is_empty() && x - half > last + 6.0 {
                write(area, &tick.label, (x, frame.bottom + 13.0), TEXT_PX, PALE_INK, HPos::Center, false)?;
                last = x + half;
            }
        }
        for tick in frame.y.ticks(((frame.bottom - frame.top) / 46.0) as usize) {
            let y = frame.y(tick.value);
            area.draw(&lines((frame.left, y), (frame.right, y)))?;
            write(area, &tick.label, (frame.left - 6.0, y), TEXT_PX, PALE_INK, HPos::Right, false)?;
        }
        let corners = [(frame.left, frame.top), (frame.left, frame.bottom), (frame.right, frame.bottom)];
        area.draw(&PathElement::new(corners.map(at).to_vec(), line(PALE_INK, 1.0)))?;
        let cost = format!("{} \u{2192}", self.facet.cost.words());
        write(area, &cost, (frame.right, frame.bottom + 31.0), TEXT_PX, INK, HPos::Right, false)
    }

    /// For each group a staircase below which no point lies; with several groups, also lines that join a family.
    fn front_lines(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        let mut groups: Vec<usize> = self.facet.points.iter().map(|point| point.group).collect();
        groups.sort_unstable();
        groups.dedup();
        if let [group] = groups.as_slice() {
            let stairs = self.stairs(frame, *group);
            area.draw(&PathElement::new(stairs.into_iter().map(at).collect::<Vec<_>>(), line(INK, 1.5)))?;
            return Ok(());
        }
        for family in 0..self.facet.families.len() {
            let of_family = self.facet.points.iter().filter(|point| point.family == family);
            let joined: Vec<_> = of_family.map(|point| at(frame.of(point))).collect();
            area.draw(&PathElement::new(joined, line(color(family), 1.5)))?;
        }
        Ok(())
    }

    fn stairs(&self, frame: &Frame, group: usize) -> Vec<Place> {
        let on_front = self.facet.points.iter().zip(&self.front).filter(|(point, on)| **on && point.group == group);
        let mut corners: Vec<Place> = on_front.map(|(point, _)| frame.of(point)).collect();
        corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut stairs = Vec::new();
        for corner in corners {
            if let Some(&(_, y)) = stairs.last() {
                stairs.push((corner.0, y));
            } else {
                stairs.push((corner.0, frame.top));
            }
            stairs.push(corner);
        }
        if let Some(&(_, y)) = stairs.last() {
            stairs.push((frame.right, y));
        }
        stairs
    }

    /// The lines that names should not cover.
    fn lines(&self, frame: &Frame) -> Vec<Line> {
        let stairs = self.stairs(frame, self.facet.points.first().map_or(0, |point| point.group));
        let mut lines: Vec<Line> =
            stairs.windows(2).map(|ends| Line { ends: (ends[0], ends[1]), cost: 14.0 }).collect();
        for point in &self.facet.points {
            let x = frame.x(point.cost.median);
            lines.push(Line { ends: ((x, frame.y(point.error.low)), (x, frame.y(point.error.high))), cost: 5.0 });
        }
        lines
    }

    fn names(&self, area: &Area<'_>, frame: &Frame) -> Result<()> {
        let mut named: Vec<Named> = self
            .facet
            .points
            .iter()
            .zip(&self.front)
            .map(|(point, is_on)| Named {
                text: if point.is_default { format!("{} (default)", point.label) } else { point.label.clone() },
                is_bold: point.is_default,
                place: frame.of(point),
                radius: if point.is_default { RADIUS + RING } else { RADIUS },
                rank: (!point.is_default, !is_on),
            })
            .collect();
        for guide in &self.facet.guides {
            let x = frame.x(guide.cost.0.midpoint(guide.cost.1));
            named.push(Named {
                text: guide.label.to_owned(),
                is_bold: false,
                place: (x, frame.top),
                radius: 0.0,
                rank: (false, false),
            });
        }
        let room = Rect { left: frame.left, right: frame.right, top: frame.top, bottom: frame.bottom };
        for (name, placed) in named.iter().zip(place(&named, &self.lines(frame), &room)) {
            let Some(placed) = placed else { continue };
            if let Some((from, to)) = placed.leader {
                area.draw(&PathElement::new([from, to].map(at).to_vec(), line(PALE_INK, 1.0)))?;
            }
            write(area, &name.text, placed.middle, TEXT_PX, INK, HPos::Center, name.is_bold)?;
        }
        Ok(())
    }
}

fn color(family: usize) -> RGBColor {
    COLORS[family % COLORS.len()]
}

/// The interval of the error, and the quartiles of the cost.
fn intervals(area: &Area<'_>, frame: &Frame, point: &Point) -> Result<()> {
    let stroke = color(point.family).mix(0.4).stroke_width(units(1.25).unsigned_abs());
    let (x, y) = frame.of(point);
    let ends = |value: f64| if value.is_nan() { None } else { Some(value) };
    if let (Some(low), Some(high)) = (ends(point.error.low), ends(point.error.high)) {
        let path = [(x, frame.y(low)), (x, frame.y(high))];
        area.draw(&PathElement::new(path.map(at).to_vec(), stroke))?;
    }
    let path = [(frame.x(point.cost.low), y), (frame.x(point.cost.high), y)];
    area.draw(&PathElement::new(path.map(at).to_vec(), stroke))?;
    Ok(())
}

/// The mark of `point`: its shape shows the family; it is hollow if it fails a stability limit, and ringed if it is the default.
fn mark(area: &Area<'_>, point: &Point, place: Place) -> Result<()> {
    if !place.1.is_finite() || !point.error.value.is_finite() {
        return Ok(());
    }
    if point.is_default {
        area.draw(&Circle::new(at(place), units(RADIUS + RING), line(INK, 2.0)))?;
    }
    shape(area, place, point.family, point.is_stable())
}

/// A circle, a square, a triangle or a diamond by `family`.
fn shape(area: &Area<'_>, (x, y): Place, family: usize, is_filled: bool) -> Result<()> {
    let r = RADIUS;
    let corners: Vec<Place> = match family % 4 {
        1 => vec![(-r, -r), (r, -r), (r, r), (-r, r)],
        2 => vec![(0.0, -1.3 * r), (1.2 * r, r), (-1.2 * r, r)],
        3 => vec![(0.0, -1.4 * r), (1.4 * r, 0.0), (0.0, 1.4 * r), (-1.4 * r, 0.0)],
        _ => Vec::new(),
    };
    let fill = if is_filled { color(family) } else { WHITE };
    let stroke = line(color(family), 2.0);
    if corners.is_empty() {
        area.draw(&Circle::new(at((x, y)), units(r), fill.filled()))?;
        area.draw(&Circle::new(at((x, y)), units(r), stroke))?;
        return Ok(());
    }
    let mut path: Vec<_> = corners.iter().map(|(dx, dy)| at((x + dx, y + dy))).collect();
    area.draw(&Polygon::new(path.clone(), fill.filled()))?;
    path.extend(path.first().copied());
    area.draw(&PathElement::new(path, stroke))?;
    Ok(())
}
