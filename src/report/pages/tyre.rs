//! The page of one tyre: verdict, what to mark, and the pictures behind the verdict.

use std::collections::BTreeMap;

use anyhow::Result;
use maud::{Markup, html};
use tapline_fuse::Direction;
use tapline_store::Reader;
use tapline_wire::{Channel, Discriminator};

use crate::report::evidence::{Evidence, Shoulder, Tyre, spectra};
use crate::report::figures::{boxes, bscan, ring, rounds, scale, strip, taps};
use crate::report::pages::marks;
use crate::report::pages::page::{self, figure, small_figure};
use crate::report::pages::paper::{self, Paper};
use crate::report::pages::words::{LIMITS, body, side};

/// The page of `tyre`.
pub(crate) fn page(reader: &Reader, evidence: &Evidence, tyre: &Tyre) -> Result<String> {
    let geometry = evidence.geometry;
    let title = format!("{} {}: {}", body(geometry), tyre.serial, tyre.verdict());
    let named: Vec<(String, &Shoulder)> =
        tyre.shoulders.iter().map(|shoulder| (format!("{} {}", side(geometry), shoulder.number), shoulder)).collect();
    let stations: Vec<String> = tyre.stations().iter().map(ToString::to_string).collect();
    let refusals = refusals(reader, tyre)?;
    let archived = tyre.taps().filter(|tap| tap.found.is_some()).count();
    let body = html! {
        header {
            p class="kind" { "tapline, report on a " (body(geometry).to_lowercase()) }
            h1 { (body(geometry)) " " (tyre.serial) }
            (page::notices(evidence, &named, &refusals))
            (page::verdict_light(tyre.verdict()))
            dl {
                dt { "Tapped" } dd { (page::when(tyre.taps())) }
                dt { "Station" } dd { (stations.join(", ")) }
                dt { "Taps" } dd { (archived) " of " (tyre.taps().count()) }
                @for (name, text) in page::made_by(evidence).into_iter().filter(|(_, text)| !text.0.is_empty()) { dt { (name) } dd { (text) } }
                (page::by_itself(evidence))
            }
        }
        (marks::verdicts(geometry, tyre))
        (marks::regions(evidence, tyre))
        (paper::signature(evidence.config.report.operator.as_deref()))
        (maps(evidence, tyre)?)
        (discriminators(evidence, tyre)?)
        (scans(reader, evidence, tyre)?)
        (pair(reader, evidence, tyre)?)
        (truth(evidence, tyre)?)
        section {
            h2 { "Taps" }
            (page::ledger(&named, &refusals))
        }
        section { h2 { "Lineage" } (page::lineage(evidence)) }
    };
    let paper = Paper {
        top_left: title.clone(),
        top_right: evidence.config.report.place(),
        bottom_left: format!("tapped {}", page::when(tyre.taps())),
    };
    Ok(page::page(&title, &paper, &body))
}

/// The reasons why taps of `tyre` were refused, with their counts, the most frequent first.
fn refusals(reader: &Reader, tyre: &Tyre) -> Result<Vec<(String, usize)>> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for refusal in reader.refusals()?.into_iter().filter(|refusal| refusal.id.tyre == tyre.serial) {
        *counts.entry(refusal.reason).or_default() += 1;
    }
    Ok(page::frequent_first(counts))
}

/// The damage maps, and the index around the ring.
fn maps(evidence: &Evidence, tyre: &Tyre) -> Result<Markup> {
    let geometry = evidence.geometry;
    let greatest = scale::greatest(evidence);
    let mut maps = Vec::new();
    for shoulder in &tyre.shoulders {
        let title = format!("{} {}", capital(side(geometry)), shoulder.number);
        maps.push(match shoulder.is_round {
            true => ring::svg(&title, shoulder, greatest)?,
            false => strip::svg(&title, shoulder, greatest)?,
        });
    }
    let curve = |shoulder: &Shoulder| {
        let title = format!("Damage index, {} {}", side(geometry), shoulder.number);
        rounds::index(geometry, title, std::slice::from_ref(shoulder), scale::range(evidence))
    };
    let curves = tyre.shoulders.iter().map(curve).collect::<Result<Vec<_>>>()?;
    let offsets: Vec<String> =
        tyre.shoulders.first().map_or(&[][..], |s| &s.offsets).iter().map(|map| map.offset_mm.to_string()).collect();
    let what = html! {
        strong { "Damage index, location by location." }
        " Dark is damage; grey is a location without a value. "
        (match tyre.is_round() {
            true => "Angles run clockwise from the start mark at the top; ",
            false => "Locations run from left to right; ",
        })
        "a vermilion bar beside the map is a region, with its number"
        @if evidence.has_truth { "; a black line is a known crack" }
        ". "
        @if !offsets.is_empty() {
            (match tyre.is_round() {
                true => "The outer ring combines all taps; inside it, from the outside in, are the offsets ",
                false => "The upper strip combines all taps; below it are the offsets ",
            })
            (offsets.join(", ")) " mm from the belt edge, each judged by itself: a crack is where its "
            (if tyre.is_round() { "ring" } else { "strip" }) " is darkest. "
        }
        "The index says how far a location stands out from the reference; the triangles on the scale below are the limits."
    };
    let how = html! {
        strong { "The index along the " (side(geometry)) ", with the limits of the verdict." }
        " " (LIMITS) " Gaps are locations without a value. Shaded: the regions."
    };
    Ok(html! {
        section { h2 { "Damage map" } (figure(maps, &what)) }
        section { (figure(curves, &how)) }
    })
}

fn discriminators(evidence: &Evidence, tyre: &Tyre) -> Result<Markup> {
    let Some(condition) = tyre.condition else { return Ok(html! {}) };
    let (mut pictures, mut absent, mut shown) = (Vec::new(), Vec::new(), Vec::new());
    for which in Discriminator::ALL {
        let drawn = rounds::discriminator(evidence, tyre, condition, which)?;
        let words = format!("{} {}", which.printed(), which.meaning());
        if drawn.is_empty() {
            absent.push(words)
        } else {
            shown.push(words)
        }
        pictures.extend(drawn);
    }
    if shown.is_empty() {
        return Ok(html! {});
    }
    let falls = |which: &Discriminator| evidence.config.fuse.directions.of(*which) == Direction::Falls;
    let falling: Vec<&str> =
        Discriminator::ALL.iter().filter(|which| falls(which)).map(|&which| which.printed()).collect();
    let falling = if falling.is_empty() { "nothing".to_owned() } else { falling.join(", ") };
    let what = html! {
        strong { "The discriminators along the " (side(evidence.geometry)) ", repetition by repetition (" (condition.words()) ")." }
        " " (shown.join(", ")) ". Over a crack " (falling) " falls and the others rise; where the two curves leave their level together, it is the casing and not chance. Shaded: the regions. Gaps are values that a record did not give, or locations that were not tapped a second time."
        @if !absent.is_empty() { " Absent from every record: " (absent.join(", ")) "." }
    };
    Ok(html! { section { h2 { "Discriminators" } (figure(pictures, &what)) } })
}

fn scans(reader: &Reader, evidence: &Evidence, tyre: &Tyre) -> Result<Markup> {
    let Some(condition) = tyre.condition else { return Ok(html! {}) };
    let band_hz = spectra::band_hz(&evidence.config.process);
    let spectra_of = |shoulder: &Shoulder| spectra::spectra(reader, shoulder, condition, band_hz);
    let all = tyre.shoulders.iter().map(spectra_of).collect::<Result<Vec<_>>>()?;
    let loudest = tapline_draw::stats::extent(all.iter().flat_map(|s| s.columns.iter().flatten().flatten().copied()));
    let Some((_, loudest_db)) = loudest else { return Ok(html! {}) };
    let mut pictures = Vec::new();
    for (shoulder, spectra) in tyre.shoulders.iter().zip(&all) {
        let title = format!("Spectra, {} {}", side(evidence.geometry), shoulder.number);
        pictures.push(bscan::svg(title, shoulder, spectra, loudest_db)?);
    }
    let what = html! {
        strong { "B-scan: power density of the sound by location and frequency (" (condition.words()) ", first repetition)." }
        " Dark is loud, in dB re 1 " (evidence.recording.calibration.unit(Channel::Sound).name()) "²/Hz; pale is " (bscan::DEPTH_DB) " dB or more below the loudest. Cracks show as dark columns; the vermilion bars on top are the regions. Grey: no tap. "
        "Offset and velocity are those at which the regions stand out most; without regions, the highest velocity at the offset nearest the belt edge."
    };
    Ok(html! { section { h2 { "Spectra" } (figure(pictures, &what)) } })
}

fn pair(reader: &Reader, evidence: &Evidence, tyre: &Tyre) -> Result<Markup> {
    let Some(condition) = tyre.condition else { return Ok(html! {}) };
    let Some(pair) = taps::pair(reader, evidence.geometry, tyre, condition)? else { return Ok(html! {}) };
    let what = html! {
        strong { "Two taps of " (pair.words) " (" (condition.words()) ")." }
        " Over a crack the contact is longer and softer, and the thin layer above the crack rings: compare the width of the force pulse and the size of the sound after it. The ordinary location is the one whose index is the median of those without damage."
    };
    Ok(html! { section { h2 { "Force and sound" } (figure(pair.pictures, &what)) } })
}

fn truth(evidence: &Evidence, tyre: &Tyre) -> Result<Markup> {
    let pictures = boxes::pictures(evidence, std::slice::from_ref(tyre))?;
    if pictures.is_empty() {
        return Ok(html! {});
    }
    Ok(
        html! { section { h2 { "Compared with the truth" } (small_figure(pictures, &boxes_words(&format!("this {}", body(evidence.geometry).to_lowercase()), "under the conditions drawn above"))) } },
    )
}

/// Caption of the boxplots of `whom`.
pub(crate) fn boxes_words(whom: &str, conditions: &str) -> Markup {
    html! {
        strong { "Locations of " (whom) " that are known to be cracked, compared with those known to be sound." }
        " A box is the middle half of the locations, with their median; whiskers reach the farthest values within 1.5 heights of the box, and rings are values beyond. Values are means over repetitions " (conditions) "; the index is that of all taps."
    }
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
