//! The page: the tables, and conclusions in words that depend on their numbers.

use crate::evaluation::{Call, Detection, GaugedBy, Picture, cell, ends, page_of};
use tapline_draw::stats::extent;
use tapline_fuse::IndexKind;

use super::Findings;
use super::false_calls::{FalseCalls, STATED};
use super::gauge::GaugeResult;
use super::published::{HONEYCOMB_A90_95_MM, SLABS_TPR, a90_95_mm};
use super::summary::{OfSet, Rival};

const HEAD: &str = include_str!("head.md");

const NOT_SHOWN: &str = "## What is not shown

- No recorded tyre was judged. How faint a crack in rubber is, and how its sound differs, are assumptions of the simulation.
- Every set changes one thing at a time, and cracks lie on one shoulder; damage all round, which a tyre by itself cannot
  show, is in none of them.
- This study does not prove differences whose interval contains 0. Among so many comparisons, some intervals
  miss 0 by chance.
- A rate stated at one in a thousand needs thousands of independent sound shoulders to be confirmed. Here it can only be
  refuted.
- The second rig of the gauge study differs in ways that we chose, not in the ways in which two real rigs differ.
";

/// The page that stands beside `folder`.
pub(super) fn page(found: &Findings, pictures: &[Picture], folder: &str) -> String {
    let folder = format!("{folder}/");
    let page = page_of(HEAD, &conclusions(found), (&found.tables, pictures), heading, &folder);
    format!("{page}\n{NOT_SHOWN}")
}

fn heading(name: &str) -> &'static str {
    match name {
        "sets" => "The sets",
        "default" => "The default index",
        "overlap" => "Regions",
        "false_calls" => "False calls",
        "detection" => "Probability of detection",
        "published" => "Published numbers of other structures",
        "gauge" => "Repeatability and reproducibility",
        _ => "More",
    }
}

/// Names with their numbers, or that there are none.
fn listed(items: &[String]) -> String {
    if items.is_empty() { "none".to_owned() } else { items.join("; ") }
}

fn conclusions(found: &Findings) -> Vec<String> {
    let mut lines = vec![
        compared(&found.of_sets, "the best discriminator alone", |of| &of.alone),
        compared(&found.of_sets, "the dissertation's index", |of| &of.dissertation),
    ];
    lines.extend(called(&found.calls));
    lines.push(detected(&found.detection));
    lines.extend(published(&found.detection, &found.of_sets));
    lines.extend(repeated(&found.gauge));
    lines
}

/// Where the default index falls short of `name`, and where that is significant.
fn compared(of_sets: &[OfSet], name: &str, rival: impl Fn(&OfSet) -> &Rival) -> String {
    let short: Vec<&OfSet> = of_sets.iter().filter(|of| rival(of).gain < 0.0).collect();
    let above = |of: &&OfSet| rival(of).interval.is_some_and(|(low, _)| low > 0.0);
    let below = |of: &&OfSet| rival(of).interval.is_some_and(|(_, high)| high < 0.0);
    let text = |of: &&OfSet| {
        let Rival { gain, interval, .. } = *rival(of);
        let [low, high] = ends(interval);
        let between = interval.map_or_else(String::new, |_| format!(" ({low} to {high})"));
        format!("{} {}{between}", of.set, cell(gain))
    };
    format!(
        "The default index by a healthy reference has a greater AUC than {name} in {} of {} sets; in {} of these the interval \
         of the gain lies above 0. Where it is worse, the difference is: {}. In {} of these the interval lies below 0.",
        of_sets.len() - short.len(),
        of_sets.len(),
        of_sets.iter().filter(above).count(),
        listed(&short.iter().map(text).collect::<Vec<_>>()),
        of_sets.iter().filter(below).count(),
    )
}

/// The least and the greatest rate of each call by the default index at each stated rate, and what exceeds its rate.
fn called(calls: &[FalseCalls]) -> Vec<String> {
    let text = |(call, stated): (Call, f64)| {
        let is_it =
            |c: &&FalseCalls| c.index == IndexKind::default() && c.call == call && c.stated.total_cmp(&stated).is_eq();
        let [least, most] = ends(extent(calls.iter().filter(is_it).map(|c| c.rate.rate)));
        format!("{}, {} stated: {least} to {most}", call.name(), cell(stated))
    };
    let above = calls.iter().filter(|c| c.rate.low > c.stated).map(|c| {
        let (index, call, rate) = (c.index.name(), c.call.name(), c.rate);
        let [low, high] = ends(Some((rate.low, rate.high)));
        let by = if c.casings == 0 { "by itself".to_owned() } else { format!("by {} casings", c.casings) };
        format!("`{index}` {by} {call} {} at {} stated ({low} to {high})", cell(rate.rate), cell(c.stated))
    });
    vec![
        format!("Sound shoulders that the default index calls, over all references: {}.", listed(&STATED.map(text))),
        format!("Significantly above the stated rate: {}.", listed(&above.collect::<Vec<_>>())),
    ]
}

fn detected(detection: &[Detection]) -> String {
    let text = |d: &Detection| {
        let sizes = d.sizes_in_words().unwrap_or_else(|_| "no a90, for the reason in the table".to_owned());
        format!("{}, {} of {} found: {sizes}", d.class, d.found_count(), d.targets.len())
    };
    format!("Finds by hit/miss: {}.", listed(&detection.iter().map(text).collect::<Vec<_>>()))
}

/// The study's numbers beside those of other structures.
fn published(detection: &[Detection], of_sets: &[OfSet]) -> Vec<String> {
    let a90_95 = a90_95_mm(detection).map(|mm| {
        format!(
            "a90/95 is {} mm here, on simulated rubber by length across the shoulder; {HONEYCOMB_A90_95_MM} mm is published for \
             another structure, honeycomb panels tapped by machine (NRC Canada).",
            cell(mm)
        )
    });
    let range = extent(of_sets.iter().filter_map(|of| Some(of.found?.rate))).map(|(least, most)| {
        format!(
            "At 5 % false calls {} to {} of the cracked locations are found, set by set; {} is published for another structure, \
             concrete slabs (FHWA).",
            cell(least),
            cell(most),
            cell(SLABS_TPR)
        )
    });
    a90_95.into_iter().chain(range).collect()
}

/// What the gauge takes of what verdicts rest on, by the default index.
fn repeated(gauge: &[GaugeResult]) -> Option<String> {
    let is_it = |g: &&GaugeResult| g.index == IndexKind::default() && g.reading == GaugedBy::StrongestArc;
    let found = gauge.iter().find(is_it)?;
    let (both, one) = (found.of_both.as_ref().ok()?, found.of_one.as_ref().ok()?);
    let categories = |ndc: Option<u64>| ndc.map_or_else(|| "none".to_owned(), |ndc| ndc.to_string());
    Some(format!(
        "The gauge takes {} % of the total standard deviation of the strongest arc of a shoulder with one rig, and {} % with two, \
         of which the second is noisier; numbers of distinct categories: {} and {}.",
        cell(one.repeatability.study_percent),
        cell(both.gauge.study_percent),
        categories(one.ndc),
        categories(both.ndc)
    ))
}
