//! Force and sound of two taps: one at the damage and one at an ordinary location.

use anyhow::Result;
use plotters::style::RGBColor;
use tapline_draw::canvas::{BLUE, VERMILLION};
use tapline_draw::stats::extent;
use tapline_store::Reader;
use tapline_wire::{Channel, Geometry, Unit};

use crate::report::evidence::condition::Condition;
use crate::report::evidence::samples::{Signal, signal};
use crate::report::evidence::{Cell, Shoulder, Tyre};
use crate::report::figures::axis::Axis;
use crate::report::figures::chart::{self, Key, Sheet, Stroke};

/// Time range of the force, around the trigger.
const FORCE_MS: (f64, f64) = (-0.5, 3.0);
const SOUND_MS: (f64, f64) = (-1.0, 12.0);
/// Most points of a curve.
const POINTS: usize = 700;

/// Pictures of the two taps, and how these were chosen.
pub(crate) struct Pair {
    /// Force, then sound, if they were recorded.
    pub pictures: Vec<String>,
    /// Names of the two taps.
    pub words: String,
}

/// A tap at the highest index of `tyre` and one at the most ordinary location of the same shoulder, in the first
/// repetition under `condition` that has both; `None` if there are no two.
pub(crate) fn pair(reader: &Reader, geometry: Geometry, tyre: &Tyre, condition: Condition) -> Result<Option<Pair>> {
    let by_peak = |a: &&Shoulder, b: &&Shoulder| {
        let peak = |s: &Shoulder| s.peak().and_then(|cell| cell.index).unwrap_or(f64::NEG_INFINITY);
        // Of equal ones, the first.
        peak(a).total_cmp(&peak(b)).then(b.number.cmp(&a.number))
    };
    let Some(shoulder) = tyre.shoulders.iter().max_by(by_peak) else { return Ok(None) };
    let (Some(peak), Some(ordinary)) = (shoulder.peak(), shoulder.ordinary()) else { return Ok(None) };
    if peak.location == ordinary.location {
        return Ok(None);
    }
    let word = if peak.region == 0 { "highest index, not damage" } else { "damage" };
    let place = |cell: &Cell| match shoulder.is_round {
        true => format!("{:.0}°", cell.place),
        false => format!("location {}", cell.location),
    };
    let row = |cell: &Cell| {
        let here = shoulder.taps.iter().filter(|tap| tap.condition == condition && !tap.is_closing);
        here.filter(|tap| tap.location == cell.location && tap.found.is_some()).min_by_key(|tap| tap.repetition)
    };
    let (Some(of_peak), Some(of_ordinary)) = (row(peak), row(ordinary)) else { return Ok(None) };
    let names = [format!("ordinary, {}", place(ordinary)), format!("{word}, {}", place(peak))];
    let mut pictures = Vec::new();
    for (kind, window_ms) in [(Channel::Force, FORCE_MS), (Channel::Sound, SOUND_MS)] {
        let signals = [signal(reader, of_ordinary.row, kind)?, signal(reader, of_peak.row, kind)?];
        let unit = reader.plan().recording.calibration.unit(kind);
        if let [Some(sound), Some(cracked)] = signals {
            pictures.push(picture((kind, unit), window_ms, [&sound, &cracked], &names)?);
        }
    }
    let words = format!("{} {}", crate::report::pages::words::side(geometry), shoulder.number);
    Ok((!pictures.is_empty()).then_some(Pair { pictures, words }))
}

fn picture(
    (kind, unit): (Channel, Unit),
    window_ms: (f64, f64),
    signals: [&Signal; 2],
    names: &[String; 2],
) -> Result<String> {
    const STYLES: [(RGBColor, Stroke); 2] = [(BLUE, Stroke::Plain), (VERMILLION, Stroke::Dashed)];
    let curves = signals.map(|signal| signal.between(window_ms.0, window_ms.1, POINTS));
    let title = match kind {
        Channel::Force => "Force",
        Channel::Sound => "Sound",
    };
    let label = format!("{}, {}", kind.name(), unit.name());
    let extremes = extent(curves.iter().flatten().map(|point| point.1)).unwrap_or((0.0, 1.0));
    // The axis ends with the records, so that no part of the picture is empty.
    let ends = extent(curves.iter().flatten().map(|point| point.0)).unwrap_or(window_ms);
    let sheet = Sheet {
        height: 226,
        title: title.to_owned(),
        keys: names
            .iter()
            .zip(STYLES)
            .map(|(name, (color, stroke))| Key { words: name.clone(), color, stroke })
            .collect(),
        ramp: None,
        x: Axis::from_to("time since trigger, ms", ends, 6),
        y: Axis::around(label, extremes, 5),
    };
    sheet.svg(|chart| {
        for (points, (color, stroke)) in curves.iter().zip(STYLES) {
            let points: Vec<_> = points.iter().copied().map(Some).collect();
            chart::curve(chart, &points, stroke.style(color))?;
        }
        Ok(())
    })
}
