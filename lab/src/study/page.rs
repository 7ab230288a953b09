//! The page: the tables, and conclusions in words that depend on their numbers.

use super::Findings;
use super::draw::Picture;
use super::false_calls::FalseCalls;
use super::plans::{COMPETITOR_CASING_S, cheapest};
use super::table::{Cell, Table, cell};

const HEAD: &str = include_str!("head.md");

const NOT_SHOWN: &str = "## What is not shown

- No recorded tyre was judged. How faint a crack in rubber is, and how its sound differs, are the simulation's word.
- Every set changes one thing at a time, and cracks lie on one shoulder; damage all around, which a tyre by itself cannot
  show, is in none of them.
- Differences whose interval holds 0 are not shown by this study. Among so many comparisons, some intervals
  miss 0 by chance.
- A rate stated at one in a thousand needs thousands of independent sound shoulders to be confirmed. Here it can only be
  refuted.
- The second rig of the gauge study differs in what was chosen for it, not in what two real rigs differ in.
";

/// The page that stands beside `folder`.
pub(super) fn page(found: &Findings, pictures: &[Picture], folder: &str) -> String {
    let mut page = format!("{HEAD}\n## In short\n\n");
    for line in conclusions(found) {
        page.push_str(&format!("- {line}\n"));
    }
    page.push('\n');
    for table in found.tables.iter().filter(|table| !table.is_long) {
        page.push_str(&format!("## {}\n\n{}\n", heading(table.name), table.title));
        page.push_str(&format!("([{0}.csv]({folder}/{0}.csv))\n\n{1}\n", table.name, table.markdown()));
        for picture in pictures.iter().filter(|picture| picture.beside == table.name) {
            page.push_str(&format!("![{}]({folder}/{}.svg)\n\n", picture.title, picture.name));
        }
    }
    let long: Vec<String> =
        found.tables.iter().filter(|t| t.is_long).map(|t| format!("[{0}.csv]({folder}/{0}.csv)", t.name)).collect();
    page.push_str(&format!("Longer tables: {}.\n\n{NOT_SHOWN}", long.join(", ")));
    page
}

fn heading(name: &str) -> &'static str {
    match name {
        "sets" => "The sets",
        "default" => "The default index",
        "largest" => "Mean or largest of the conditions",
        "ways" => "Every index",
        "left_out_by_set" => "Tyre by tyre left out",
        "overlap" => "Regions",
        "false_calls" => "False calls",
        "detection" => "Probability of detection",
        "gauge" => "Repeatability and reproducibility",
        "plans_of_note" => "Plans",
        _ => "More",
    }
}

/// Names with their numbers, or that there are none.
fn listed(items: &[String]) -> String {
    if items.is_empty() { "none".to_owned() } else { items.join("; ") }
}

fn conclusions(found: &Findings) -> Vec<String> {
    let table = |name: &str| found.tables.iter().find(|table| table.name == name);
    let mut lines = Vec::new();
    if let Some(default) = table("default") {
        for (candidate, columns) in [
            ("the best discriminator alone", ["gain", "gain_low", "gain_high"]),
            ("the dissertation's index", ["over_dissertation", "over_low", "over_high"]),
        ] {
            lines.push(compared(default, candidate, columns));
        }
    }
    if let Some(largest) = table("largest") {
        lines.push(combined(largest));
    }
    if let Some(ways) = table("ways") {
        lines.extend(ranked(ways));
    }
    lines.extend(table("left_out_by_set").and_then(learned));
    lines.extend(called(&found.calls));
    lines.extend(table("detection").map(detected));
    lines.extend(table("gauge").and_then(repeated));
    lines.extend(planned(found));
    lines
}

/// Where the default index falls short of `candidate`, and where that is significant.
fn compared(default: &Table, candidate: &str, [gain, low, high]: [&str; 3]) -> String {
    let is_short = |row: &&Vec<Cell>| default.number(row, gain).is_some_and(|gain| gain < 0.0);
    let is_sure = |row: &&&Vec<Cell>| default.number(row, high).is_some_and(|high| high < 0.0);
    let text = |row: &Vec<Cell>| {
        let [gain, low, high] = [gain, low, high].map(|column| default.cell(row, column));
        format!("{} {gain} ({low} to {high})", row[0])
    };
    let rows: Vec<&Vec<Cell>> = default.rows.iter().filter(is_short).collect();
    let sure = rows.iter().filter(is_sure).count();
    let all = default.rows.len();
    format!(
        "The default index by a healthy reference is at least as good as {candidate} in {} of {all} sets. Where it is \
         worse, the difference is: {}. In {sure} of these the interval lies below 0.",
        all - rows.len(),
        listed(&rows.into_iter().map(text).collect::<Vec<_>>())
    )
}

/// Name of the default index; a test holds it to the configuration's.
const INDEX: &str = "repeatability";
/// Name of the default combination, likewise.
const COMBINE: &str = "largest";

/// Whether the largest of the conditions would serve better than their mean.
fn combined(largest: &Table) -> String {
    let count = |column: &str, is_so: fn(f64) -> bool| {
        largest.rows.iter().filter(|row| largest.number(row, column).is_some_and(is_so)).count()
    };
    let better = count("gain", |gain| gain > 0.0);
    let surely = count("gain_low", |low| low > 0.0);
    let worse = count("gain_high", |high| high < 0.0);
    format!(
        "With `combine = \"largest\"` the index `{INDEX}` is better than with `mean` in {better} of {} sets by a healthy \
         reference; in {surely} the interval lies above 0, in {worse} below.",
        largest.rows.len()
    )
}

/// Whether a row of `ways` is of the default index and combination.
fn is_default(row: &[Cell]) -> bool {
    row[1].is_text(INDEX) && row[2].is_text(COMBINE)
}

/// Which way of judging is best on average, by each reference, and where the default stands.
fn ranked(ways: &Table) -> Vec<String> {
    let mut lines = Vec::new();
    for reference in ["healthy", "labelled", "self"] {
        let rows: Vec<&Vec<Cell>> = ways.rows.iter().filter(|row| row[0].is_text(reference)).collect();
        let place = rows.iter().position(|row| is_default(row));
        let (Some(first), Some(place)) = (rows.first(), place) else { continue };
        let default = rows[place];
        lines.push(format!(
            "By the {reference} reference the best mean AUC of the sets is that of `{}` with `{}`, {} (least {}); the \
             default has {} (least {}), place {} of {}.",
            first[1],
            first[2],
            first[3],
            first[4],
            default[3],
            default[4],
            place + 1,
            rows.len()
        ));
    }
    let healthy = || ways.rows.iter().filter(|row| row[0].is_text("healthy"));
    // By how much the default falls short of the best in a column.
    let shortfall = |column: &str| {
        let best = healthy().filter_map(|row| ways.number(row, column)).max_by(f64::total_cmp)?;
        Some(best - ways.number(healthy().find(|row| is_default(row))?, column)?)
    };
    let short = shortfall("mean").zip(shortfall("least"));
    if let Some((of_mean, of_least)) = short {
        /// An AUC that nobody would pay for.
        const LITTLE: f64 = 0.01;
        lines.push(if of_mean <= LITTLE && of_least <= LITTLE {
            format!(
                "The default is `{INDEX}` with `{COMBINE}`. The study supports it: by a healthy reference none is better by \
                 more than 0.01, neither on average nor in the worst set."
            )
        } else {
            format!(
                "The default is `{INDEX}` with `{COMBINE}`. The study does not support it as the best: by a healthy reference \
                 another is better by more than 0.01, on average or in the worst set."
            )
        });
    }
    lines
}

fn learned(left_out: &Table) -> Option<String> {
    let first = left_out.rows.first()?;
    let default = left_out.rows.iter().find(|row| row[0].is_text(INDEX))?;
    Some(format!(
        "With labels, and each cracked tyre judged by all others, `{}` is best on average: {}; the default has {}.",
        first[0], first[1], default[1]
    ))
}

/// The least and the greatest rate of the default index at each stated rate, and the indices that exceed theirs.
fn called(calls: &[FalseCalls]) -> Vec<String> {
    let of_default: Vec<&FalseCalls> = calls.iter().filter(|c| c.index == tapline_fuse::IndexKind::default()).collect();
    let mut stated: Vec<f64> = of_default.iter().map(|c| c.stated).collect();
    stated.dedup_by(|a, b| a.total_cmp(b).is_eq());
    stated.sort_by(|a, b| b.total_cmp(a));
    stated.dedup_by(|a, b| a.total_cmp(b).is_eq());
    let text = |&stated: &f64| {
        let of_rate = || of_default.iter().filter(|c| c.stated.total_cmp(&stated).is_eq()).map(|c| c.rate.rate);
        let [least, most] = [of_rate().min_by(f64::total_cmp), of_rate().max_by(f64::total_cmp)];
        format!("{} stated: {} to {}", cell(stated), cell(least), cell(most))
    };
    let above = calls.iter().filter(|c| c.rate.low > c.stated).map(|c| {
        let name = c.index.name();
        format!(
            "`{name}` {} at {} stated ({} to {})",
            cell(c.rate.rate),
            cell(c.stated),
            cell(c.rate.low),
            cell(c.rate.high)
        )
    });
    let stated = listed(&stated.iter().map(text).collect::<Vec<_>>());
    vec![
        format!("False calls for each sound shoulder by the default index, over all references: {stated}."),
        format!("Significantly above the stated rate: {}.", listed(&above.collect::<Vec<_>>())),
    ]
}

fn detected(detection: &Table) -> String {
    let text = |row: &Vec<Cell>| {
        let [a90, a90_95, remark] = ["a90_mm", "a90_95_mm", "remark"].map(|column| detection.cell(row, column));
        let size = |name: &str, cell: &Cell| match cell.number() {
            Some(_) => format!("{name} {cell} mm"),
            None => format!("no {name}"),
        };
        let (sizes, bound) = (size("a90", a90), size("a90/95", a90_95));
        let why = if *remark == Cell::Empty { String::new() } else { format!(" ({remark})") };
        format!("{}, {} of {} found: {sizes}, {bound}{why}", row[0], row[3], row[2])
    };
    let rows: Vec<String> = detection.rows.iter().filter(|row| row[1].is_text("hit or miss")).map(text).collect();
    format!("Finds by hit and miss: {}.", listed(&rows))
}

fn repeated(gauge: &Table) -> Option<String> {
    let row = gauge.rows.iter().find(|row| row[0].is_text(INDEX) && row[1].number() == Some(2.0))?;
    let [percent, ndc] = ["gauge_percent", "ndc"].map(|column| gauge.cell(row, column));
    Some(format!(
        "The gauge takes {percent} % of the total standard deviation of the default index, and distinguishes {ndc} categories."
    ))
}

fn planned(found: &Findings) -> Option<String> {
    let cheap = cheapest(&found.plans)?;
    let full = found.plans.last()?;
    let best = found.plans.iter().max_by(|a, b| a.auc.total_cmp(&b.auc))?;
    let list = |values: &[f64]| values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    Some(format!(
        "The cheapest plan within 0.01 AUC of the full one ({}, {} s a shoulder) is offset {} mm, velocity {} m/s, {} \
         repetition(s): AUC {}, {} s a shoulder, {} s a casing; the competing machine takes {COMPETITOR_CASING_S} s a casing. The best \
         of all plans, chosen on the judged tyres, has {}.",
        cell(full.auc),
        cell(full.shoulder_s),
        list(&cheap.turns.offsets_mm),
        list(&cheap.turns.velocities_m_per_s),
        cheap.turns.repetitions,
        cell(cheap.auc),
        cell(cheap.shoulder_s),
        cell(2.0 * cheap.shoulder_s),
        cell(best.auc)
    ))
}

#[cfg(test)]
mod tests {
    use tapline_fuse::{Combine, IndexKind};

    /// Catches a page that calls another index the default than the program has.
    #[test]
    fn the_default_is_that_of_the_program() {
        assert_eq!((super::INDEX, super::COMBINE), (IndexKind::default().name(), Combine::default().name()));
    }
}
