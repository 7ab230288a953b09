//! What to mark on a casing: the regions of each shoulder, and the reasons for its verdict.

use maud::{Markup, html};
use tapline_host::messages::counted;
use tapline_store::Region;
use tapline_wire::{Discriminator, Geometry, Reasons};

use crate::config::report::ReportConfig;
use crate::report::evidence::{Evidence, Shoulder, Tyre, condition};
use crate::report::figures::sketch;
use crate::report::pages::page::verdict_word;
use crate::report::pages::words;

/// Verdict and reasons of every shoulder.
pub(crate) fn verdicts(geometry: Geometry, tyre: &Tyre) -> Markup {
    let side = words::side(geometry);
    // Remarks that apply to all are made once.
    let reasons = tyre.shoulders.iter().map(|shoulder| shoulder.reasons);
    let common = reasons.reduce(Reasons::intersection).filter(|_| tyre.shoulders.len() > 1).unwrap_or_default();
    let common = common.intersection(Reasons::REMARKS.difference(Reasons::FLAGGED));
    html! {
        div class="scroll" { table class="cards" {
            thead { tr {
                th { (side) } th { "verdict" } th { "why" } th class="n" { "strongest arc" } th class="n" { "re-inspect at" } th class="n" { "reject at" }
            } }
            tbody { @for shoulder in &tyre.shoulders { tr {
                td data-label=(side) { (shoulder.number) }
                td data-label="verdict" { (verdict_word(shoulder.verdict)) }
                td data-label="why" {
                    @if let Some(refused) = &shoulder.refused { (refused.text) ". " }
                    (words::reasons(geometry, shoulder.reasons_left().difference(common))) " "
                    @for (what, detail) in details(shoulder) { (what) ": " (detail) ". " }
                    (rests_on(shoulder))
                }
                td class="n" data-label="strongest arc" {
                    (number(shoulder.strongest_arc))
                    @if let Some(first) = shoulder.first_strongest_arc { span class="at" { "first reading " (format!("{first:.2}")) } }
                }
                td class="n" data-label="re-inspect at" { (number(shoulder.limits.map(|limits| limits.re_inspect))) }
                td class="n" data-label="reject at" { (number(shoulder.limits.map(|limits| limits.reject))) }
            } } }
        } }
        @if !common.is_empty() { p { "All " (side) "s: " (words::reasons(geometry, common)) } }
    }
}

/// Details that the reasons do not give: which flags, and how far scatter and level are off.
fn details(shoulder: &Shoulder) -> impl Iterator<Item = (&'static str, String)> {
    let all = [
        ("Flagged", Reasons::FLAGGED),
        ("Scatter", Reasons::SCATTER_OFF),
        ("Scatter", Reasons::SCATTER_LOW),
        ("Level", Reasons::LEVEL_OFF),
    ];
    let given = all.into_iter().filter(|(_, reason)| shoulder.reasons.contains(*reason));
    given.filter_map(|(what, reason)| Some((what, shoulder.whole.detail(&reason.to_string())?)))
}

/// The taps that a verdict is based on.
fn rests_on(shoulder: &Shoulder) -> String {
    let came = shoulder.taps.iter().filter(|tap| tap.found.is_some());
    let second = came.clone().filter(|tap| tap.is_second_reading).count();
    let again = if second > 0 { format!(", {second} of them a second reading") } else { String::new() };
    format!("Based on {}{again}.", counted(came.count(), "tap", "taps"))
}

/// The regions of every shoulder, as a list to take to the casing.
pub(crate) fn regions(evidence: &Evidence, tyre: &Tyre) -> Markup {
    let (geometry, printed) = (evidence.geometry, &evidence.config.report);
    let mm_per_deg = printed.tread_circumference_mm.map(|mm| mm / 360.0);
    let count: usize = tyre.shoulders.iter().map(|shoulder| shoulder.regions.len()).sum();
    html! {
        h2 { "What to mark" }
        @if count == 0 {
            p { (nothing(tyre)) }
        } @else {
            p { (counted(count, "region", "regions")) ", counted along the " (words::side(geometry)) ". " (how(tyre, printed)) }
            @if tyre.is_round() { (sketch::casing(printed.mark(), printed.side())) }
            div class="scroll" { table class="cards" {
                thead { tr {
                    th { (words::side(geometry)) } th { "region" } th { "from" } th { "to" } th { "length" } th { "worst at" } th { "offset" } th { "severity" }
                } }
                tbody { @for shoulder in &tyre.shoulders { @for region in &shoulder.regions { tr {
                    td data-label=(words::side(geometry)) { (shoulder.number) }
                    td data-label="region" { (region.region) }
                    td data-label="from" { (place(region.start_deg, mm_per_deg, region.first_location)) }
                    td data-label="to" { (place(region.end_deg, mm_per_deg, region.last_location)) }
                    td data-label="length" { (length(region, mm_per_deg)) }
                    td data-label="worst at" { (place(region.peak_angle_deg, mm_per_deg, region.peak_location)) }
                    td data-label="offset" { (offset(region)) }
                    td data-label="severity" { (severity(shoulder, region)) @if let Some(changes) = changes(evidence, tyre, shoulder, region) { span class="at wrap" { (changes) } } }
                } } } }
            } }
        }
    }
}

/// Why there is nothing to mark; only a judged shoulder can be sound.
fn nothing(tyre: &Tyre) -> &'static str {
    let judged = tyre.shoulders.iter().filter(|shoulder| shoulder.limits.is_some()).count();
    match judged {
        0 => "Not known: no location has a damage index.",
        all if all == tyre.shoulders.len() => "Nothing: no region of damage was found.",
        _ => "No region of damage was found in what has been judged; the rest is not known.",
    }
}

fn how(tyre: &Tyre, printed: &ReportConfig) -> String {
    match tyre.is_round() {
        true => format!(
            "Angles are those of the tapped locations on both shoulders, {}; the length has half a step more at each end.",
            printed.angles()
        ),
        false => "Numbers are those of the tapped locations.".to_owned(),
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "none".to_owned(), |value| format!("{value:.2}"))
}

/// The angle, the distance along the tread, and the location there; without angles only the location.
fn place(angle_deg: Option<f64>, mm_per_deg: Option<f64>, location: u32) -> Markup {
    html! {
        @match angle_deg {
            Some(deg) => {
                (format!("{deg:.1}°"))
                @if let Some(mm) = mm_per_deg { span class="at" { (format!("{:.0} mm", mm * deg)) } }
                span class="at" { "location " (location) }
            }
            None => { "location " (location) }
        }
    }
}

/// How long a region is: its locations, each with the half steps beside it.
fn length(region: &Region, mm_per_deg: Option<f64>) -> Markup {
    let locations = counted(region.extent_locations as usize, "location", "locations");
    html! {
        @match region.extent_deg {
            Some(deg) => {
                (format!("{deg:.1}°"))
                @if let Some(mm) = mm_per_deg { span class="at" { (format!("{:.0} mm", mm * deg)) } }
                span class="at" { (locations) }
            }
            None => (locations),
        }
    }
}

/// What changes most in a region, compared with the rest of the shoulder; `None` if either is unknown.
fn changes(evidence: &Evidence, tyre: &Tyre, shoulder: &Shoulder, region: &Region) -> Option<String> {
    let changes = condition::changes(&evidence.config.fuse, shoulder, tyre.condition?, region.region);
    let word = |&(which, ratio): &(Discriminator, f64)| {
        let change = match ratio {
            ratio if ratio >= 2.0 => format!("{ratio:.1} times the rest"),
            ratio if ratio >= 1.0 => format!("{:.0} % above the rest", 100.0 * (ratio - 1.0)),
            ratio => format!("{:.0} % below the rest", 100.0 * (1.0 - ratio)),
        };
        format!("{} {change}", which.printed())
    };
    let shown: Vec<String> = changes.iter().take(3).map(word).collect();
    (!shown.is_empty()).then(|| shown.join(", "))
}

/// Distance of a region from the belt edge: where it shows most, and its range.
fn offset(region: &Region) -> Markup {
    html! {
        @match region.offset_best_mm {
            Some(best_mm) => {
                (best_mm) " mm"
                @if let (Some(low_mm), Some(high_mm)) = (region.offset_low_mm, region.offset_high_mm) {
                    span class="at" { (low_mm) " to " (high_mm) " mm" }
                }
            }
            None => "unknown",
        }
    }
}

/// Severity of a region: how far its strongest arc exceeds the limits, and how probable that is on a sound
/// shoulder.
fn severity(shoulder: &Shoulder, region: &Region) -> String {
    let (Some(arc), Some(limits)) = (region.region_index, shoulder.limits) else { return "unknown".to_owned() };
    let is_damage = arc >= limits.reject && shoulder.reasons.contains(Reasons::DAMAGE);
    let word = if is_damage { "damage" } else { "suspect" };
    let times = if limits.reject > 0.0 {
        format!(", {:.2} times the reject limit", arc / limits.reject)
    } else {
        String::new()
    };
    let mean = region.mean_damage_index.map_or_else(String::new, |mean| format!(", mean index {mean:.2}"));
    let probability = match region.p_value {
        Some(p_value) if p_value < 0.001 => "; probability on a sound shoulder below 0.001".to_owned(),
        Some(p_value) => format!("; probability on a sound shoulder {p_value:.3}"),
        None => String::new(),
    };
    format!("{word}: strongest arc {arc:.2}{times}{mean}{probability}")
}
