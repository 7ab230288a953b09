//! What gauge studies read, and their rows.

use crate::statistics::Gauge;

use super::table::{Cell, cell};
use crate::shoulder_result::ShoulderResult;

/// What is read of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GaugedBy {
    /// A shoulder is a part, read by its strongest arc: a verdict rests on it.
    StrongestArc,
    /// A location is a part. Most are sound, and the index of a sound one is only scatter.
    DamageIndex,
}

impl GaugedBy {
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

/// Columns of [`gauge_cells`].
pub(crate) const GAUGE_COLUMNS: [&str; 6] =
    ["repeatability_percent", "reproducibility_percent", "gauge_percent", "part_percent", "ndc", "remark"];

/// What a study found, or why it found nothing. A study with one rig says nothing of reproducibility.
pub(crate) fn gauge_cells(found: &Result<Gauge, impl ToString>) -> Vec<Cell> {
    match found {
        Ok(g) => {
            let has_rigs = g.operators.degrees > 0;
            let reproducibility = cell(has_rigs.then_some(g.reproducibility.study_percent));
            let [repeatability, gauge, part] = [g.repeatability, g.gauge, g.part].map(|c| cell(c.study_percent));
            let remark = if has_rigs && g.is_pooled { "interaction pooled" } else { "" };
            let ndc = g.ndc.map_or(Cell::Empty, Cell::Count);
            vec![repeatability, reproducibility, gauge, part, ndc, remark.into()]
        }
        Err(why) => (1..GAUGE_COLUMNS.len()).map(|_| Cell::Empty).chain([why.to_string().into()]).collect(),
    }
}
