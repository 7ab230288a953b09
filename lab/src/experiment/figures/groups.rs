//! Figs. 66 to 69: boxplots by severity and by cracked or sound, and how well taps repeat.

use plotters::style::{Color as _, RGBColor};
use tapline_draw::boxplot::BoxStats;
use tapline_draw::canvas::{INK, number};
use tapline_draw::palette::COLORS;
use tapline_wire::Discriminator;

use super::{Figure, Mark, Picture, Plot, Table, axis, cell, shown, spanned, title_of};
use crate::evaluation::{HALF_BOX, keys};
use crate::experiment::SEVEN;
use crate::experiment::dataset::{Experiment, Tap};
use crate::experiment::tyres::SEVERE_FROM_M_PER_N;
use crate::statistics::{nor_rmse, within_over_all};

fn row(which: Discriminator, group: &str, stats: &BoxStats) -> Vec<String> {
    let (low, high) = stats.whiskers;
    let numbers = [low, stats.low, stats.median, stats.high, high, stats.mean].map(cell);
    [which.column().to_owned(), group.to_owned(), stats.count.to_string()].into_iter().chain(numbers).collect()
}

/// Columns of a table of boxes after the discriminator and the group.
const COLUMNS: &str = "count lower_whisker_si lower_quartile_si median_si upper_quartile_si upper_whisker_si mean_si";

fn table(name: &'static str, group: &'static str) -> Table {
    Table::long(name, "", ["discriminator", group].into_iter().chain(COLUMNS.split(' ')))
}

/// Boxes of `which` over `groups` of taps, with their means joined if asked for; their rows go into `table`.
fn boxes(
    which: Discriminator,
    groups: &[(String, Vec<&Tap>)],
    (x_label, joins_means): (&str, bool),
    table: &mut Table,
) -> Plot {
    let scale = shown(which).2;
    let (mut columns, mut marks, mut means, mut all) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for ((label, taps), color) in groups.iter().zip([COLORS[0], COLORS[1], COLORS[1], COLORS[1]]) {
        let values: Vec<f64> = taps.iter().filter_map(|tap| tap.value(which)).collect();
        let scaled: Vec<f64> = values.iter().map(|value| value * scale).collect();
        if let Some((of_table, stats)) = BoxStats::new(&values).zip(BoxStats::new(&scaled)) {
            table.push_texts(row(which, label, &of_table));
            let x = columns.len() as f64 + 0.5;
            columns.push(label.clone());
            means.push((x, stats.mean));
            marks.push(Mark::Box(x, stats, color));
        }
        all.extend(scaled);
    }
    if joins_means {
        marks.extend([Mark::Line(means.clone(), INK, 1.5), Mark::Dots(means, INK, 3.0)]);
    }
    Plot { columns, ..Plot::new(title_of(which), axis(x_label, (0.0, 1.0), 0), axis("", spanned(all), 6), marks) }
}

fn bars(name: &str, values: &[(&str, f64)], color: RGBColor) -> Plot {
    let most = values.iter().map(|(_, value)| *value).max_by(f64::total_cmp).unwrap_or(1.0);
    let bar = |(k, (_, value)): (usize, &(&str, f64))| {
        let x = k as f64 + 0.5;
        Mark::Filled([(x - HALF_BOX, 0.0), (x + HALF_BOX, *value)], color.to_rgba())
    };
    Plot {
        columns: values.iter().map(|(label, _)| (*label).to_owned()).collect(),
        ..Plot::new(
            name.to_owned(),
            axis("", (0.0, 1.0), 0),
            axis("", (0.0, 1.12 * most), 6),
            values.iter().enumerate().map(bar).collect(),
        )
    }
}

/// Figs. 66 and 67: force and sound by severity.
pub(super) fn by_severity(experiment: &Experiment) -> Figure {
    let [turn, _] = experiment.repetitions(1);
    let of = |severity: u8| turn.iter().copied().filter(|tap| tap.severity == severity).collect();
    let groups: Vec<(String, Vec<&Tap>)> = (0..=3_u8).map(|severity| (severity.to_string(), of(severity))).collect();
    let mut table = table("fig66-67", "severity");
    let which = [Discriminator::FMax, Discriminator::Tau, Discriminator::A1, Discriminator::Pr];
    let plots = which.map(|which| boxes(which, &groups, ("Severity", true), &mut table));
    let [two, three] = SEVERE_FROM_M_PER_N.map(|compliance| number(compliance * 1e6));
    let picture = Picture {
        title: "Figs. 66 and 67: discriminators by severity of the planted crack".to_owned(),
        note: format!(
            "Representative tyre, shoulder 1, 101 taps. Severity by the compliance of the layer under the tap: 2 from {two}, \
             3 from {three} µm/N; line: means"
        ),
        keys: keys(&["sound", "cracked"]),
        columns: 2,
        height: 190.0,
        plots: plots.to_vec(),
        ..Picture::default()
    };
    Figure { picture, table }
}

/// Fig. 68: the normalised difference of two repetitions (Eq. 54), and the scatter of a tap over that of sound locations.
pub(super) fn repeatability(experiment: &Experiment) -> Figure {
    let turns = experiment.repetitions(1);
    let mut table = Table::long("fig68", "", ["discriminator", "nor_rmse", "within_location_sd_per_healthy_sd"]);
    let (mut by_range, mut by_sd) = (Vec::new(), Vec::new());
    for which in SEVEN {
        let both = repeats(&turns, which);
        table.push_texts([which.column().to_owned(), cell(both.0), cell(both.1)]);
        by_range.extend(both.0.map(|value| (shown(which).0, value)));
        by_sd.extend(both.1.map(|value| (shown(which).0, value)));
    }
    let picture = Picture {
        title: "Fig. 68: difference of two repetitions".to_owned(),
        note: "Representative tyre, shoulder 1. Left: 101 pairs. Right: locations without a crack; at 1 they differ by no more than a tap scatters".to_owned(),
        columns: 2,
        height: 230.0,
        plots: vec![
            bars("Difference over the range of the data (Eq. 54)", &by_range, COLORS[0]),
            bars("Scatter of a tap over that of sound locations", &by_sd, COLORS[1]),
        ],
        ..Picture::default()
    };
    Figure { picture, table }
}

/// Nor_RMSE of two turns (Eq. 54); and, for the sound locations, the ratio of two standard deviations: that within a
/// location over that of all locations.
pub(in crate::experiment) fn repeats(turns: &[Vec<&Tap>; 2], which: Discriminator) -> (Option<f64>, Option<f64>) {
    let [first, second] = turns;
    let is_sound = |pair: &(&&Tap, &&Tap)| !pair.0.is_cracked();
    let (a, b): (Vec<&Tap>, Vec<&Tap>) = first.iter().zip(second).filter(is_sound).map(|(a, b)| (*a, *b)).unzip();
    let values = |turn: &[&Tap]| -> Vec<Option<f64>> { turn.iter().map(|tap| tap.value(which)).collect() };
    (nor_rmse(&values(first), &values(second)), within_over_all(&values(&a), &values(&b)))
}

/// Fig. 69: the seven discriminators over cracks and beside them.
pub(super) fn cracked_and_sound(experiment: &Experiment) -> Figure {
    let [turn, _] = experiment.repetitions(1);
    let of = |is_cracked: bool| turn.iter().copied().filter(|tap| tap.is_cracked() == is_cracked).collect();
    let groups: Vec<(String, Vec<&Tap>)> = vec![("sound".to_owned(), of(false)), ("cracked".to_owned(), of(true))];
    let mut table = table("fig69", "place");
    let plots = SEVEN.map(|which| boxes(which, &groups, ("", false), &mut table));
    let picture = Picture {
        title: "Fig. 69: discriminators over cracks and beside them".to_owned(),
        note: "Representative tyre, shoulder 1, 101 taps; cracked: severity 1 and above".to_owned(),
        keys: keys(&["sound", "cracked"]),
        columns: 4,
        height: 190.0,
        plots: plots.to_vec(),
        ..Picture::default()
    };
    Figure { picture, table }
}
