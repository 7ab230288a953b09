//! `page.md`: the findings in words, and the tables with their figures.

use super::Findings;
use super::agreement::Agreement;
use super::calls::CallRate;
use super::repeats::Repeated;
use super::roc::Roc;
use super::scatter::Scatter;
use crate::evaluation::{Detection, Picture, cell, ends, page_of};

const HEAD: &str = "# Results for casings that were scanned and inspected

Made by `tapline-lab pod`. How each number is computed, and what it needs, is on tapline's page `docs/pod.md`. Where the data do not support a
number, the cell is empty and the remark says why.
";

/// The page; its files lie beside it.
pub(super) fn page(found: &Findings, pictures: &[Picture]) -> String {
    page_of(HEAD, &conclusions(found), (&found.tables, pictures), heading, "")
}

fn heading(name: &str) -> &'static str {
    match name {
        "basis" => "What the numbers rest on",
        "detection" => "Probability of detection",
        "roc" => "ROC",
        "calls" => "False calls",
        "gauge" => "Repeatability and reproducibility",
        "agreement" => "Agreement of verdicts",
        "scatter" => "Scatter below the limit",
        _ => "More",
    }
}

fn conclusions(found: &Findings) -> Vec<String> {
    let mut lines: Vec<String> = found.detections.iter().map(detected).collect();
    if lines.is_empty() {
        lines.push("No probability of detection: no crack has a size.".to_owned());
    }
    lines.extend(found.rocs.iter().filter_map(ranked));
    lines.extend(found.calls.iter().filter_map(called));
    lines.extend(found.repeated.iter().filter_map(repeated));
    lines.extend(found.agreements.first().and_then(agreed));
    lines.extend(scattered(&found.scatter));
    lines
}

fn detected(detection: &Detection) -> String {
    let sizes = detection.sizes_in_words().unwrap_or_else(|why| format!("no a90, since {why}"));
    let (found, all) = (detection.found_count(), detection.targets.len());
    format!("Regions that reach the {}: {found} of {all} cracks found; by hit/miss {sizes}.", detection.class)
}

/// An interval in words.
fn between(interval: Option<(f64, f64)>) -> String {
    let [low, high] = ends(interval);
    if interval.is_some() { format!("{low} to {high}") } else { "no interval".to_owned() }
}

fn ranked(roc: &Roc) -> Option<String> {
    let found = roc.found.map_or_else(
        || "no TPR at 5 % false calls".to_owned(),
        |found| format!("TPR at 5 % false calls {} ({})", cell(found.rate), between(found.interval)),
    );
    Some(format!("AUC of {} {} ({}); {found}.", roc.things, cell(roc.auc?), between(roc.interval)))
}

fn called(calls: &CallRate) -> Option<String> {
    let rate = calls.rate.as_ref().ok()?;
    let stated = calls.stated.map_or_else(String::new, |stated| format!(", {} stated", cell(stated)));
    let (kind, call) = (calls.kind(), calls.call.name());
    Some(format!(
        "{} of {} {kind} shoulders {call}: {} ({}){stated}.",
        calls.calls,
        calls.judged,
        cell(rate.rate),
        between(Some((rate.low, rate.high)))
    ))
}

fn repeated(repeated: &Repeated) -> Option<String> {
    let found = repeated.found.as_ref().ok()?;
    let across = if found.operators.degrees > 0 { "across stations" } else { "at one station" };
    let percent = cell(found.gauge.study_percent);
    Some(format!("The gauge takes {percent} % of the total standard deviation of {}, {across}.", repeated.quantity))
}

fn agreed(all: &Agreement) -> Option<String> {
    let rate = all.rate?;
    let (same, shoulders, interval) = (all.same_cell(), all.shoulders, between(Some((rate.low, rate.high))));
    let kappa = all.kappa.map_or_else(|| "no kappa".to_owned(), |kappa| format!("kappa {}", cell(kappa)));
    Some(format!(
        "{same} of {shoulders} shoulders that were scanned again have the same verdict in all scans ({interval}); {kappa}."
    ))
}

fn scattered(scatter: &Scatter) -> Option<String> {
    let [level, sd, distance] = [scatter.level?, scatter.sd?, scatter.distance?].map(cell);
    Some(format!(
        "The strongest arc of {} shoulders below the limit is {level} of it, and scatters by {sd} of it from scan to scan: the limit is \
         {distance} standard deviations away.",
        scatter.shoulders
    ))
}
