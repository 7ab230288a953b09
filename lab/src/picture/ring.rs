//! The damage map of a shoulder, as a ring.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_wire::{Judgement, Verdict};

use super::tap::Tap;
use super::{SKY, Shoulder};
use tapline_draw::canvas::{
    Area, BLUE, GRID, INK, ORANGE, PALE_INK, Point, VERMILLION, at, line, number, units, write,
};

// Radii of the damage map: index 0, greatest index, regions, truth, marks of taps, writing.
const ZERO: f64 = 55.0;
const TOP: f64 = 116.0;
const FOUND: f64 = 122.0;
const TRUTH: f64 = 127.5;
const MARKS: f64 = 134.5;
const WRITING: f64 = 141.0;
/// Fraction of a location's sector that its bar fills.
const BAR_FRACTION: f64 = 0.84;

/// Where a damage map is drawn, and to which index its outermost circle belongs.
pub(crate) struct Ring {
    pub center: Point,
    pub greatest: f64,
}

impl Ring {
    /// Draws the map: how far a bar reaches is the damage index, where it stands is the place on the tyre.
    pub(crate) fn draw(&self, area: &Area<'_>, shoulder: &Shoulder<'_>) -> Result<()> {
        for index in self.circles() {
            self.arc(area, self.radius(index), (0.0, 360.0), GRID, 1.0)?;
        }
        self.bars(area, shoulder)?;
        for dash in 0..60 {
            let deg = 6.0 * f64::from(dash);
            self.arc(area, self.radius(shoulder.judgement.limit_reject), (deg, deg + 3.0), INK, 0.75)?;
        }
        let half_deg = 180.0 / shoulder.cells.len() as f64;
        for cell in &shoulder.cells {
            let sector = (cell.angle_deg - half_deg, cell.angle_deg + half_deg);
            if cell.region != 0 {
                self.arc(area, FOUND, sector, VERMILLION, 4.0)?;
            }
            if shoulder.cracked.contains(&cell.location) {
                self.arc(area, TRUTH, sector, INK, 2.0)?;
            }
        }
        self.scales(area)?;
        self.words(area, shoulder)
    }

    /// Marks where `tap` was made.
    pub(crate) fn mark(&self, area: &Area<'_>, tap: &Tap) -> Result<()> {
        let place = at(polar(self.center, MARKS, tap.cell.angle_deg));
        Ok(area.draw(&Circle::new(place, units(3.5), tap.color.filled()))?)
    }

    fn circles(&self) -> [f64; 4] {
        [0.0, 1.0, 2.0, 3.0].map(|third| self.greatest * third / 3.0)
    }

    fn radius(&self, index: f64) -> f64 {
        ZERO + (TOP - ZERO) * index / self.greatest
    }

    fn arc(&self, area: &Area<'_>, radius: f64, sector: Point, color: RGBColor, width: f64) -> Result<()> {
        Ok(area.draw(&PathElement::new(sweep(self.center, radius, sector), line(color, width)))?)
    }

    fn bars(&self, area: &Area<'_>, shoulder: &Shoulder<'_>) -> Result<()> {
        let Judgement { limit_re_inspect, limit_reject, .. } = shoulder.judgement;
        let half_deg = BAR_FRACTION * 180.0 / shoulder.cells.len() as f64;
        for cell in shoulder.cells.iter().filter(|cell| cell.damage_index.is_finite()) {
            let color = match cell.damage_index {
                index if index >= limit_reject => VERMILLION,
                index if index >= limit_re_inspect => ORANGE,
                _ => SKY,
            };
            let sector = (cell.angle_deg - half_deg, cell.angle_deg + half_deg);
            let mut outline = sweep(self.center, ZERO, sector);
            outline.extend(sweep(self.center, self.radius(cell.damage_index), sector).into_iter().rev());
            area.draw(&Polygon::new(outline, color.filled()))?;
        }
        Ok(())
    }

    /// Numbers on the circles, and degrees around them.
    fn scales(&self, area: &Area<'_>) -> Result<()> {
        for index in &self.circles()[1..] {
            let (x, y) = polar(self.center, self.radius(*index), 90.0);
            area.draw(&Rectangle::new([at((x - 5.0, y - 6.0)), at((x + 5.0, y + 6.0))], WHITE.filled()))?;
            write(area, &number((index * 10.0).round() / 10.0), (x, y), 11.0, PALE_INK, HPos::Center, false)?;
        }
        let (centered, aside) = (WRITING, WRITING - 7.0);
        let sides = [(0, centered, HPos::Center), (90, aside, HPos::Left), (180, centered, HPos::Center)];
        for (deg, radius, align) in sides.into_iter().chain([(270, aside, HPos::Right)]) {
            let place = polar(self.center, radius, f64::from(deg));
            write(area, &format!("{deg}°"), place, 12.0, PALE_INK, align, false)?;
        }
        Ok(())
    }

    /// What was scanned, and the verdict on it.
    fn words(&self, area: &Area<'_>, shoulder: &Shoulder<'_>) -> Result<()> {
        let word = |dy: f64, text: &str, size: f64, color: RGBColor, is_bold: bool| {
            write(area, text, (self.center.0, self.center.1 + dy), size, color, HPos::Center, is_bold)
        };
        let color = match Verdict::from_code(shoulder.judgement.verdict) {
            Some(Verdict::Reject) => VERMILLION,
            Some(Verdict::Pass) => BLUE,
            _ => INK,
        };
        word(-25.0, shoulder.scan.tyre.as_str(), 12.0, INK, false)?;
        word(-9.0, &format!("shoulder {}", shoulder.scan.shoulder), 12.0, INK, false)?;
        word(9.0, &shoulder.verdict(), 14.0, color, true)?;
        word(27.0, &format!("max. {:.2}", shoulder.peak.damage_index), 12.0, INK, false)
    }
}

/// What the colours and lines of the maps mean.
pub(crate) fn legend(area: &Area<'_>) -> Result<()> {
    let word = |x: f64, y: f64, word: &str| write(area, word, (x, y), 12.0, INK, HPos::Left, false);
    let (y, low_y) = (699.0, 720.0);
    for (x, name, color) in [(30.0, "sound", SKY), (96.0, "suspect", ORANGE), (174.0, "damage", VERMILLION)] {
        area.draw(&Rectangle::new([at((x, y - 5.0)), at((x + 10.0, y + 5.0))], color.filled()))?;
        word(x + 15.0, y, name)?;
    }
    let dash = |x: f64, y: f64, length: f64, color: RGBColor, width: f64| {
        area.draw(&PathElement::new(vec![at((x, y)), at((x + length, y))], line(color, width)))
    };
    for k in 0..3 {
        dash(254.0 + 8.0 * f64::from(k), y, 5.0, INK, 1.0)?;
    }
    word(281.0, y, "reject limit")?;
    dash(30.0, low_y, 18.0, VERMILLION, 4.0)?;
    word(53.0, low_y, "region found")?;
    dash(146.0, low_y, 18.0, INK, 2.0)?;
    word(169.0, low_y, "true crack")?;
    for (x, color) in [(258.0, BLUE), (269.0, VERMILLION)] {
        area.draw(&Circle::new(at((x, low_y)), units(3.5), color.filled()))?;
    }
    word(281.0, low_y, "taps at right")
}

/// The point at `radius` and `deg`, clockwise from the top.
fn polar(center: Point, radius: f64, deg: f64) -> Point {
    let (sin, cos) = deg.to_radians().sin_cos();
    (center.0 + radius * sin, center.1 - radius * cos)
}

/// The arc of `radius` over `sector`, from and to degrees.
fn sweep(center: Point, radius: f64, (from_deg, to_deg): Point) -> Vec<(i32, i32)> {
    let steps = ((to_deg - from_deg) / 1.5).ceil();
    let deg = |k: usize| from_deg + (to_deg - from_deg) * k as f64 / steps;
    (0..=steps as usize).map(|k| at(polar(center, radius, deg(k)))).collect()
}
