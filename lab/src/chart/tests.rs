//! The committed atlas is whole and readable, and its defaults are on their fronts.

use std::collections::BTreeMap;
use std::path::Path;

use tapline_testing::documents::{csv_rows, docs, text};

use super::front::{Optimality, Tolerance, optimality};
use super::off::{self, OFF, Off};
use super::panel::Facet;
use super::panels::{Entry, PANELS};
use super::point::{Cost, Error, Failure, Point};
use super::{Bench, ChartArgs};

/// Panels whose errors are computed again: they take seconds, and depend on the seeds alone.
const AGAIN: [&str; 4] = ["spectrum", "force", "contact", "codecs"];

/// A facet as the table has it.
#[derive(Debug)]
struct Committed {
    tolerance: Tolerance,
    points: Vec<Point>,
}

/// The facets of the committed table, by panel and facet.
fn committed() -> BTreeMap<(String, String), Committed> {
    let mut facets: BTreeMap<(String, String), Committed> = BTreeMap::new();
    for row in csv_rows(&text(&docs("atlas/points.csv"))) {
        let number = |column: &str| row[column].parse().unwrap_or(f64::NAN);
        let cost = Cost { median: number("cost"), low: number("cost_low"), high: number("cost_high") };
        let by_seed = row["error_by_seed"].split_whitespace().map(|x| x.parse().unwrap_or(f64::NAN)).collect();
        let error = Error { value: number("error"), low: number("error_low"), high: number("error_high"), by_seed };
        let failing = Failure { case: "a limit", measured: 1.0, limit: 0.0 };
        let point = Point::new(&row["point"], &row["label"], cost, error, row["n"].parse().unwrap())
            .group(row["group"].parse().unwrap())
            .default_if(row["is_default"] == "1")
            .failing(if row["fails"].is_empty() { Vec::new() } else { vec![failing] });
        let tolerance = Tolerance { cost: number("tolerance_cost"), error: number("tolerance_error") };
        let key = (row["panel"].clone(), row["facet"].clone());
        facets.entry(key).or_insert_with(|| Committed { tolerance, points: Vec::new() }).points.push(point);
    }
    facets
}

/// Catches a default that is off its front in the committed atlas without a known reason, and one wrongly listed as off.
#[test]
fn defaults_are_on_their_fronts() {
    let mut off = Vec::new();
    for ((panel, facet), of) in committed() {
        for default in of.points.iter().filter(|point| point.is_default) {
            if optimality(default, &of.points, of.tolerance) != Optimality::OnFront {
                off.push((panel.clone(), facet.clone()));
            }
        }
    }
    let known: Vec<_> = OFF.iter().map(|off| (off.panel, off.facet)).collect();
    let off: Vec<_> = off.iter().map(|(panel, facet)| (panel.as_str(), facet.as_str())).collect();
    for of in &off {
        assert!(known.contains(of), "{of:?} has left its front: change the default, or say why not");
    }
    for of in &known {
        assert!(off.contains(of), "{of:?} is on its front again: remove its entry");
    }
    let page = text(&docs("atlas/README.md"));
    for Off { panel, facet, why } in &OFF {
        assert!(
            page.contains(&format!("Why: {why}.")),
            "the page does not say why the default of {panel}, {facet} is off"
        );
    }
}

fn quick_bench(wanted: &[&Entry]) -> Bench {
    let recordings = tapline_testing::shared("").unwrap_or_default();
    let force = tapline_host::arguments::ForceArgs::default();
    Bench::new(&ChartArgs { out: None, seed: 1, quick: true, panel: Vec::new(), recordings, force }, wanted)
}

/// Catches a kernel change that takes a default off its front, or a rival ahead of it, while the atlas was not redrawn: errors are
/// measured, and costs are the committed ones, so that a busy machine changes nothing. Few taps are measured: three times the
/// tolerance is allowed.
#[test]
fn errors_measured_anew_leave_defaults_on_their_fronts() {
    let committed = committed();
    let wanted: Vec<&Entry> = PANELS.iter().filter(|entry| AGAIN.contains(&entry.name)).collect();
    let bench = quick_bench(&wanted);
    for entry in wanted {
        let panel = (entry.measure)(&bench).unwrap();
        for Facet { name, points, tolerance, .. } in &panel.facets {
            let known = &committed[&(entry.name.to_owned(), name.clone())];
            let with_known_costs: Vec<Point> = (points.iter())
                .map(|point| {
                    let of = known.points.iter().find(|known| known.name == point.name && known.group == point.group);
                    Point {
                        cost: of.unwrap_or_else(|| panic!("{name}: {} is not in the atlas", point.name)).cost,
                        ..point.clone()
                    }
                })
                .collect();
            assert_eq!(points.len(), known.points.len(), "{name}: a point of the atlas is gone");
            let defaults = |points: &[Point]| -> Vec<String> {
                points.iter().filter(|point| point.is_default).map(|point| point.name.clone()).collect()
            };
            assert_eq!(defaults(points), defaults(&known.points), "{name}: the atlas marks another default");
            // A wider tolerance demands more of a better rival, less of a cheaper one: both must beat the default.
            let cost = 2.0 * tolerance.cost;
            let both = [tolerance.error, 3.0 * tolerance.error].map(|error| Tolerance { cost, error });
            for default in with_known_costs.iter().filter(|point| point.is_default) {
                let is_known = off::why(entry.name, name).is_some();
                let now = both.map(|tolerance| optimality(default, &with_known_costs, tolerance));
                assert!(is_known || now.contains(&Optimality::OnFront), "{name}: {}: {now:?}", default.name);
            }
        }
    }
}

/// Catches a page that needs another file, has letters below 12 pixels, or lacks a panel or a picture; and a table whose rows do not say
/// where they are from.
#[test]
fn the_committed_atlas_is_whole() {
    let page = text(&docs("atlas/index.html"));
    for outside in ["<script", "<link", "src=", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(
        page.contains("width=device-width")
            && page.contains("prefers-color-scheme: dark")
            && page.contains("@media print")
    );
    for Entry { name, .. } in &PANELS {
        assert!(page.contains(&format!("<section id=\"{name}\">")), "{name}");
        for file in [format!("{name}.svg"), format!("{name}-narrow.svg")] {
            let svg = text(&docs(&format!("atlas/{file}")));
            assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{file}");
            let sizes: Vec<f64> = svg
                .split("font-size=\"")
                .skip(1)
                .map(|rest| rest.split('"').next().unwrap().parse().unwrap())
                .collect();
            // Four units are a pixel.
            assert!(!sizes.is_empty() && sizes.iter().all(|size| *size >= 4.0 * 12.0 - 0.2), "{file}: {sizes:?}");
        }
    }
    for row in csv_rows(&text(&docs("atlas/points.csv"))) {
        for column in
            ["cpu", "build", "commit", "date", "n", "seeds", "truth", "cost", "cost_quantity", "error_quantity"]
        {
            // Recorded taps have no seed.
            let is_due = column != "seeds" || row["panel"] != "slabs";
            assert!(!is_due || !row[column].is_empty(), "{column}: {row:?}");
        }
        assert_ne!(row["commit"], "unknown");
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/atlas");
    assert!(std::fs::read_dir(folder).unwrap().count() >= 3 + 2 * PANELS.len());
}
