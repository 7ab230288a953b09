//! What is drawn of the study: ROC, indices with intervals, and probability of detection.

use crate::evaluation::{Areas, Detection, Mark, Picture, Plot, axis, keys};
use plotters::style::RGBColor;
use tapline_fuse::IndexKind;

use super::candidates::{Candidate, SingleDiscriminator, best_alone, find};
use tapline_draw::canvas::{INK, Point};
use tapline_draw::palette::COLORS;

pub(super) fn pictures(
    candidates: &[Candidate],
    alone: &[SingleDiscriminator],
    detection: &[Detection],
    sets: &[&'static str],
    seed: u64,
) -> Vec<Picture> {
    vec![roc(candidates, sets), indices(candidates, alone, sets, seed), pod(detection)]
}

fn roc(candidates: &[Candidate], sets: &[&'static str]) -> Picture {
    let shown = [
        ("healthy", IndexKind::default(), "default, healthy reference"),
        ("healthy", IndexKind::Dissertation, "dissertation, healthy"),
        ("self", IndexKind::default(), "default, self"),
        ("self", IndexKind::Dissertation, "dissertation, self"),
    ];
    let plot = |&set: &&'static str| {
        let curve = |(&(reference, index, _), color): (&(&str, IndexKind, &str), RGBColor)| {
            let candidate = find(candidates, set, reference, index)?;
            Some(Mark::Line(candidate.areas.roc_points(), color, 1.75))
        };
        Plot::new(
            set.to_owned(),
            axis("Sound locations called", (0.0, 0.5), 6),
            axis("Cracked locations called", (0.5, 1.0), 6),
            shown.iter().zip(COLORS).rev().filter_map(curve).map(cut).collect(),
        )
    };
    Picture {
        name: "roc",
        beside: "default",
        title: "Cracked against sound locations, set by set".to_owned(),
        note: "Each point is a limit on the index; tyres that took no part in the reference. The upper left quarter is shown.".to_owned(),
        keys: keys(&shown.map(|(_, _, name)| name)),
        columns: 3,
        height: 190.0,
        plots: sets.iter().map(plot).collect(),
    }
}

/// A curve with the part that lies in the quarter that is shown: false positive rate to 0.5, true positive rate from 0.5.
fn cut(mark: Mark) -> Mark {
    let Mark::Line(points, color, width) = mark else { return mark };
    let mut kept: Vec<Point> = Vec::new();
    for pair in points.windows(2) {
        let (mut a, mut b) = (pair[0], pair[1]);
        if b.1 < 0.5 || a.0 > 0.5 {
            continue;
        }
        let along = |t: f64| (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1));
        let (start, end) = (
            if a.1 < 0.5 { along((0.5 - a.1) / (b.1 - a.1)) } else { a },
            if b.0 > 0.5 { along((0.5 - a.0) / (b.0 - a.0)) } else { b },
        );
        (a, b) = (start, end);
        if kept.is_empty() {
            kept.push(a);
        }
        kept.push(b);
    }
    Mark::Line(kept, color, width)
}

fn indices(candidates: &[Candidate], alone: &[SingleDiscriminator], sets: &[&'static str], seed: u64) -> Picture {
    let references = ["healthy", "self"];
    let plot = |&set: &&'static str| {
        let mut rows = Vec::new();
        let mut marks = Vec::new();
        let mut least = 1.0;
        let mut mark = |areas: &Areas, y: f64, color: RGBColor| {
            let (Some(auc), Some((low, high))) = (areas.auc(), areas.by_tyres(seed)) else { return };
            least = if low < least { low } else { least };
            marks.push(Mark::Line(vec![(low, y), (high, y)], color, 2.0));
            marks.push(Mark::Dots(vec![(auc, y)], color, 3.5));
        };
        for index in IndexKind::ALL {
            let height = rows.len() as f64 + 0.5;
            for ((reference, color), aside) in references.into_iter().zip(COLORS).zip([-0.15, 0.15]) {
                if let Some(candidate) = find(candidates, set, reference, index) {
                    mark(&candidate.areas, height + aside, color);
                }
            }
            rows.push(index.name().to_owned());
        }
        for single in alone.iter().filter(|a| a.set == set) {
            mark(&single.areas, rows.len() as f64 + 0.5, COLORS[2]);
            rows.push(single.which.name().to_owned());
        }
        let from = ((least - 0.02) * 20.0).floor() / 20.0;
        if let Some(single) = best_alone(alone, set).and_then(|a| a.areas.auc()) {
            marks.insert(0, Mark::Line(vec![(single, 0.0), (single, rows.len() as f64)], INK, 1.25));
        }
        let best = best_alone(alone, set).map_or_else(String::new, |a| format!("; line: {} alone", a.which.name()));
        Plot { rows, ..Plot::new(format!("{set}{best}"), axis("AUC", (from, 1.0), 5), axis("", (0.0, 1.0), 0), marks) }
    };
    Picture {
        name: "indices",
        beside: "default",
        title: "Indices, and discriminators alone, on every set".to_owned(),
        note: "AUC of tyres that took no part in the reference, with 95 % intervals by whole tyres.".to_owned(),
        keys: keys(&["healthy reference", "self", "a discriminator alone, healthy reference"]),
        columns: 3,
        height: 210.0,
        plots: sets.iter().map(plot).collect(),
    }
}

fn pod(detection: &[Detection]) -> Picture {
    Picture {
        name: "pod",
        beside: "detection",
        title: "Probability of detection against the length of the crack".to_owned(),
        note: "Default index, healthy reference. Thin: lower 95 % bound. Grey: 90 %.".to_owned(),
        keys: keys(&["by hit/miss", "by response", "found", "missed"]),
        columns: 2,
        height: 240.0,
        plots: detection.iter().map(|d| d.plot("Length across the shoulder in mm", (3.0, 31.0))).collect(),
    }
}
