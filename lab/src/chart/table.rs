//! All points as one table (CSV), each with the origin of its numbers.

use anyhow::Result;

use super::panel::{Facet, Panel};
use super::point::Point;
use super::provenance::Provenance;
use crate::evaluation::{Table, rounded};

pub(crate) fn csv(panels: &[Panel], provenance: &Provenance) -> Result<String> {
    let mut rows = Vec::new();
    for panel in panels {
        for facet in &panel.facets {
            let points = facet.points.iter().zip(facet.front());
            rows.extend(points.map(|(point, on_front)| row(panel, facet, point, on_front, provenance)));
        }
    }
    let columns = rows.first().into_iter().flatten().map(|(column, _)| *column);
    let mut table = Table::long("points", "", columns);
    rows.into_iter().for_each(|row| table.push_texts(row.into_iter().map(|(_, cell)| cell)));
    table.csv()
}

/// The columns of a point, each with its cell.
fn row(panel: &Panel, facet: &Facet, point: &Point, on_front: bool, from: &Provenance) -> Vec<(&'static str, String)> {
    let flag = |is_so: bool| if is_so { "1" } else { "0" }.to_owned();
    let by_seed: Vec<String> = point.error.by_seed.iter().map(|&error| digits(error)).collect();
    let fails: Vec<String> =
        point.failures.iter().map(|f| format!("{} ({} of {})", f.case, digits(f.measured), digits(f.limit))).collect();
    let mut row = vec![
        ("panel", panel.name.to_owned()),
        ("facet", facet.name.clone()),
        ("point", point.name.clone()),
        ("label", point.label.clone()),
        ("family", facet.families.get(point.family).copied().unwrap_or_default().to_owned()),
        ("group", point.group.to_string()),
        ("cost", digits(point.cost.median)),
        ("cost_low", digits(point.cost.low)),
        ("cost_high", digits(point.cost.high)),
        ("cost_quantity", facet.cost.label.to_owned()),
        ("cost_unit", facet.cost.unit.to_owned()),
        ("error", digits(point.error.value)),
        ("error_low", digits(point.error.low)),
        ("error_high", digits(point.error.high)),
        ("error_quantity", facet.error.label.to_owned()),
        ("error_unit", facet.error.unit.to_owned()),
        ("error_by_seed", by_seed.join(" ")),
        ("is_default", flag(point.is_default)),
        ("on_front", flag(on_front)),
        ("fails", fails.join("; ")),
        ("tolerance_cost", digits(facet.tolerance.cost)),
        ("tolerance_error", digits(facet.tolerance.error)),
        ("n", point.n.to_string()),
        ("seeds", facet.seeds_in_words()),
        ("truth", facet.truth.clone()),
        ("remark", point.remark.clone()),
    ];
    let facts = from.facts.iter().filter(|fact| !fact.column.is_empty());
    row.extend(facts.map(|fact| (fact.column, fact.value.clone())));
    row
}

/// A number to six digits; an absent number or interval end is an empty cell.
fn digits(value: f64) -> String {
    if value.is_finite() { rounded(value, 6) } else { String::new() }
}
