//! The rig of a station over a shift: what it measures relative to the reference, casing by casing.

use std::collections::BTreeMap;

use anyhow::Result;
use plotters::prelude::*;
use tapline_draw::canvas::{BLUE, INK, ORANGE, PALE_INK, Point, VERMILLION, units};
use tapline_draw::stats::extent;
use tapline_wire::Discriminator;

use crate::report::figures::axis::Axis;
use crate::report::figures::chart::{self, Key, Sheet, Stroke};

/// What is drawn: the first two depend on the force sensor and the impactor, the others on the microphone.
const CURVES: [(Discriminator, RGBColor, Stroke); 4] = [
    (Discriminator::FMax, BLUE, Stroke::Plain),
    (Discriminator::Tau, INK, Stroke::Dashed),
    (Discriminator::A1, VERMILLION, Stroke::Plain),
    (Discriminator::Pr, ORANGE, Stroke::Dashed),
];

/// With fewer casings nothing is drawn.
const CASINGS_MIN: usize = 3;

/// Most casings whose values are marked on the curves.
const MARKED_MOST: usize = 60;

/// A casing: each discriminator as a multiple of the reference's, and whether the verdict found it to be off.
pub(crate) type OfCasing<'a> = (&'a BTreeMap<String, f64>, bool);

/// The picture of `casings`, in the order in which they were tapped; `ends` are the first and the last. `None` if they
/// are few, or nothing is known of them. The axis covers at least `room`.
pub(crate) fn svg(title: String, ends: [&str; 2], casings: &[OfCasing<'_>], room: Point) -> Result<Option<String>> {
    let value = |which: Discriminator, (times, _): &OfCasing<'_>| times.get(which.name()).copied();
    let values = casings.iter().flat_map(|casing| CURVES.iter().filter_map(|&(which, ..)| value(which, casing)));
    let Some((low, high)) = extent(values.chain([room.0, room.1])) else { return Ok(None) };
    let is_known = |&&(which, ..): &&(Discriminator, RGBColor, Stroke)| {
        casings.iter().filter(|casing| value(which, casing).is_some()).count() >= CASINGS_MIN
    };
    let curves: Vec<_> = CURVES.iter().filter(is_known).collect();
    if curves.is_empty() {
        return Ok(None);
    }
    let key = |&&(which, color, stroke): &&(Discriminator, RGBColor, Stroke)| Key {
        words: which.printed().to_owned(),
        color,
        stroke,
    };
    let along = match format!("casing, {} to {}", ends[0], ends[1]) {
        short if short.chars().count() <= 50 => short,
        _ => "casing, in the order of tapping".to_owned(),
    };
    let mut along = Axis::from_to(along, (0.5, casings.len() as f64 + 0.5), 8);
    along.ticks.retain(|tick| tick.fract().abs() < 1e-9);
    let sheet = Sheet {
        height: 190,
        title,
        keys: curves.iter().map(key).collect(),
        ramp: None,
        x: along,
        y: Axis::around("times the reference's", (low, high), 5),
    };
    let at = |place: usize| place as f64 + 1.0;
    let picture = sheet.svg(|chart| {
        for (place, _) in casings.iter().enumerate().filter(|(_, (_, is_off))| *is_off) {
            chart::band(chart, (at(place) - 0.5, at(place) + 0.5), VERMILLION.mix(0.15))?;
        }
        chart::level(chart, 1.0, Stroke::Plain.style(PALE_INK))?;
        for &&(which, color, stroke) in &curves {
            let points: Vec<Option<Point>> =
                casings.iter().enumerate().map(|(place, of)| Some((at(place), value(which, of)?))).collect();
            chart::curve(chart, &points, stroke.style(color))?;
            let marked = points.iter().flatten().filter(|_| casings.len() <= MARKED_MOST);
            chart.draw_series(marked.map(|&at| Circle::new(at, units(1.5), color.filled())))?;
        }
        Ok(())
    })?;
    Ok(Some(picture))
}
