//! The damage map of a line, as a straight strip.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{self, Area, INK, PALE_INK, Point, at, line, write};
use tapline_draw::scale::Scale;

use crate::report::evidence::Shoulder;
use crate::report::figures::chart::WIDTH;
use crate::report::figures::colour::{ABSENT, heat};
use crate::report::figures::{inline, scale};

const HEIGHT: u32 = 188;
const LEFT: f64 = 24.0;
const RIGHT: f64 = 350.0;
const TOP: f64 = 46.0;
const BOTTOM: f64 = 92.0;

/// The map of `shoulder`, called `title`.
pub(crate) fn svg(title: &str, shoulder: &Shoulder, greatest: f64) -> Result<String> {
    let svg = canvas::svg((WIDTH, HEIGHT), |area| {
        write(area, title, (8.0, 10.0), 12.0, INK, HPos::Left, true)?;
        let peak =
            shoulder.peak().and_then(|cell| cell.index).map_or(String::new(), |index| format!(", max. {index:.2}"));
        let verdict = format!("{}{peak}", shoulder.verdict);
        write(area, &verdict, (f64::from(WIDTH) - 8.0, 10.0), 12.0, INK, HPos::Right, true)?;
        cells(area, shoulder, greatest)?;
        numbers(area, shoulder)?;
        scale::bar(area, greatest, shoulder.limits, 148.0)
    })?;
    Ok(inline::svg(&svg, title))
}

/// Left and right end of the location number `place`.
fn ends(shoulder: &Shoulder, place: f64) -> Point {
    let first = shoulder.cells.first().map_or(0.0, |cell| cell.place);
    let last = shoulder.cells.last().map_or(0.0, |cell| cell.place);
    let width = (RIGHT - LEFT) / (last - first + 1.0);
    (LEFT + (place - first) * width, LEFT + (place - first + 1.0) * width)
}

fn cells(area: &Area<'_>, shoulder: &Shoulder, greatest: f64) -> Result<()> {
    let height = (BOTTOM - TOP) / (2 * shoulder.offsets.len()).max(1) as f64;
    let whole = if shoulder.offsets.is_empty() { BOTTOM } else { 0.5 * (TOP + BOTTOM) };
    for (order, cell) in shoulder.cells.iter().enumerate() {
        let (left, right) = ends(shoulder, cell.place);
        let patch = |top: f64, bottom: f64, index: Option<f64>| {
            let color = index.map_or(ABSENT, |index| heat(index, (0.0, greatest)));
            area.draw(&Rectangle::new([at((left, top)), at((right, bottom))], color.filled()))
        };
        patch(TOP, whole, cell.index)?;
        for (row, map) in (0..).zip(&shoulder.offsets) {
            let top = whole + f64::from(row) * height;
            patch(top + 1.0, top + height, map.index.get(order).copied().flatten())?;
        }
        let under = |y: f64, color: RGBColor, width: f64| {
            area.draw(&PathElement::new(vec![at((left, y)), at((right, y))], line(color, width)))
        };
        if cell.region != 0 {
            under(TOP - 6.0, canvas::VERMILLION, 7.0)?;
        }
        if cell.is_cracked == Some(true) {
            under(BOTTOM + 5.0, INK, 3.0)?;
        }
    }
    Ok(())
}

/// Numbers of the regions above, and of locations below.
fn numbers(area: &Area<'_>, shoulder: &Shoulder) -> Result<()> {
    let middle = |place: f64| 0.5 * (ends(shoulder, place).0 + ends(shoulder, place).1);
    for region in &shoulder.regions {
        let x = 0.5 * (middle(f64::from(region.first_location)) + middle(f64::from(region.last_location)));
        write(area, &region.region.to_string(), (x, TOP - 17.0), 12.0, INK, HPos::Center, true)?;
    }
    let first = shoulder.cells.first().map_or(0.0, |cell| cell.place);
    let last = shoulder.cells.last().map_or(0.0, |cell| cell.place);
    for tick in Scale::linear((first, last)).ticks(8).into_iter().filter(|tick| tick.value.fract().abs() < 1e-9) {
        write(area, &tick.label, (middle(tick.value), BOTTOM + 16.0), 11.0, PALE_INK, HPos::Center, false)?;
    }
    write(area, "location", (RIGHT, BOTTOM + 30.0), 11.0, PALE_INK, HPos::Right, false)
}
