//! The damage map of a shoulder: a ring as seen when facing the tyre, with regions, verdict and scale.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{self, Area, GRID, INK, PALE_INK, Point, at, line, write};
use tapline_wire::Verdict;

use crate::report::evidence::{Cell, Shoulder};
use crate::report::figures::chart::WIDTH;
use crate::report::figures::colour::{ABSENT, heat};
use crate::report::figures::{inline, scale};

const HEIGHT: u32 = 466;
const CENTER: Point = (185.0, 206.0);
// Radii: of the index of all taps, of the offsets inside it, of regions and known cracks outside, of text.
const OUTER: f64 = 142.0;
const INNER: f64 = 108.0;
const CORE: f64 = 62.0;
const REGION: f64 = 149.0;
const TRUTH: f64 = 157.0;
const DEGREES: f64 = 172.0;
const NUMBERS: f64 = 125.0;
/// Gap between the rings.
const GAP: f64 = 2.0;

/// The map of `shoulder`, called `title`.
pub(crate) fn svg(title: &str, shoulder: &Shoulder, greatest: f64) -> Result<String> {
    let svg = canvas::svg((WIDTH, HEIGHT), |area| {
        write(area, title, (8.0, 10.0), 12.0, INK, HPos::Left, true)?;
        rings(area, shoulder, greatest)?;
        arcs(area, shoulder)?;
        degrees(area)?;
        words(area, shoulder)?;
        offsets(area, shoulder)?;
        scale::bar(area, greatest, shoulder.limits, 408.0)
    })?;
    Ok(inline::svg(&svg, title))
}

/// The index of all taps is outside; inside it is that of each offset, if there are several.
fn rings(area: &Area<'_>, shoulder: &Shoulder, greatest: f64) -> Result<()> {
    let inner = if shoulder.offsets.is_empty() { CORE } else { INNER };
    ring(area, shoulder, (inner, OUTER), greatest, |place| shoulder.cells[place].index)?;
    let width = (INNER - CORE) / shoulder.offsets.len().max(1) as f64;
    for (order, map) in (0..).zip(&shoulder.offsets) {
        let outer = INNER - f64::from(order) * width;
        ring(area, shoulder, (outer - width, outer - GAP), greatest, |place| map.index.get(place).copied().flatten())?;
    }
    Ok(())
}

fn ring(
    area: &Area<'_>,
    shoulder: &Shoulder,
    (low, high): Point,
    greatest: f64,
    index: impl Fn(usize) -> Option<f64>,
) -> Result<()> {
    for (place, sector) in sectors(&shoulder.cells).into_iter().enumerate() {
        let mut outline = sweep(low, sector);
        outline.extend(sweep(high, sector).into_iter().rev());
        let color = index(place).map_or(ABSENT, |index| heat(index, (0.0, greatest)));
        area.draw(&Polygon::new(outline, color.filled()))?;
    }
    Ok(())
}

/// Extends a sector slightly, so that no gap shows between neighbours.
fn joined((from, to): Point) -> Point {
    (from - 0.15, to + 0.15)
}

/// Labels of the rings.
fn offsets(area: &Area<'_>, shoulder: &Shoulder) -> Result<()> {
    if shoulder.offsets.is_empty() {
        return Ok(());
    }
    let offsets: Vec<String> = shoulder.offsets.iter().map(|map| canvas::number(map.offset_mm)).collect();
    let words = format!("rings, from outside: all taps; offset {} mm", offsets.join(", "));
    write(area, &words, (CENTER.0, f64::from(HEIGHT) - 14.0), 11.0, INK, HPos::Center, false)
}

/// Regions with their numbers, and known cracks.
fn arcs(area: &Area<'_>, shoulder: &Shoulder) -> Result<()> {
    for (cell, sector) in shoulder.cells.iter().zip(sectors(&shoulder.cells)) {
        if cell.region != 0 {
            area.draw(&PathElement::new(sweep(REGION, joined(sector)), line(canvas::VERMILLION, 7.0)))?;
        }
        if cell.is_cracked == Some(true) {
            area.draw(&PathElement::new(sweep(TRUTH, joined(sector)), line(INK, 3.0)))?;
        }
    }
    for region in &shoulder.regions {
        let middle = middle(shoulder, region.first_location, region.last_location);
        let place = polar(NUMBERS, middle);
        area.draw(&Circle::new(at(place), canvas::units(9.0), WHITE.filled()))?;
        area.draw(&Circle::new(at(place), canvas::units(9.0), line(INK, 1.0)))?;
        write(area, &region.region.to_string(), place, 12.0, INK, HPos::Center, true)?;
    }
    Ok(())
}

/// Half way from one location to another, clockwise.
fn middle(shoulder: &Shoulder, first: u32, last: u32) -> f64 {
    let place = |location| shoulder.cells.iter().find(|cell| cell.location == location).map_or(0.0, |cell| cell.place);
    let (start, end) = (place(first), place(last));
    start + 0.5 * (end - start).rem_euclid(360.0)
}

/// Angles around the map, the start, and the direction of counting.
fn degrees(area: &Area<'_>) -> Result<()> {
    for step in 0..12 {
        let deg = 30.0 * f64::from(step);
        let ends = [polar(OUTER + 2.0, deg), polar(OUTER + 6.0, deg)];
        area.draw(&PathElement::new(ends.map(at).to_vec(), line(PALE_INK, 1.0)))?;
        let (x, y) = polar(DEGREES, deg);
        // The start has its own label, above which there is room.
        let text = if step == 0 { "0° start mark".to_owned() } else { format!("{deg:.0}°") };
        let y = if step == 0 { y - 4.0 } else { y };
        write(area, &text, (x, y), 11.0, if step == 0 { INK } else { PALE_INK }, HPos::Center, step == 0)?;
    }
    let start = [polar(TRUTH + 1.0, 0.0), polar(TRUTH + 8.0, 357.0), polar(TRUTH + 8.0, 3.0)];
    area.draw(&Polygon::new(start.map(at).to_vec(), INK.filled()))?;
    // An arrow around the verdict shows the direction of rotation.
    let (radius, tip) = (CORE - 9.0, 70.0);
    area.draw(&PathElement::new(sweep(radius, (20.0, tip - 4.0)), line(PALE_INK, 1.5)))?;
    let head = [polar(radius, tip + 2.0), polar(radius + 4.0, tip - 7.0), polar(radius - 4.0, tip - 7.0)];
    area.draw(&Polygon::new(head.map(at).to_vec(), PALE_INK.filled()))?;
    Ok(())
}

/// The verdict, in the middle.
fn words(area: &Area<'_>, shoulder: &Shoulder) -> Result<()> {
    area.draw(&Circle::new(at(CENTER), canvas::units(CORE - 1.0), line(GRID, 1.0)))?;
    let word = |dy: f64, text: &str, size: f64, is_bold: bool| {
        write(area, text, (CENTER.0, CENTER.1 + dy), size, INK, HPos::Center, is_bold)
    };
    let size = if shoulder.verdict == Verdict::ReInspect { 13.5 } else { 16.0 };
    word(-4.0, &shoulder.verdict.to_string(), size, true)?;
    word(
        14.0,
        &shoulder.peak().and_then(|c| c.index).map_or("no index".to_owned(), |i| format!("max. {i:.2}")),
        11.0,
        false,
    )?;
    word(-22.0, "clockwise", 10.0, false)
}

/// The range of each location in degrees: halfway to its neighbours, but at most half the usual step, so that what
/// was not scanned stays empty.
fn sectors(cells: &[Cell]) -> Vec<Point> {
    let count = cells.len();
    let step = |a: usize, b: usize| (cells[b].place - cells[a].place).rem_euclid(360.0);
    let mut steps: Vec<f64> = (1..count).map(|k| step(k - 1, k)).collect();
    steps.sort_by(f64::total_cmp);
    let usual = steps.get(steps.len() / 2).copied().unwrap_or(360.0);
    let half = |step: f64| 0.5 * if step > 0.0 && step < usual { step } else { usual };
    let sector = |k: usize| {
        let place = cells[k].place;
        (place - half(step((k + count - 1) % count, k)), place + half(step(k, (k + 1) % count)))
    };
    (0..count).map(sector).collect()
}

/// The point at `radius` and `deg`, clockwise from the top.
fn polar(radius: f64, deg: f64) -> Point {
    let (sin, cos) = deg.to_radians().sin_cos();
    (CENTER.0 + radius * sin, CENTER.1 - radius * cos)
}

/// An arc in steps of at most 4 degrees.
fn sweep(radius: f64, (from, to): Point) -> Vec<(i32, i32)> {
    let count = ((to - from) / 4.0).ceil().clamp(1.0, 90.0) as u32;
    (0..=count).map(|k| at(polar(radius, from + (to - from) * f64::from(k) / f64::from(count)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(places: &[f64]) -> Vec<Cell> {
        let cell = |(location, &place): (u32, &f64)| Cell { location, place, index: None, region: 0, is_cracked: None };
        (0..).zip(places).map(cell).collect()
    }

    /// Catches a map that fills what was not scanned, and one with a gap at the start.
    #[test]
    fn sectors_meet_and_leave_gaps() {
        assert_eq!(sectors(&cells(&[0.0, 90.0, 180.0, 270.0]))[0], (-45.0, 45.0));
        assert_eq!(sectors(&cells(&[0.0, 10.0, 20.0, 180.0]))[2], (15.0, 25.0));
        assert_eq!(sectors(&cells(&[0.0]))[0], (-180.0, 180.0));
    }
}
