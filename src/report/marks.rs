//! What to mark on a casing: the regions of each shoulder, and why its verdict is what it is.

use maud::{Markup, html};
use tapline_store::Region;
use tapline_wire::Geometry;

use super::evidence::{Shoulder, Tyre};
use super::page::verdict_word;
use super::words::{self, counted};

/// Verdict and reasons of every shoulder.
pub(super) fn verdicts(geometry: Geometry, tyre: &Tyre) -> Markup {
    html! {
        div class="scroll" { table class="cards" {
            thead { tr {
                th { (words::side(geometry)) } th { "verdict" } th { "why" } th class="n" { "peak index" } th class="n" { "re-inspect at" } th class="n" { "reject at" }
            } }
            tbody { @for shoulder in &tyre.shoulders { tr {
                td data-label=(words::side(geometry)) { (shoulder.number) }
                td data-label="verdict" { (verdict_word(shoulder.verdict)) }
                td data-label="why" { @for sentence in words::reasons(shoulder.reasons) { (sentence) " " } }
                td class="n" data-label="peak index" { (number(shoulder.peak().and_then(|cell| cell.index))) }
                td class="n" data-label="re-inspect at" { (number(shoulder.limits.map(|limits| limits.re_inspect))) }
                td class="n" data-label="reject at" { (number(shoulder.limits.map(|limits| limits.reject))) }
            } } }
        } }
    }
}

/// The regions of every shoulder, as a list to take to the casing.
pub(super) fn regions(geometry: Geometry, tyre: &Tyre) -> Markup {
    let count: usize = tyre.shoulders.iter().map(|shoulder| shoulder.regions.len()).sum();
    html! {
        h2 { "What to mark" }
        @if count == 0 {
            p { (nothing(tyre)) }
        } @else {
            p { (counted(count, "region", "regions")) ", counted along the " (words::side(geometry)) ". " (how(geometry)) }
            div class="scroll" { table class="cards" {
                thead { tr {
                    th { (words::side(geometry)) } th { "region" } th { "from" } th { "to" } th { "length" } th { "worst at" } th { "severity" }
                } }
                tbody { @for shoulder in &tyre.shoulders { @for region in &shoulder.regions { tr {
                    td data-label=(words::side(geometry)) { (shoulder.number) }
                    td data-label="region" { (region.region) }
                    td data-label="from" { (place(region.start_deg, region.first_location)) }
                    td data-label="to" { (place(region.end_deg, region.last_location)) }
                    td data-label="length" { (length(region)) }
                    td data-label="worst at" { (place(region.peak_angle_deg, region.peak_location)) }
                    td data-label="severity" { (severity(shoulder, region)) }
                } } } }
            } }
        }
    }
}

/// Why there is nothing to mark: only what is judged can be sound.
fn nothing(tyre: &Tyre) -> &'static str {
    let judged = tyre.shoulders.iter().filter(|shoulder| shoulder.limits.is_some()).count();
    match judged {
        0 => "Not known: nothing has been judged yet.",
        all if all == tyre.shoulders.len() => "Nothing: no region of damage was found.",
        _ => "No region of damage was found in what has been judged; the rest is not known.",
    }
}

fn how(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => {
            "Angles are those of the tapped locations, clockwise from the start mark; the damage may reach half a step farther."
        }
        Geometry::Line => "Numbers are those of the tapped locations.",
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "none".to_owned(), |value| format!("{value:.2}"))
}

/// The angle, and the location under it; where there are no angles the location alone.
fn place(angle_deg: Option<f64>, location: u32) -> Markup {
    html! {
        @match angle_deg {
            Some(deg) => { (format!("{deg:.1}°")) span class="at" { "location " (location) } }
            None => { "location " (location) }
        }
    }
}

fn length(region: &Region) -> Markup {
    let locations = counted(region.extent_locations as usize, "location", "locations");
    html! {
        @match region.extent_deg {
            Some(deg) => { (format!("{deg:.1}°")) span class="at" { (locations) } }
            None => (locations),
        }
    }
}

/// How bad a region is: by how much its index exceeds the limits.
fn severity(shoulder: &Shoulder, region: &Region) -> String {
    let (Some(peak), Some(limits)) = (region.peak_damage_index, shoulder.limits) else { return "unknown".to_owned() };
    let word = if peak >= limits.reject { "damage" } else { "suspect" };
    if limits.reject > 0.0 {
        format!("{word}: peak index {peak:.2}, {:.1} times the reject limit", peak / limits.reject)
    } else {
        format!("{word}: peak index {peak:.2}")
    }
}
