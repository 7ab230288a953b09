//! What is drawn: probability of detection, responses against size, and ROC curves.

use crate::evaluation::{Detection, FALSE_ALARMS, Mark, Picture, Plot, axis, keys};
use tapline_draw::canvas::{PALE_INK, Point};
use tapline_draw::palette::COLORS;
use tapline_draw::stats::extent;

use super::Findings;
use super::roc::Roc;

/// What the size of a crack is, on axes.
const SIZE: &str = "Size of the crack in mm";

/// Those that the data support.
pub(super) fn pictures(found: &Findings) -> Vec<Picture> {
    let mut pictures = Vec::new();
    if !found.detections.is_empty() {
        pictures.push(pod(&found.detections));
        pictures.push(responses(&found.detections));
    }
    if found.rocs.iter().any(|roc| roc.auc.is_some()) {
        pictures.push(roc(&found.rocs));
    }
    pictures
}

/// Sizes from a tenth below the least to a tenth above the greatest.
fn sizes(detection: &Detection) -> Point {
    let (low, high) = extent(detection.targets.iter().map(|target| target.size_mm)).unwrap_or((1.0, 1.0));
    (0.9 * low, 1.1 * high)
}

fn pod(detections: &[Detection]) -> Picture {
    Picture {
        name: "pod",
        beside: "detection",
        title: "Probability of detection against the size of the crack".to_owned(),
        note: "Each crack of casings that were scanned and inspected. Thin: lower 95 % bound. Grey: 90 %.".to_owned(),
        keys: keys(&["by hit/miss", "by response", "found", "missed"]),
        columns: 2,
        height: 240.0,
        plots: detections.iter().map(|detection| detection.plot(SIZE, sizes(detection))).collect(),
    }
}

fn responses(detections: &[Detection]) -> Picture {
    let plot = |detection: &Detection| {
        let (low, high) = sizes(detection);
        let at = |found: bool| -> Vec<Point> {
            let targets = detection.targets.iter().filter(|target| target.is_found == found);
            targets.map(|target| (target.size_mm, target.response)).collect()
        };
        let responses = detection.targets.iter().map(|target| target.response);
        let (least, most) = extent(responses.chain([0.0, 1.0])).unwrap_or((0.0, 1.0));
        let mut marks = vec![Mark::Line(vec![(low, 1.0), (high, 1.0)], PALE_INK, 1.0)];
        let mut name = detection.class.clone();
        match &detection.a_hat {
            Ok(fit) => {
                let sizes = (0..=110_u32).map(|k| low + (high - low) * f64::from(k) / 110.0);
                marks.push(Mark::Line(
                    sizes.map(|x| (x, fit.intercept + fit.slope * x.ln())).collect(),
                    COLORS[1],
                    2.25,
                ));
            }
            Err(_) => name.push_str(": no line"),
        }
        marks.extend([Mark::Rings(at(true), COLORS[2], 2.5), Mark::Rings(at(false), COLORS[3], 2.5)]);
        let y = axis("Damage index over the limit", (least - 0.1, 1.1 * most), 6);
        Plot::new(name, axis(SIZE, (low, high), 8), y, marks)
    };
    let mut keys = keys(&["", "line in ln(size)", "found", "missed"]);
    keys.remove(0);
    Picture {
        name: "a_hat",
        beside: "detection",
        title: "Response against the size of the crack".to_owned(),
        note: "Greatest damage index along each crack over the limit of its shoulder. Grey: the limit.".to_owned(),
        keys,
        columns: 2,
        height: 240.0,
        plots: detections.iter().map(plot).collect(),
    }
}

fn roc(rocs: &[Roc]) -> Picture {
    let plot = |roc: &Roc| {
        let marks = vec![
            Mark::Line(vec![(FALSE_ALARMS, 0.0), (FALSE_ALARMS, 1.0)], PALE_INK, 1.0),
            Mark::Line(roc.areas.roc_points(), COLORS[0], 1.75),
        ];
        let (x, y) = (axis("Sound ones called", (0.0, 1.0), 6), axis("Cracked ones called", (0.0, 1.05), 6));
        Plot::new(roc.things.to_owned(), x, y, marks)
    };
    Picture {
        name: "roc",
        beside: "roc",
        title: "Cracked against sound ones that are called".to_owned(),
        note: "Each point is a limit. Grey: 5 % false calls.".to_owned(),
        keys: Vec::new(),
        columns: 2,
        height: 240.0,
        plots: rocs.iter().filter(|roc| roc.auc.is_some()).map(plot).collect(),
    }
}
