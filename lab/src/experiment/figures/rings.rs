//! Figs. 63, 64, 70, 71 and 73 to 76: results around the ring.

use plotters::prelude::{Color as _, RGBColor, ViridisRGB};
use tapline_draw::canvas::{Point, number};
use tapline_draw::palette::COLORS;
use tapline_wire::Discriminator;

use super::{
    Figure, Key, Mark, Picture, Plot, SIX, Table, around, axis, cell, keys, ordinate, ring_plot, shades, shown,
    title_of,
};
use crate::experiment::SEVEN;
use crate::experiment::dataset::{Experiment, Tap, Turn, averaged};
use crate::experiment::index::Indices;
use crate::experiment::spectrum::{BAND_HZ, STEP_HZ};
use crate::experiment::tyres::{NEW, REPRESENTATIVE, SLIGHT, VELOCITY_M_PER_S};

/// Power densities, in dB re 1 V^2/Hz, of the lowest and the highest colour of the B-scan.
const LEVELS_DB: (f64, f64) = (-90.0, -58.0);
/// How many colours it has.
const LEVELS: usize = 10;

/// The colour of a level, from dark to bright, and so readable without colour.
fn level_color(level: usize) -> RGBColor {
    ViridisRGB::get_color(level as f64 / (LEVELS - 1) as f64)
}

fn level(density_db: f64) -> usize {
    let (low, high) = LEVELS_DB;
    let count = LEVELS as f64;
    ((density_db - low) / (high - low) * count).floor().clamp(0.0, count - 1.0) as usize
}

/// A colour for every place of a map: its `columns`, each from below, lie between `edges` of the abscissa.
fn map(edges: &[f64], (low, high): Point, columns: &[Vec<f64>]) -> Mark {
    let whole = edges.first().zip(edges.last()).map(|(&left, &right)| ([(left, low), (right, high)], level_color(0)));
    // The lowest colour is the ground; runs of one colour are one rectangle, or the picture would be a megabyte.
    let mut cells: Vec<_> = whole.into_iter().collect();
    for (column, edges) in columns.iter().zip(edges.windows(2)) {
        let step = (high - low) / column.len() as f64;
        let mut first = 0;
        for run in column.chunk_by(|a, b| level(*a) == level(*b)) {
            let [from, to] = [first, first + run.len()].map(|place| low + step * place as f64);
            first += run.len();
            if level(run[0]) > 0 {
                cells.push(([(edges[0], from), (edges[1], to)], level_color(level(run[0]))));
            }
        }
    }
    Mark::Cells(cells)
}

/// Figs. 63 and 64: the seven discriminators, twice around.
pub(super) fn repetitions(experiment: &Experiment) -> Figure {
    let turns = experiment.repetitions(1);
    let columns = ["repetition", "location", "angle_deg", "severity"];
    let mut table = Table::long("fig63-64", "", columns.into_iter().chain(SEVEN.map(Discriminator::column)));
    for tap in turns.iter().flatten() {
        let id = &tap.found.id;
        let place = [id.repetition.to_string(), id.location.to_string(), cell(tap.angle_deg), tap.severity.to_string()];
        table.push_texts(place.into_iter().chain(SEVEN.map(|which| cell(tap.value(which)))));
    }
    let plot = |which: Discriminator| {
        let scaled = |tap: &Tap| tap.value(which).map(|value| value * shown(which).2);
        let curves: Vec<Mark> = turns
            .iter()
            .zip(COLORS)
            .zip([2.0, 1.1])
            .map(|((t, color), width)| around(t, color, width, scaled))
            .collect();
        ring_plot(title_of(which), ordinate("", &curves), curves, &shades(&turns[0]))
    };
    let picture = Picture {
        title: "Figs. 63 and 64: the discriminators, twice around".to_owned(),
        note: format!("Representative tyre, shoulder 1, 101 taps each, x = 0, {} m/s", number(VELOCITY_M_PER_S)),
        keys: keys(["first time around", "second"].map(str::to_owned).into_iter().zip(COLORS)),
        columns: 2,
        height: 140.0,
        plots: SEVEN.map(plot).to_vec(),
        ..Picture::default()
    };
    Figure { picture, table }
}

/// Figs. 70 and 71: six discriminators of both shoulders, the mean of two turns.
pub(super) fn shoulders(experiment: &Experiment) -> Figure {
    let columns = ["shoulder", "location", "angle_deg", "severity"];
    let mut table = Table::long("fig70-71", "", columns.into_iter().chain(SIX.map(Discriminator::column)));
    let both = [1, 2].map(|shoulder| experiment.repetitions(shoulder));
    for turns in &both {
        let values = SIX.map(|which| averaged(turns, which));
        for (place, tap) in turns[0].iter().enumerate() {
            let id = &tap.found.id;
            let at = [id.shoulder.to_string(), id.location.to_string(), cell(tap.angle_deg), tap.severity.to_string()];
            table.push_texts(at.into_iter().chain(values.iter().map(|values| cell(values[place]))));
        }
    }
    let plot = |which: Discriminator| {
        let curve = |turns: &[Vec<&Tap>; 2], color| {
            let scale = shown(which).2;
            let values = averaged(turns, which).into_iter().map(|value| value.map_or(f64::NAN, |value| value * scale));
            Mark::Line(turns[0].iter().map(|tap| tap.angle_deg).zip(values).collect(), color, 1.75)
        };
        let curves = vec![curve(&both[0], COLORS[1]), curve(&both[1], COLORS[0])];
        ring_plot(title_of(which), ordinate("", &curves), curves, &shades(&both[0][0]))
    };
    let picture = Picture {
        title: "Figs. 70 and 71: both shoulders of the representative tyre".to_owned(),
        note: "Means of two turns; shades: severity of the cracks in shoulder 1, shoulder 2 has none".to_owned(),
        keys: shoulder_keys(),
        columns: 2,
        height: 140.0,
        plots: SIX.map(plot).to_vec(),
        ..Picture::default()
    };
    Figure { picture, table }
}

fn shoulder_keys() -> Vec<Key> {
    keys(["shoulder 1", "shoulder 2"].map(str::to_owned).into_iter().zip([COLORS[1], COLORS[0]]))
}

/// Figs. 73 to 75: the damage index of the three tyres.
pub(super) fn damage(experiment: &Experiment, indices: &Indices) -> Figure {
    let mut table =
        Table::long("fig73-75", "", ["tyre", "shoulder", "location", "angle_deg", "severity", "damage_index"]);
    let mut plots = Vec::new();
    let tyres = [
        (REPRESENTATIVE, "Fig. 73: representative tyre"),
        (NEW, "Fig. 74: brand-new tyre"),
        (SLIGHT, "Fig. 75: slightly damaged tyre"),
    ];
    for (tyre, title) in tyres {
        let mut curves = Vec::new();
        for (shoulder, color) in [(1, COLORS[1]), (2, COLORS[0])] {
            let turn = experiment.inspection.turn(Turn { tyre, shoulder, ..Turn::default() });
            let of_shoulder = indices.get(&(tyre.to_owned(), shoulder)).map_or(&[][..], Vec::as_slice);
            // An index has no closing tap; a curve that ends where it began is closed with its first value.
            for (tap, &index) in turn.iter().zip(of_shoulder) {
                let place = [shoulder.to_string(), tap.found.id.location.to_string(), cell(tap.angle_deg)];
                let values = [tap.severity.to_string(), cell(index)];
                table.push_texts([tyre.to_ascii_lowercase()].into_iter().chain(place).chain(values));
            }
            let values = of_shoulder.iter().chain(of_shoulder.first());
            let points = turn.iter().zip(values).map(|(tap, index)| (tap.angle_deg, index.unwrap_or(f64::NAN)));
            curves.push(Mark::Line(points.collect(), color, 1.75));
        }
        let under = shades(&experiment.inspection.turn(Turn { tyre, ..Turn::default() }));
        plots.push(ring_plot(title.to_owned(), axis("Damage index", (0.0, 1.0), 6), curves, &under));
    }
    let picture = Picture {
        title: "Figs. 73 to 75: damage index by Eqs. 55 and 56".to_owned(),
        note: "All six shoulders by the extremes of the representative tyre's shoulder 1; A₂ left out, PR rises"
            .to_owned(),
        keys: shoulder_keys(),
        columns: 1,
        height: 150.0,
        plots,
        ..Picture::default()
    };
    Figure { picture, table }
}

/// Fig. 76: the spectra of both shoulders, location by location.
pub(super) fn b_scan(experiment: &Experiment) -> Figure {
    let mut table = Table::long("fig76", "", ["shoulder", "location", "frequency_hz", "density_v2_per_hz"]);
    let mut plots = Vec::new();
    for shoulder in [1, 2] {
        let [turn, _] = experiment.repetitions(shoulder);
        let mut columns = Vec::new();
        for tap in &turn {
            let densities = &tap.density_v2_per_hz;
            for (step, density) in densities.iter().enumerate() {
                let middle_hz = BAND_HZ.0 + (step as f64 + 0.5) * STEP_HZ;
                let place = [shoulder.to_string(), tap.found.id.location.to_string(), cell(middle_hz)];
                table.push_texts(place.into_iter().chain([format!("{density:.3e}")]));
            }
            columns.push(densities.iter().map(|density| 10.0 * density.log10()).collect());
        }
        let half_deg = turn.get(1).map_or(0.0, |tap| 0.5 * tap.angle_deg);
        let edges = turn.iter().map(|tap| tap.angle_deg - half_deg).chain([360.0 + half_deg]);
        let edges: Vec<f64> = edges.map(|x| x.clamp(0.0, 360.0)).collect();
        plots.push(Plot::new(
            format!("Shoulder {shoulder}"),
            axis("Angle in degrees", (0.0, 360.0), 8),
            axis("Frequency in Hz", BAND_HZ, 6),
            vec![map(&edges, BAND_HZ, &columns)],
        ));
    }
    let colors = (0..LEVELS).map(|level| level_color(level).to_rgba()).collect();
    let [least, most] = [LEVELS_DB.0, LEVELS_DB.1].map(number);
    let picture = Picture {
        title: "Fig. 76: power spectra of the sound around the representative tyre".to_owned(),
        note: format!("Power density in steps of {} Hz, first time around", number(STEP_HZ)),
        keys: vec![Key::Patches(format!("{least} dB"), colors, format!("{most} dB re 1 V²/Hz"))],
        columns: 1,
        height: 210.0,
        plots,
        ..Picture::default()
    };
    Figure { picture, table }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a level off by one at the ends, and values beyond them without a colour.
    #[test]
    fn every_value_has_a_colour() {
        let levels = [-1e9, -90.0, -85.0, -58.1, -58.0, 0.0, f64::INFINITY].map(level);
        assert_eq!(levels, [0, 0, 1, 9, 9, 9, 9]);
    }
}
