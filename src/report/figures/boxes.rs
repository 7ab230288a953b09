//! Boxplots of cracked and sound locations, if the truth is known: how well each discriminator separates them.

use anyhow::Result;
use tapline_draw::boxplot::BoxStats;
use tapline_draw::canvas::{BLUE, VERMILLION};
use tapline_draw::stats::extent;
use tapline_wire::Discriminator;

use crate::report::evidence::condition::location_means;
use crate::report::evidence::{Evidence, Shoulder, Tyre};
use crate::report::figures::axis::Axis;
use crate::report::figures::chart::scaled;
use crate::report::figures::small::Small;

/// Half the width of a box, as a fraction of its column.
const HALF: f64 = 0.26;

/// Values of sound and of cracked locations.
struct Classes {
    sound: Vec<f64>,
    cracked: Vec<f64>,
}

/// A boxplot of each discriminator and of the index over the locations of `tyres` with known truth, each with its AUC
/// in the configured direction; empty if either class is empty.
pub(crate) fn pictures(evidence: &Evidence, tyres: &[Tyre]) -> Result<Vec<String>> {
    let mut pictures = Vec::new();
    for which in Discriminator::ALL {
        let name = which.printed();
        let (per_si, unit) = which.printed_unit(&evidence.recording.calibration);
        let classes = classes(tyres, |tyre, shoulder| {
            let means = tyre.condition.map(|condition| location_means(shoulder, condition, which)).unwrap_or_default();
            shoulder.cells.iter().map(|cell| means.get(&cell.location).map(|value| value * per_si)).collect()
        });
        pictures.extend(picture(name, &unit, &classes)?);
    }
    let index = classes(tyres, |_, shoulder| shoulder.cells.iter().map(|cell| cell.index).collect());
    pictures.extend(picture("index", "", &index)?);
    Ok(pictures)
}

fn classes(tyres: &[Tyre], values: impl Fn(&Tyre, &Shoulder) -> Vec<Option<f64>>) -> Classes {
    let mut classes = Classes { sound: Vec::new(), cracked: Vec::new() };
    for (tyre, shoulder) in tyres.iter().flat_map(|tyre| tyre.shoulders.iter().map(move |shoulder| (tyre, shoulder))) {
        for (cell, value) in shoulder.cells.iter().zip(values(tyre, shoulder)) {
            match cell.is_cracked {
                Some(true) => classes.cracked.extend(value),
                Some(false) => classes.sound.extend(value),
                None => {}
            }
        }
    }
    classes
}

fn picture(name: &str, unit: &str, classes: &Classes) -> Result<Option<String>> {
    let pooled = classes.sound.iter().chain(&classes.cracked).copied();
    let Some(extremes) = extent(pooled).filter(|_| !classes.sound.is_empty() && !classes.cracked.is_empty()) else {
        return Ok(None);
    };
    let (scale, label) = scaled(name, unit, extremes);
    let small = Small {
        title: name.to_owned(),
        label,
        columns: vec![format!("sound {}", classes.sound.len()), format!("cracked {}", classes.cracked.len())],
        y: Axis::around("", (extremes.0 * scale, extremes.1 * scale), 5),
    };
    let svg = small.svg(|chart| {
        for (x, values, color) in [(0.5, &classes.sound, BLUE), (1.5, &classes.cracked, VERMILLION)] {
            let values: Vec<f64> = values.iter().map(|value| value * scale).collect();
            if let Some(stats) = BoxStats::new(&values) {
                stats.draw(chart, (x, HALF), color)?;
            }
        }
        Ok(())
    })?;
    Ok(Some(svg))
}
