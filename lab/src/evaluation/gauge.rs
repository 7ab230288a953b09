//! What gauge studies read, and their rows.

use crate::statistics::{Gauge, OneWay, Refusal};

use super::ShoulderResult;
use super::table::{Cell, cell};

/// What is read of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reading {
    /// A shoulder is a part, read by its strongest arc: a verdict rests on it.
    StrongestArc,
    /// A location is a part. Most are sound, and the index of a sound one is scatter in units of its own standard deviation.
    DamageIndex,
}

impl Reading {
    pub(crate) const ALL: [Self; 2] = [Self::StrongestArc, Self::DamageIndex];

    pub(crate) fn name(self) -> &'static str {
        ["shoulders by strongest arc", "locations by damage index"][self as usize]
    }

    /// The readings of a shoulder, one per part.
    pub(crate) fn of(self, shoulder: &ShoulderResult) -> Vec<f64> {
        match self {
            Self::StrongestArc => vec![shoulder.strongest_arc],
            Self::DamageIndex => shoulder.index.clone(),
        }
    }
}

/// Columns of [`crossed_cells`] and [`one_way_cells`].
pub(crate) const GAUGE_COLUMNS: [&str; 6] =
    ["repeatability_percent", "reproducibility_percent", "gauge_percent", "part_percent", "ndc", "remark"];

/// What a study with several rigs found, or why it found nothing.
pub(crate) fn crossed_cells(found: &Result<Gauge, Refusal>) -> Vec<Cell> {
    match found {
        Ok(g) => {
            let parts = [g.repeatability, g.reproducibility, g.gauge, g.part].map(|c| cell(c.study_percent));
            let remark = if g.is_pooled { "interaction pooled" } else { "" };
            parts.into_iter().chain([categories(g.ndc), remark.into()]).collect()
        }
        Err(why) => refused_cells(&why.to_string()),
    }
}

/// What a study with one rig found, or why it found nothing.
pub(crate) fn one_way_cells(found: &Result<OneWay, Refusal>) -> Vec<Cell> {
    match found {
        Ok(g) => {
            let [repeat, part] = [g.repeatability, g.part].map(|c| cell(c.study_percent));
            vec![repeat.clone(), Cell::Empty, repeat, part, categories(g.ndc), Cell::Empty]
        }
        Err(why) => refused_cells(&why.to_string()),
    }
}

/// No number, and why.
pub(crate) fn refused_cells(why: &str) -> Vec<Cell> {
    (1..GAUGE_COLUMNS.len()).map(|_| Cell::Empty).chain([why.into()]).collect()
}

fn categories(ndc: Option<u64>) -> Cell {
    ndc.map_or(Cell::Empty, Cell::Count)
}
