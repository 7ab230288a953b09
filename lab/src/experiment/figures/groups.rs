//! Figs. 66 to 69: boxplots by severity and by cracked or sound, and how well taps repeat.

use tapline_draw::canvas::number;
use tapline_draw::palette::COLORS;
use tapline_wire::Discriminator;

use super::{Figure, Table, cell, shown, title_of};
use crate::experiment::SEVEN;
use crate::experiment::dataset::{Experiment, Tap};
use crate::experiment::draw::{Bar, Category, Content, Key, Picture, Plot};
use crate::experiment::tyres::SEVERE_FROM_M_PER_N;
use crate::statistics::{nor_rmse, within_over_healthy};
use tapline_draw::boxplot::BoxStats;

/// A row of a table of boxes.
fn row(which: Discriminator, group: &str, stats: &BoxStats) -> Vec<String> {
    let (low, high) = stats.whiskers;
    let numbers = [low, stats.low, stats.median, stats.high, high, stats.mean].map(cell);
    [which.column().to_owned(), group.to_owned(), stats.count.to_string()].into_iter().chain(numbers).collect()
}

fn columns(group: &'static str) -> [&'static str; 9] {
    [
        "discriminator",
        group,
        "count",
        "lower_whisker_si",
        "lower_quartile_si",
        "median_si",
        "upper_quartile_si",
        "upper_whisker_si",
        "mean_si",
    ]
}

/// Boxes of `which` over `groups` of taps, and their rows.
fn boxes(which: Discriminator, groups: &[(String, Vec<&Tap>)], table: &mut Table) -> Vec<Category> {
    let scale = shown(which).2;
    let mut categories = Vec::new();
    for ((label, taps), color) in groups.iter().zip([COLORS[0], COLORS[1], COLORS[1], COLORS[1]]) {
        let values: Vec<f64> = taps.iter().filter_map(|tap| tap.value(which)).collect();
        if let Some(stats) = BoxStats::new(&values) {
            table.push_texts(row(which, label, &stats));
        }
        let scaled: Vec<f64> = values.iter().map(|value| value * scale).collect();
        categories.extend(BoxStats::new(&scaled).map(|stats| Category { label: label.clone(), color, stats }));
    }
    categories
}

fn plot(name: String, x_label: &'static str, content: Content) -> Plot {
    Plot { name, x_label, x: (0.0, 1.0), y_label: "", y: None, content }
}

/// Figs. 66 and 67: force and sound by severity.
pub(super) fn by_severity(experiment: &Experiment) -> Figure {
    let [turn, _] = experiment.repetitions(1);
    let of = |severity: u8| turn.iter().copied().filter(|tap| tap.severity == severity).collect();
    let groups: Vec<(String, Vec<&Tap>)> = (0..=3_u8).map(|severity| (severity.to_string(), of(severity))).collect();
    let mut table = Table::long("fig66-67", "", &columns("severity"));
    let which = [Discriminator::FMax, Discriminator::Tau, Discriminator::A1, Discriminator::Pr];
    let plots = which.map(|which| {
        let categories = boxes(which, &groups, &mut table);
        plot(title_of(which), "Severity", Content::Boxes { categories, joins_means: true })
    });
    let [two, three] = SEVERE_FROM_M_PER_N.map(|compliance| number(compliance * 1e6));
    let picture = Picture {
        title: "Figs. 66 and 67: discriminators by severity of the planted crack".to_owned(),
        note: format!(
            "Representative tyre, shoulder 1, 101 taps. Severity by the compliance of the layer under the tap: 2 from {two}, \
             3 from {three} µm/N; line: means"
        ),
        keys: vec![Key::Line("sound".to_owned(), COLORS[0]), Key::Line("cracked".to_owned(), COLORS[1])],
        columns: 2,
        height: 190.0,
        plots: plots.to_vec(),
    };
    Figure { picture, table }
}

/// Fig. 68: the normalised difference of two repetitions (Eq. 54), and the scatter of a tap over that of sound locations.
pub(super) fn repeatability(experiment: &Experiment) -> Figure {
    let turns = experiment.repetitions(1);
    let mut table = Table::long("fig68", "", &["discriminator", "nor_rmse", "within_location_sd_per_healthy_sd"]);
    let (mut by_range, mut by_sd) = (Vec::new(), Vec::new());
    for which in SEVEN {
        let both = repeats(&turns, which);
        table.push_texts([which.column().to_owned(), cell(both.0), cell(both.1)]);
        for (bars, value, color) in [(&mut by_range, both.0, COLORS[0]), (&mut by_sd, both.1, COLORS[1])] {
            let label = shown(which).0.to_owned();
            bars.extend(value.map(|value| Bar { label, color, value }));
        }
    }
    let picture = Picture {
        title: "Fig. 68: difference of two repetitions".to_owned(),
        note: "Representative tyre, shoulder 1. Left: 101 pairs. Right: locations without a crack; at 1 they differ by no more than a tap scatters".to_owned(),
        keys: Vec::new(),
        columns: 2,
        height: 230.0,
        plots: vec![
            plot("Difference over the range of the data (Eq. 54)".to_owned(), "", Content::Bars(by_range)),
            plot("Scatter of a tap over that of sound locations".to_owned(), "", Content::Bars(by_sd)),
        ],
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
    let within = within_over_healthy(&values(&a), &values(&b), &vec![true; a.len()]);
    (nor_rmse(&values(first), &values(second)), within)
}

/// Fig. 69: the seven discriminators over cracks and beside them.
pub(super) fn cracked_and_sound(experiment: &Experiment) -> Figure {
    let [turn, _] = experiment.repetitions(1);
    let of = |is_cracked: bool| turn.iter().copied().filter(|tap| tap.is_cracked() == is_cracked).collect();
    let groups: Vec<(String, Vec<&Tap>)> = vec![("sound".to_owned(), of(false)), ("cracked".to_owned(), of(true))];
    let mut table = Table::long("fig69", "", &columns("place"));
    let plots = SEVEN.map(|which| {
        let categories = boxes(which, &groups, &mut table);
        plot(title_of(which), "", Content::Boxes { categories, joins_means: false })
    });
    let picture = Picture {
        title: "Fig. 69: discriminators over cracks and beside them".to_owned(),
        note: "Representative tyre, shoulder 1, 101 taps; cracked: severity 1 and above".to_owned(),
        keys: vec![Key::Line("sound".to_owned(), COLORS[0]), Key::Line("cracked".to_owned(), COLORS[1])],
        columns: 4,
        height: 190.0,
        plots: plots.to_vec(),
    };
    Figure { picture, table }
}
