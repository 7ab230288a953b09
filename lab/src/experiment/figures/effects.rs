//! Figs. 60 to 62: effects of the location and the velocity of impact.

use tapline_draw::canvas::number;
use tapline_draw::palette::COLORS;
use tapline_wire::Discriminator;

use super::{Figure, Key, Mark, Picture, Plot, Table, around, axis, cell, keys, ordinate, ring_plot, shades};
use crate::experiment::dataset::{Experiment, Tap};
use crate::experiment::tyres::{CRACKED_SPOT, SLOWEST_M_PER_S, SOUND_SPOT, VELOCITY_M_PER_S};

/// Fig. 60: the peak of the sound at four offsets.
pub(super) fn of_offset(experiment: &Experiment) -> Figure {
    let turns = experiment.offset_turns();
    let mut table = Table::long("fig60", "", ["offset_mm", "location", "angle_deg", "severity", "peak_sound_v"]);
    for (offset_mm, turn) in &turns {
        for tap in turn {
            let place = [cell(*offset_mm), tap.found.id.location.to_string(), cell(tap.angle_deg)];
            table.push_texts(place.into_iter().chain([tap.severity.to_string(), cell(tap.peak_v)]));
        }
    }
    let curves: Vec<Mark> =
        turns.iter().zip(COLORS).map(|((_, turn), color)| around(turn, color, 1.75, |tap| Some(tap.peak_v))).collect();
    let lines = turns.iter().zip(COLORS).map(|((x_mm, _), color)| (format!("x = {} mm", number(*x_mm)), color));
    let under = turns.first().map_or_else(Vec::new, |(_, turn)| shades(turn));
    let picture = Picture {
        title: "Fig. 60: peak of the sound, by location of impact".to_owned(),
        note: format!("Representative tyre, shoulder 1, {} m/s; shades: severity at x = 0", number(VELOCITY_M_PER_S)),
        keys: keys(lines),
        columns: 1,
        height: 300.0,
        plots: vec![ring_plot(String::new(), ordinate("Peak in V", &curves), curves, &under)],
        ..Picture::default()
    };
    Figure { picture, table }
}

/// Fig. 61: contact time against velocity at one place.
pub(super) fn of_velocity_at_one_place(experiment: &Experiment) -> Figure {
    let dataset = &experiment.at_one_place;
    let mut table = Table::long("fig61", "", ["place", "velocity_m_per_s", "repetition", "tau_s"]);
    let (mut curves, mut keys) = (Vec::new(), Vec::new());
    for ((tyre, name), color) in [(SOUND_SPOT, "sound"), (CRACKED_SPOT, "cracked")].into_iter().zip(COLORS) {
        let here: Vec<&Tap> = dataset.taps.iter().filter(|tap| tap.found.id.tyre.as_str() == tyre).collect();
        let mut points = Vec::new();
        for tap in &here {
            let (velocity_m_per_s, tau_s) = (tap.found.id.velocity_m_per_s(), tap.value(Discriminator::Tau));
            let cells = [name.to_owned(), cell(velocity_m_per_s), tap.found.id.repetition.to_string(), cell(tau_s)];
            table.push_texts(cells);
            points.extend(velocity_m_per_s.zip(tau_s).map(|(v, tau_s)| (v, tau_s * 1e3)));
        }
        // V^-0.2 (Eq. 20 with the contact of Hertz), through the mean of what was measured.
        let scales: Vec<f64> = points.iter().map(|(v, tau_ms)| tau_ms * v.powf(0.2)).collect();
        let scale = tapline_draw::stats::mean(&scales).unwrap_or(f64::NAN);
        let law = (0..=34).map(|k| 1.0 + 0.05 * f64::from(k)).map(|v| (v, scale * v.powf(-0.2))).collect();
        curves.extend([Mark::Line(law, color, 1.25), Mark::Dots(points, color, 2.2)]);
        keys.push(Key::Line(format!("{name} place; line: V to the power −0.2"), color));
    }
    let y = ordinate("Contact time in ms", &curves);
    let plot = Plot::new(String::new(), axis("Impact velocity in m/s", (0.95, 2.75), 14), y, curves);
    let picture = Picture {
        title: "Fig. 61: contact time against velocity at one place".to_owned(),
        note: format!("Lowest velocity V₀ = {} m/s; ten taps at each; crack 6 mm deep", number(SLOWEST_M_PER_S)),
        keys,
        columns: 1,
        height: 300.0,
        plots: vec![plot],
        ..Picture::default()
    };
    Figure { picture, table }
}

/// Fig. 62: contact time and peak of the sound at three velocities.
pub(super) fn of_velocity(experiment: &Experiment) -> Figure {
    let turns = experiment.velocity_turns();
    let columns = ["velocity_m_per_s", "location", "angle_deg", "severity", "tau_s", "peak_sound_v"];
    let mut table = Table::long("fig62", "", columns);
    for (velocity_m_per_s, turn) in &turns {
        for tap in turn {
            let place = [cell(*velocity_m_per_s), tap.found.id.location.to_string(), cell(tap.angle_deg)];
            let values = [tap.severity.to_string(), cell(tap.value(Discriminator::Tau)), cell(tap.peak_v)];
            table.push_texts(place.into_iter().chain(values));
        }
    }
    let curves = |value: &dyn Fn(&Tap) -> Option<f64>| -> Vec<Mark> {
        turns.iter().zip(COLORS).map(|((_, turn), color)| around(turn, color, 1.75, value)).collect()
    };
    let tau_ms = |tap: &Tap| tap.value(Discriminator::Tau).map(|tau_s| tau_s * 1e3);
    let under = turns.first().map_or_else(Vec::new, |(_, turn)| shades(turn));
    let plot = |name: &str, label: &str, value: &dyn Fn(&Tap) -> Option<f64>| {
        let curves = curves(value);
        ring_plot(name.to_owned(), ordinate(label, &curves), curves, &under)
    };
    let picture = Picture {
        title: "Fig. 62: contact time and peak of the sound, by velocity of impact".to_owned(),
        note: "Representative tyre, shoulder 1, x = 0".to_owned(),
        keys: keys(turns.iter().zip(COLORS).map(|((v, _), color)| (format!("{} m/s", number(*v)), color))),
        columns: 1,
        height: 210.0,
        plots: vec![
            plot("Contact time", "τ in ms", &tau_ms),
            plot("Peak of the sound", "Peak in V", &|tap| Some(tap.peak_v)),
        ],
        ..Picture::default()
    };
    Figure { picture, table }
}
