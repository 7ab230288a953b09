//! Curves along the ring: the damage index with its limits, and each discriminator in two repetitions.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{BLUE, INK, ORANGE, PALE_INK, Point, VERMILLION, font};
use tapline_draw::stats::extent;
use tapline_store::Region;
use tapline_wire::{Discriminator, Discriminators, Geometry};

use crate::report::evidence::condition::Condition;
use crate::report::evidence::{Cell, Evidence, Shoulder, Tap, Tyre};
use crate::report::figures::axis::Axis;
use crate::report::figures::chart::{self, Chart, Key, Sheet, Stroke, scaled};
use crate::report::pages::words;

/// Most shoulders in one picture of the index.
pub(crate) const SHOULDERS: usize = 2;

/// Colours and strokes of the curves of one picture.
const CURVES: [(RGBColor, Stroke); 2] = [(BLUE, Stroke::Plain), (VERMILLION, Stroke::Dashed)];

/// One repetition: its name, and the position and value at each location; `None` where there is no tap or no value.
type Turn = (String, Vec<Option<Point>>);

/// The axis along the ring or line.
pub(crate) fn along(shoulders: &[Shoulder]) -> Axis {
    if shoulders.iter().all(|shoulder| shoulder.is_round) {
        return Axis {
            label: "angle, deg".to_owned(),
            range: (0.0, 360.0),
            ticks: vec![0.0, 90.0, 180.0, 270.0, 360.0],
        };
    }
    let places = shoulders.iter().flat_map(|shoulder| shoulder.cells.iter().map(|cell| cell.place));
    let (first, last) = extent(places).unwrap_or((0.0, 1.0));
    Axis::from_to("location", (first - 0.5, last + 0.5), 8)
}

/// The damage index of at most [`SHOULDERS`] shoulders of a tyre, with their limits; the axis covers all of `range`.
pub(crate) fn index(geometry: Geometry, title: String, shoulders: &[Shoulder], range: (f64, f64)) -> Result<String> {
    let keys = CURVES.iter().zip(shoulders).map(|(&(color, stroke), shoulder)| Key {
        words: format!("{} {}", words::side(geometry), shoulder.number),
        color,
        stroke,
    });
    let limit = |words: &str, color| Key { words: words.to_owned(), color, stroke: Stroke::Limit };
    let limits = [limit("reject", INK), limit("re-inspect", ORANGE)];
    let sheet = Sheet {
        height: 214,
        title,
        keys: keys.chain(limits).collect(),
        ramp: None,
        x: along(shoulders),
        y: Axis::around("damage index", range, 6),
    };
    sheet.svg(|chart| {
        if let [alone] = shoulders {
            shade(chart, alone)?;
        }
        for limits in shoulders.iter().filter_map(|shoulder| shoulder.limits) {
            chart::level(chart, limits.reject, Stroke::Limit.style(INK))?;
            chart::level(chart, limits.re_inspect, Stroke::Limit.style(ORANGE))?;
        }
        for (shoulder, &(color, stroke)) in shoulders.iter().zip(&CURVES) {
            let points = shoulder.cells.iter().map(|cell| cell.index.map(|index| (cell.place, index)));
            chart::curve(chart, &closed(shoulder.is_round, points.collect()), stroke.style(color))?;
        }
        Ok(())
    })
}

/// The curve of a ring, with its first point repeated at the end.
fn closed(is_round: bool, mut points: Vec<Option<Point>>) -> Vec<Option<Point>> {
    let first = points.first().copied().flatten().filter(|(place, _)| is_round && *place < 1e-9);
    points.extend(first.map(|(_, y)| Some((360.0, y))));
    points
}

/// One discriminator along each shoulder of `tyre`, all on one scale; empty if no tap has it.
pub(crate) fn discriminator(
    evidence: &Evidence,
    tyre: &Tyre,
    condition: Condition,
    which: Discriminator,
) -> Result<Vec<String>> {
    let geometry = evidence.geometry;
    let name = which.printed();
    let (per_si, unit) = which.printed_unit(&evidence.recording.calibration);
    let turns: Vec<_> = tyre.shoulders.iter().map(|shoulder| turns(shoulder, condition, which, per_si)).collect();
    let values = turns.iter().flatten().flat_map(|(_, points)| points.iter().flatten().map(|point| point.1));
    let Some(extremes) = extent(values) else { return Ok(Vec::new()) };
    let (scale, label) = scaled(name, &unit, extremes);
    let picture = |(shoulder, turns): (&Shoulder, Vec<Turn>)| {
        let key =
            |(&(color, stroke), (words, _)): (&(RGBColor, Stroke), &Turn)| Key { words: words.clone(), color, stroke };
        let sheet = Sheet {
            height: 142,
            title: format!("{name}, {} {}", words::side(geometry), shoulder.number),
            keys: CURVES.iter().zip(&turns).map(key).collect(),
            ramp: None,
            x: along(std::slice::from_ref(shoulder)),
            y: Axis::around(label.clone(), (extremes.0 * scale, extremes.1 * scale), 5),
        };
        sheet.svg(|chart| {
            shade(chart, shoulder)?;
            for ((_, points), &(color, stroke)) in turns.iter().zip(&CURVES) {
                let points: Vec<_> = points.iter().map(|point| point.map(|(x, y)| (x, y * scale))).collect();
                chart::curve(chart, &points, stroke.style(color))?;
            }
            Ok(())
        })
    };
    tyre.shoulders.iter().zip(turns).map(picture).collect()
}

/// The first two repetitions.
fn turns(shoulder: &Shoulder, condition: Condition, which: Discriminator, per_si: f64) -> Vec<Turn> {
    let here = || shoulder.taps.iter().filter(|tap| tap.condition == condition);
    let mut repetitions: Vec<u16> = here().map(|tap| tap.repetition).collect();
    repetitions.sort_unstable();
    repetitions.dedup();
    repetitions.truncate(CURVES.len());
    let mut cells: Vec<&Cell> = shoulder.cells.iter().collect();
    cells.sort_by(|a, b| a.place.total_cmp(&b.place));
    let turn = |(repetition, order): (u16, usize)| {
        let taps = || here().filter(move |tap| tap.repetition == repetition);
        let value = |found: Discriminators| found.values.get(which);
        let point = |tap: &Tap| tap.found.and_then(value).map(|value| (tap.place, value * per_si));
        // By location: a second reading has taps only at some, and its curve has gaps between them.
        let of_cell =
            |cell: &&Cell| taps().find(|tap| tap.location == cell.location && !tap.is_closing).and_then(point);
        let closing = taps().filter(|tap| tap.is_closing).map(point);
        let points = cells.iter().map(of_cell).chain(closing).collect();
        let is_second = taps().any(|tap| tap.is_second_reading);
        (if is_second { "second reading".to_owned() } else { format!("repetition {order}") }, points)
    };
    repetitions.into_iter().zip(1..).map(turn).collect()
}

/// Shades the regions of `shoulder` and numbers them.
fn shade(chart: &mut Chart<'_, '_>, shoulder: &Shoulder) -> Result<()> {
    let (x, y) = (chart.x_range(), chart.y_range());
    for (region, spans) in shoulder.regions.iter().zip(spans(shoulder, (x.start, x.end))) {
        for span in &spans {
            chart::band(chart, *span, VERMILLION.mix(0.16))?;
        }
        if let Some((from, to)) = spans.first() {
            let style = font(10.0, PALE_INK, HPos::Center, true);
            let place = (0.5 * (from + to), y.end - 0.075 * (y.end - y.start));
            chart.draw_series([Text::new(region.region.to_string(), place, style)])?;
        }
    }
    Ok(())
}

/// The range of each region of `shoulder` within `range`; in two parts if it lies across the start of a ring.
pub(crate) fn spans(shoulder: &Shoulder, range: Point) -> Vec<Vec<Point>> {
    let steps = shoulder.cells.windows(2).map(|pair| pair[1].place - pair[0].place);
    let half = 0.5 * steps.fold(None, |least, step| least.filter(|least| *least < step).or(Some(step))).unwrap_or(1.0);
    let spans_of = |region: &Region| {
        let (first, last) = (region.first_location, region.last_location);
        let is_inside = |location| {
            if first <= last { (first..=last).contains(&location) } else { location >= first || location <= last }
        };
        let places: Vec<f64> =
            shoulder.cells.iter().filter(|cell| is_inside(cell.location)).map(|cell| cell.place).collect();
        // The end of a ring is its start, so a cell there extends over both.
        let runs = places.chunk_by(|a, b| b - a < 3.0 * half);
        let span = |run: &[f64]| Some((run.first()? - half, run.last()? + half));
        let clamped = |(from, to): Point| (from.clamp(range.0, range.1), to.clamp(range.0, range.1));
        runs.filter_map(span).map(clamped).collect()
    };
    shoulder.regions.iter().map(spans_of).collect()
}
