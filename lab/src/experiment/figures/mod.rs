//! The figures of chapter 5, each as a picture to draw and a table.

mod effects;
mod groups;
mod rings;

use anyhow::Result;
use plotters::style::{Color as _, RGBAColor, RGBColor};
use tapline_wire::{Calibration, Discriminator};

pub(super) use groups::repeats;

use tapline_draw::axes::Axis;
use tapline_draw::canvas::Point;
use tapline_draw::stats::extent;

use super::dataset::{Experiment, Tap};
use super::index::{Indices, PowerRatio, indices};
use crate::evaluation::{Key, Mark, Picture, Plot, Table, axis, rounded};
use crate::figures::DIGITS;

/// The six discriminators of the index: all but A_2 (section 5.4.3).
pub(super) const SIX: [Discriminator; 6] = {
    use Discriminator::{A1, Ef, FMax, Pf, Pr, Tau};
    [FMax, Tau, A1, Pr, Pf, Ef]
};

/// One more of Okabe and Ito's colours.
const SKY: RGBColor = RGBColor(86, 180, 233);

/// A figure, or a few that belong together.
#[derive(Debug, Clone)]
pub(super) struct Figure {
    pub picture: Picture,
    /// In SI units except angles and offsets, as everywhere in the program. The picture's file has its name too.
    pub table: Table,
}

/// All of them, in the order of their numbers.
pub(super) fn figures(experiment: &Experiment) -> Result<Vec<Figure>> {
    let indices: Indices = indices(&experiment.inspection, &SIX, PowerRatio::Rises)?;
    Ok(vec![
        effects::of_offset(experiment),
        effects::of_velocity_at_one_place(experiment),
        effects::of_velocity(experiment),
        rings::repetitions(experiment),
        groups::by_severity(experiment),
        groups::repeatability(experiment),
        groups::cracked_and_sound(experiment),
        rings::shoulders(experiment),
        rings::damage(experiment, &indices),
        rings::b_scan(experiment),
    ])
}

/// A number as a cell; absent is empty.
fn cell(value: impl Into<Option<f64>>) -> String {
    value.into().map_or_else(String::new, |value| rounded(value, DIGITS))
}

/// How a discriminator is written on a picture: symbol, unit, and how many of that unit the SI unit is.
fn shown(which: Discriminator) -> (&'static str, String, f64) {
    let (per_si, unit) = which.printed_unit(&Calibration::computed());
    // A simulated sound is some millivolts.
    let (unit, per_si) = match unit.as_str() {
        "V s" => ("mV s".to_owned(), 1e3),
        "V\u{b2}/Hz" => ("mV\u{b2}/Hz".to_owned(), 1e6),
        "V\u{b2}" => ("mV\u{b2}".to_owned(), 1e6),
        _ => (unit, per_si),
    };
    (which.printed(), unit, per_si)
}

/// Its symbol with its unit.
fn title_of(which: Discriminator) -> String {
    let (symbol, unit, _) = shown(which);
    if unit.is_empty() { symbol.to_owned() } else { format!("{symbol} in {unit}") }
}

/// A stretch of the abscissa over a planted crack.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shade {
    from: f64,
    to: f64,
    severity: u8,
}

fn shade(severity: u8) -> RGBAColor {
    SKY.mix(0.16 * f64::from(severity))
}

/// Keys of `lines`, and what shades mean.
fn keys(lines: impl IntoIterator<Item = (String, RGBColor)>) -> Vec<Key> {
    let severity =
        Key::Patches(String::new(), (1..=3).map(shade).collect(), "planted crack, severity 1, 2, 3".to_owned());
    lines.into_iter().map(|(name, color)| Key::Line(name, color)).chain([severity]).collect()
}

/// Where the taps of a turn are over planted cracks.
fn shades(turn: &[&Tap]) -> Vec<Shade> {
    let half_deg = turn.get(1).map_or(0.0, |tap| 0.5 * tap.angle_deg);
    let arcs = turn.chunk_by(|a, b| a.severity == b.severity).filter(|arc| arc[0].is_cracked());
    let edge = |deg: f64| deg.clamp(0.0, 360.0);
    arcs.map(|arc| Shade {
        from: edge(arc[0].angle_deg - half_deg),
        to: edge(arc[arc.len() - 1].angle_deg + half_deg),
        severity: arc[0].severity,
    })
    .collect()
}

/// A curve of `value` around the ring.
fn around(turn: &[&Tap], color: RGBColor, width: f64, value: impl Fn(&Tap) -> Option<f64>) -> Mark {
    Mark::Line(turn.iter().map(|tap| (tap.angle_deg, value(tap).unwrap_or(f64::NAN))).collect(), color, width)
}

/// From the least to the greatest of `values`, with a margin.
fn spanned(values: impl IntoIterator<Item = f64>) -> Point {
    match extent(values) {
        Some((low, high)) if high > low => (low - 0.06 * (high - low), high + 0.06 * (high - low)),
        Some((low, high)) => (low - 0.5, high + 0.5),
        None => (0.0, 1.0),
    }
}

fn ordinate(label: &str, curves: &[Mark]) -> Axis {
    let values = curves.iter().flat_map(|curve| match curve {
        Mark::Line(points, ..) | Mark::Dots(points, ..) => points.as_slice(),
        _ => &[],
    });
    axis(label, spanned(values.map(|point| point.1)), 6)
}

/// A plot of curves around the ring, over shades where a crack is planted.
fn ring_plot(name: String, y: Axis, curves: Vec<Mark>, shades: &[Shade]) -> Plot {
    let (low, high) = y.range;
    let under = shades.iter().map(|s| Mark::Filled([(s.from, low), (s.to, high)], shade(s.severity)));
    Plot::new(name, axis("Angle in degrees", (0.0, 360.0), 8), y, under.chain(curves).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a shade that is half a place too short, joins two severities, or leaves the ring.
    #[test]
    fn shades_lie_under_cracks() {
        let experiment = Experiment::take(1).unwrap();
        let shades = shades(&experiment.repetitions(1)[0]);
        let covered_deg: f64 = shades.iter().map(|shade| shade.to - shade.from).sum();
        assert!((covered_deg - 59.0 * 3.6).abs() < 1e-9, "{shades:?}");
        assert!(shades.windows(2).all(|pair| pair[0].to <= pair[1].from + 1e-9), "{shades:?}");
        // 5 to 13: from half a place before 18 degrees to half a place after 46.8.
        assert!((shades[0].from - 16.2).abs() < 1e-9 && (shades[0].to - 48.6).abs() < 1e-9 && shades[0].severity == 2);
    }
}
