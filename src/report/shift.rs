//! The page of a shift: all tyres of an archive, the worst first.

use std::sync::Arc;

use anyhow::Result;
use maud::{Markup, html};
use tapline_fuse::Score;
use tapline_store::Reader;
use tapline_wire::{Discriminator, Verdict};

use super::evidence::{Evidence, Shoulder, Tyre};
use super::page::{self, figure, small_figure, verdict_word};
use super::scale::Scale;
use super::tyre::{boxes_words, counted};
use super::words::{self, body, side};
use super::{boxes, rounds};

/// Most tyres whose index is drawn: more would be too much for one page.
const DRAWN_MOST: usize = 60;

/// The page of the archive; `names` are the files of its tyres' pages.
pub(super) fn page(reader: &Reader, evidence: &Evidence, names: &[String]) -> Result<String> {
    let geometry = evidence.geometry;
    let mut order: Vec<(&Tyre, &String)> = evidence.tyres.iter().zip(names).collect();
    order.sort_by(|(a, _), (b, _)| {
        let peak = |tyre: &Tyre| tyre.peak().unwrap_or(f64::INFINITY);
        b.verdict().cmp(&a.verdict()).then(peak(b).total_cmp(&peak(a)))
    });
    let named: Vec<(String, &Shoulder)> = evidence
        .tyres
        .iter()
        .flat_map(|tyre| {
            tyre.shoulders.iter().map(|s| (format!("{}, {} {}", tyre.serial, side(geometry), s.number), s))
        })
        .collect();
    let refusals = reader.refusals()?;
    let refusals = counted(refusals.iter().map(|refusal| refusal.reason.as_str()));
    let taps = || evidence.tyres.iter().flat_map(Tyre::taps);
    let body = html! {
        header {
            p class="kind" { "tapline, report on a shift" }
            h1 { (evidence.archive) }
            (page::notices(evidence, &named))
            dl {
                dt { "Tapped" } dd { (page::when(taps())) }
                dt { "Verdicts" } dd {
                    @for verdict in [Verdict::Reject, Verdict::ReInspect, Verdict::Pass] {
                        (evidence.tyres.iter().filter(|tyre| tyre.verdict() == verdict).count()) " " (verdict_word(verdict)) " \u{a0} "
                    }
                }
            }
        }
        (overview(evidence, &order))
        (indices(evidence, &order)?)
        (truth(reader, evidence)?)
        section { h2 { "Taps" } (page::ledger(&named, &refusals)) }
        section { h2 { "Lineage" } (page::lineage(evidence)) }
    };
    Ok(page::page(&format!("Shift {}", evidence.archive), &body))
}

fn overview(evidence: &Evidence, order: &[(&Tyre, &String)]) -> Markup {
    let geometry = evidence.geometry;
    html! {
        h2 { "Overview" }
        div class="scroll" { table {
            thead { tr {
                th { (body(geometry)) } th { "verdict" } th { "by " (side(geometry)) } th class="n" { "regions" } th class="n" { "peak index" } th class="n" { "station" }
            } }
            tbody { @for (tyre, name) in order { tr {
                td class="tyre" { a href=(name) { (tyre.serial) } }
                td { (verdict_word(tyre.verdict())) }
                td { @for shoulder in &tyre.shoulders { (shoulder.number) ": " (shoulder.verdict) " " br; } }
                td class="n" { (tyre.shoulders.iter().map(|shoulder| shoulder.regions.len()).sum::<usize>()) }
                td class="n" { (tyre.peak().map_or_else(|| "none".to_owned(), |peak| format!("{peak:.2}"))) }
                td class="n" { (tyre.stations().iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")) }
            } } }
        } }
    }
}

fn indices(evidence: &Evidence, order: &[(&Tyre, &String)]) -> Result<Markup> {
    let geometry = evidence.geometry;
    let greatest = Scale::of(evidence).range().1;
    let mut pictures = Vec::new();
    for (tyre, _) in order.iter().take(DRAWN_MOST) {
        for shoulders in tyre.shoulders.chunks(rounds::SHOULDERS) {
            let title = format!("{} {}: {}", body(geometry), tyre.serial, tyre.verdict());
            pictures.push(rounds::index(geometry, title, shoulders, greatest)?);
        }
    }
    let what = html! {
        strong { "The damage index along every " (side(geometry)) ", all on one scale, with the limits of the verdicts." }
        " A location above the dotted black line is damage, one above the orange line is suspect; gaps are locations without value."
        @if order.len() > DRAWN_MOST { " Drawn are the " (DRAWN_MOST) " worst of " (order.len()) "." }
    };
    Ok(html! { section { h2 { "Damage index" } (figure(pictures, &what)) } })
}

fn truth(reader: &Reader, evidence: &Evidence) -> Result<Markup> {
    let pictures = boxes::pictures(evidence, &evidence.tyres)?;
    if pictures.is_empty() {
        return Ok(html! {});
    }
    // What the run says at its end; a configuration that does not fit the plan has no score.
    let records: Vec<_> = evidence.tyres.iter().flat_map(Tyre::taps).filter_map(|tap| tap.found).collect();
    let (config, plan) = (&evidence.config.fuse, reader.plan());
    let score = match &evidence.reference {
        Some(set) => Score::by_reference(config, plan, Arc::clone(set), &records),
        None => Score::of(config, plan, &records),
    };
    let score = score.ok();
    let number = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| format!("{value:.4}"));
    Ok(html! {
        section {
            h2 { "Against the truth" }
            (small_figure(pictures, &boxes_words("all that was scanned", "at the offset and velocity that tell most on each tyre's own page")))
            @if let Some(score) = score {
                p { "All taps together, every offset and velocity standardised by itself: AUC of the index " (number(score.index)) " over " (score.cracked_count) " cracked and " (score.sound_count) " sound locations; alone "
                    @for (order, (which, alone)) in Discriminator::ALL.into_iter().zip(score.discriminators).enumerate() {
                        @if order > 0 { ", " } (words::quantity(which).0) " " (number(alone))
                    } "." }
            }
        }
    })
}
