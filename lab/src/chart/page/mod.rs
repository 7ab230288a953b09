//! The page: one HTML file that needs no other, for a wide screen, a phone and paper; and the same for a repository, as Markdown.

use anyhow::Result;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::draw::{self, DARK_STYLE};
use super::panel::{Facet, Panel, Skipped};
use super::provenance::Provenance;
use super::words::{self, HOW_TO_READ, few_digits};
use crate::evaluation::{Cell, Table};

const STYLE: &str = include_str!("style.css");
const TITLE: &str = "tapline: speed against accuracy";

pub(crate) fn html(panels: &[Panel], skipped: &[Skipped], provenance: &Provenance) -> Result<String> {
    let figures: Vec<Markup> = panels.iter().map(panel).collect::<Result<_>>()?;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (TITLE) }
                style { (PreEscaped(STYLE)) (PreEscaped(DARK_STYLE)) }
            }
            body {
                main {
                    h1 { "Speed against accuracy" }
                    p.lead { "What each choice in tapline costs, and how wrong it is, measured in one run on one machine." }
                    nav { ul { @for panel in panels { li { a href={ "#" (panel.name) } { (panel.title) } } } } }
                    section {
                        h2 { "How to read it" }
                        @for paragraph in HOW_TO_READ { p { (paragraph) } }
                        p { a href="#defaults" { (how_many_are_off(panels)) } }
                    }
                    @for figure in &figures { (figure) }
                    (defaults(panels))
                    (origin(skipped, provenance))
                }
            }
        }
    };
    Ok(page.into_string())
}

/// How many defaults have left their fronts, in a sentence.
fn how_many_are_off(panels: &[Panel]) -> String {
    let rows = words::defaults(panels);
    let off = rows.iter().filter(|row| !row.is_on_front).count();
    format!("{off} of {} defaults have left their fronts by more than the noise.", rows.len())
}

fn defaults(panels: &[Panel]) -> Markup {
    let rows = words::defaults(panels);
    html! {
        section id="defaults" {
            h2 { "The defaults" }
            p { (how_many_are_off(panels)) }
            div.scroll { table.stacked {
                thead { tr { th { "panel" } th { "facet" } th { "default" } th { "where it stands" } } }
                tbody { @for row in &rows {
                    tr class=[(!row.is_on_front).then_some("off")] {
                        td { a href={ "#" (row.panel) } { (row.panel) } } td { (row.facet) } td { (row.default) }
                        td { (row.words) @if let Some(why) = row.why { ". Why: " (why) "." } }
                    }
                } }
            } }
        }
    }
}

fn panel(panel: &Panel) -> Result<Markup> {
    let facets: Vec<Markup> = panel.facets.iter().map(facet).collect::<Result<_>>()?;
    Ok(html! {
        section id=(panel.name) {
            h2 { (panel.title) }
            p.lead { (panel.question) }
            div.facets { @for facet in &facets { (facet) } }
            @for note in &panel.notes { p { (with_code(note)) } }
            @for facet in &panel.facets { (points(facet)) }
            @for table in &panel.tables { (other_table(table)) }
        }
    })
}

fn facet(facet: &Facet) -> Result<Markup> {
    let wide = draw::facet(facet, draw::WIDE)?;
    let narrow = draw::facet(facet, draw::NARROW)?;
    let label = format!("{}: {} against {}", facet.title, facet.error.label, facet.cost.label);
    Ok(html! {
        figure role="img" aria-label=(label) {
            div.wide { (PreEscaped(wide)) }
            div.narrow { (PreEscaped(narrow)) }
        }
    })
}

/// `text` with the parts between backticks as code.
fn with_code(text: &str) -> Markup {
    html! { @for (number, part) in text.split('`').enumerate() { @if number % 2 == 1 { code { (part) } } @else { (part) } } }
}

fn points(facet: &Facet) -> Markup {
    let front = facet.front();
    html! {
        details {
            summary { "Points: " (facet.title) }
            p { "Truth: " (facet.truth) ". Seeds: " (facet.seeds_in_words()) ". Differences of less than " (few_digits(facet.tolerance.error))
                " " (facet.error.unit) " in error, or of " (few_digits(100.0 * facet.tolerance.cost)) " % in cost, do not count." }
            div.scroll { table {
                thead { tr {
                    th { "point" } th.number { (facet.cost.words()) } th.number { "quartiles" } th.number { (facet.error.words()) }
                    th.number { "95 %" } th.number { "n" } th { "remark" }
                } }
                tbody { @for (point, on_front) in facet.points.iter().zip(front) {
                    tr {
                        td { (point.name) @if point.is_default { " " b { "(default)" } } @if on_front { " \u{25c6}" } }
                        td.number { (few_digits(point.cost.median)) }
                        td.number { (few_digits(point.cost.low)) " to " (few_digits(point.cost.high)) }
                        td.number { (few_digits(point.error.value)) }
                        td.number { (few_digits(point.error.low)) " to " (few_digits(point.error.high)) }
                        td.number { (point.n) }
                        td { (point.remark)
                            @for failure in &point.failures {
                                div { "fails: " (failure.case) ": " (few_digits(failure.measured)) ", limit " (few_digits(failure.limit)) }
                            }
                        }
                    }
                } }
            } }
            p.small { "\u{25c6} on the front" }
        }
    }
}

fn other_table(table: &Table) -> Markup {
    html! {
        details open[!table.is_long] {
            summary { (table.title) }
            div.scroll { table {
                thead { tr { @for column in &table.columns { th { (column.replace('_', " ")) } } } }
                tbody { @for row in &table.rows { tr { @for cell in row { (table_cell(cell)) } } } }
            } }
        }
    }
}

fn table_cell(cell: &Cell) -> Markup {
    html! { @if let Cell::Text(text) = cell { td { (text) } } @else { td.number { (cell) } } }
}

fn origin(skipped: &[Skipped], from: &Provenance) -> Markup {
    html! {
        section {
            h2 { "Where the numbers are from" }
            div.scroll { table.plain { tbody {
                @for fact in &from.facts { tr { th { (fact.name) } td { (fact.value) } } }
            } } }
            @for skipped in skipped { p { b { "Left out: " } (skipped.panel) ": " (skipped.why) } }
            p { "All points, with the same of each: " a href="points.csv" { "points.csv" } "." }
        }
    }
}

/// The page of a repository.
pub(crate) fn markdown(panels: &[Panel], skipped: &[Skipped], provenance: &Provenance) -> String {
    let mut page = String::from(
        "# Speed against accuracy\n\nWhat each choice in tapline costs, and how wrong it is. `tapline-lab chart --force` measures all of it in one run on \
         one machine, and draws this page. [index.html](index.html) is this page with every number, for a screen, a phone or paper. \
         [points.csv](points.csv) has all points.\n\n## How to read it\n",
    );
    for paragraph in HOW_TO_READ {
        page.push_str(&format!("\n{paragraph}\n"));
    }
    page.push_str(&format!("\n[{}](#the-defaults)\n", how_many_are_off(panels)));
    for panel in panels {
        page.push_str(&format!("\n## {}\n\n{}\n\n{}\n", panel.title, panel.question, picture(panel)));
        for note in &panel.notes {
            page.push_str(&format!("\n{note}\n"));
        }
        for table in &panel.tables {
            page.push_str(&format!("\n{} ([{1}.csv]({1}.csv))\n\n{2}", table.title, table.name, table.markdown()));
        }
    }
    page.push_str("\n## The defaults\n\n| panel | facet | default | where it stands |\n|---|---|---|---|\n");
    for row in words::defaults(panels) {
        let why = row.why.map(|why| format!(". Why: {why}.")).unwrap_or_default();
        let words = if row.is_on_front { row.words } else { format!("**{}**{why}", row.words) };
        page.push_str(&format!("| {} | {} | {} | {words} |\n", row.panel, row.facet, row.default));
    }
    page.push_str("\n## Where the numbers are from\n\n| | |\n|---|---|\n");
    for fact in &provenance.facts {
        page.push_str(&format!("| {} | {} |\n", fact.name, fact.value));
    }
    for skipped in skipped {
        page.push_str(&format!("\n**Left out:** {}: {}\n", skipped.panel, skipped.why));
    }
    page
}

/// A picture, narrow on a phone.
fn picture(panel: &Panel) -> String {
    format!(
        "<picture><source media=\"(max-width: 700px)\" srcset=\"{0}-narrow.svg\"><img src=\"{0}.svg\" alt=\"{1}\"></picture>",
        panel.name, panel.title
    )
}
