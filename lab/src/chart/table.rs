//! All points as one table (CSV), each with the origin of its numbers.

use anyhow::Result;

use super::panel::{Facet, Panel};
use super::point::Point;
use super::provenance::Provenance;

/// Columns of the table of points.
const COLUMNS: [&str; 33] = [
    "panel",
    "facet",
    "point",
    "label",
    "family",
    "group",
    "cost",
    "cost_low",
    "cost_high",
    "cost_quantity",
    "cost_unit",
    "error",
    "error_low",
    "error_high",
    "error_quantity",
    "error_unit",
    "error_by_seed",
    "is_default",
    "on_front",
    "fails",
    "tolerance_cost",
    "tolerance_error",
    "n",
    "seeds",
    "truth",
    "remark",
    "cpu",
    "vectors",
    "system",
    "build",
    "commit",
    "version",
    "date",
];

/// The points of all `panels`.
pub(crate) fn csv(panels: &[Panel], provenance: &Provenance) -> Result<String> {
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(COLUMNS)?;
    for panel in panels {
        for facet in &panel.facets {
            for (point, on_front) in facet.points.iter().zip(facet.front()) {
                out.write_record(row(panel, facet, point, on_front, provenance))?;
            }
        }
    }
    Ok(String::from_utf8(out.into_inner()?)?)
}

fn row(panel: &Panel, facet: &Facet, point: &Point, on_front: bool, from: &Provenance) -> Vec<String> {
    let flag = |is_so: bool| if is_so { "1" } else { "0" }.to_owned();
    let by_seed: Vec<String> = point.error.by_seed.iter().map(|&error| digits(error)).collect();
    let fails: Vec<String> =
        point.failures.iter().map(|f| format!("{} ({} of {})", f.case, digits(f.measured), digits(f.limit))).collect();
    vec![
        panel.name.to_owned(),
        facet.name.to_owned(),
        point.name.clone(),
        point.label.clone(),
        facet.families.get(point.family).copied().unwrap_or_default().to_owned(),
        point.group.to_string(),
        digits(point.cost.median),
        digits(point.cost.low),
        digits(point.cost.high),
        facet.cost.label.to_owned(),
        facet.cost.unit.to_owned(),
        digits(point.error.value),
        digits(point.error.low),
        digits(point.error.high),
        facet.error.label.to_owned(),
        facet.error.unit.to_owned(),
        by_seed.join(" "),
        flag(point.is_default),
        flag(on_front),
        fails.join("; "),
        digits(facet.tolerance.cost),
        digits(facet.tolerance.error),
        point.n.to_string(),
        facet.seeds_in_words(),
        facet.truth.clone(),
        point.remark.clone(),
        from.cpu.clone(),
        from.vectors.clone(),
        from.system.clone(),
        from.build.clone(),
        from.commit.clone(),
        from.version.to_owned(),
        from.date.clone(),
    ]
}

/// A number to six digits; an absent number or interval end is an empty cell.
pub(crate) fn digits(value: f64) -> String {
    if !value.is_finite() {
        return String::new();
    }
    let text = format!("{value:.5e}");
    text.parse::<f64>().map_or(text, |rounded| rounded.to_string())
}
