//! Figs. 63, 64, 70, 71 and 73 to 76: results around the ring.

use tapline_draw::canvas::number;
use tapline_draw::palette::COLORS;
use tapline_wire::Discriminator;

use super::{Figure, SIX, Table, around, cell, ring_plot, shades, shown, title_of};
use crate::experiment::SEVEN;
use crate::experiment::dataset::{Experiment, Tap, Turn, averaged};
use crate::experiment::draw::{Content, Curve, Key, Map, Picture, Plot};
use crate::experiment::index::Indices;
use crate::experiment::spectrum::{BAND_HZ, STEP_HZ};
use crate::experiment::tyres::{NEW, REPRESENTATIVE, SLIGHT, VELOCITY_M_PER_S};

/// Power densities, in dB re 1 V^2/Hz, of the lowest and the highest colour of the B-scan.
const LEVELS_DB: (f64, f64) = (-90.0, -58.0);

fn keys(names: [&str; 2]) -> Vec<Key> {
    let lines = names.into_iter().zip(COLORS).map(|(name, color)| Key::Line(name.to_owned(), color));
    lines.chain([Key::Severity]).collect()
}

/// Figs. 63 and 64: the seven discriminators, twice around.
pub(super) fn repetitions(experiment: &Experiment) -> Figure {
    let turns = experiment.repetitions(1);
    let columns: Vec<&str> = ["repetition", "location", "angle_deg", "severity"]
        .into_iter()
        .chain(SEVEN.map(Discriminator::column))
        .collect();
    let mut table = Table::long("fig63-64", "", &columns);
    for tap in turns.iter().flatten() {
        let id = &tap.found.id;
        let place = [id.repetition.to_string(), id.location.to_string(), cell(tap.angle_deg), tap.severity.to_string()];
        table.push_texts(place.into_iter().chain(SEVEN.map(|which| cell(tap.value(which)))));
    }
    let plot = |which: Discriminator| {
        let scaled = |tap: &Tap| tap.value(which).map(|value| value * shown(which).2);
        let curves =
            turns.iter().zip(COLORS).zip([2.0, 1.1]).map(|((t, color), width)| around(t, color, width, scaled));
        ring_plot(title_of(which), "", None, curves.collect(), shades(&turns[0]))
    };
    let picture = Picture {
        title: "Figs. 63 and 64: the discriminators, twice around".to_owned(),
        note: format!("Representative tyre, shoulder 1, 101 taps each, x = 0, {} m/s", number(VELOCITY_M_PER_S)),
        keys: keys(["first time around", "second"]),
        columns: 2,
        height: 140.0,
        plots: SEVEN.map(plot).to_vec(),
    };
    Figure { picture, table }
}

/// Figs. 70 and 71: six discriminators of both shoulders, the mean of two turns.
pub(super) fn shoulders(experiment: &Experiment) -> Figure {
    let columns: Vec<&str> =
        ["shoulder", "location", "angle_deg", "severity"].into_iter().chain(SIX.map(Discriminator::column)).collect();
    let mut table = Table::long("fig70-71", "", &columns);
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
            let points = turns[0].iter().map(|tap| tap.angle_deg).zip(values).collect();
            Curve { points, color, width: 1.75, has_dots: false }
        };
        let curves = vec![curve(&both[0], COLORS[1]), curve(&both[1], COLORS[0])];
        ring_plot(title_of(which), "", None, curves, shades(&both[0][0]))
    };
    let [blue, red, ..] = COLORS;
    let picture = Picture {
        title: "Figs. 70 and 71: both shoulders of the representative tyre".to_owned(),
        note: "Means of two turns; shades: severity of the cracks in shoulder 1, shoulder 2 has none".to_owned(),
        keys: vec![Key::Line("shoulder 1".to_owned(), red), Key::Line("shoulder 2".to_owned(), blue), Key::Severity],
        columns: 2,
        height: 140.0,
        plots: SIX.map(plot).to_vec(),
    };
    Figure { picture, table }
}

/// Figs. 73 to 75: the damage index of the three tyres.
pub(super) fn damage(experiment: &Experiment, indices: &Indices) -> Figure {
    let mut table =
        Table::long("fig73-75", "", &["tyre", "shoulder", "location", "angle_deg", "severity", "damage_index"]);
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
            curves.push(Curve { points: points.collect(), color, width: 1.75, has_dots: false });
        }
        let under = shades(&experiment.inspection.turn(Turn { tyre, ..Turn::default() }));
        plots.push(ring_plot(title.to_owned(), "Damage index", Some((0.0, 1.0)), curves, under));
    }
    let [blue, red, ..] = COLORS;
    let picture = Picture {
        title: "Figs. 73 to 75: damage index by Eqs. 55 and 56".to_owned(),
        note: "All six shoulders by the extremes of the representative tyre's shoulder 1; A₂ left out, PR rises"
            .to_owned(),
        keys: vec![Key::Line("shoulder 1".to_owned(), red), Key::Line("shoulder 2".to_owned(), blue), Key::Severity],
        columns: 1,
        height: 150.0,
        plots,
    };
    Figure { picture, table }
}

/// Fig. 76: the spectra of both shoulders, location by location.
pub(super) fn b_scan(experiment: &Experiment) -> Figure {
    let mut table = Table::long("fig76", "", &["shoulder", "location", "frequency_hz", "density_v2_per_hz"]);
    let mut plots = Vec::new();
    for shoulder in [1, 2] {
        let [turn, _] = experiment.repetitions(shoulder);
        let mut columns = Vec::new();
        for tap in &turn {
            let densities = tap.density_v2_per_hz();
            for (step, density) in densities.iter().enumerate() {
                let middle_hz = BAND_HZ.0 + (step as f64 + 0.5) * STEP_HZ;
                let place = [shoulder.to_string(), tap.found.id.location.to_string(), cell(middle_hz)];
                table.push_texts(place.into_iter().chain([format!("{density:.3e}")]));
            }
            columns.push(densities.iter().map(|density| 10.0 * density.log10()).collect());
        }
        let half_deg = turn.get(1).map_or(0.0, |tap| 0.5 * tap.angle_deg);
        let edges = turn.iter().map(|tap| tap.angle_deg - half_deg).chain([360.0 + half_deg]);
        let map = Map { x_edges: edges.map(|x| x.clamp(0.0, 360.0)).collect(), y: BAND_HZ, columns, levels: LEVELS_DB };
        plots.push(Plot {
            name: format!("Shoulder {shoulder}"),
            x_label: "Angle in degrees",
            x: (0.0, 360.0),
            y_label: "Frequency in Hz",
            y: None,
            content: Content::Map(map),
        });
    }
    let picture = Picture {
        title: "Fig. 76: power spectra of the sound around the representative tyre".to_owned(),
        note: format!("Power density in steps of {} Hz, first time around", number(STEP_HZ)),
        keys: vec![Key::Scale(format!("{} dB", number(LEVELS_DB.0)), format!("{} dB re 1 V²/Hz", number(LEVELS_DB.1)))],
        columns: 1,
        height: 210.0,
        plots,
    };
    Figure { picture, table }
}
