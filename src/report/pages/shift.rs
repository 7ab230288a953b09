//! The page of a shift: all tyres, the worst first.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use anyhow::Result;
use maud::{Markup, PreEscaped, html};
use tapline_fuse::{Fusion, Score, ScorePool};
use tapline_host::messages::counted;
use tapline_store::Reader;
use tapline_wire::{Discriminator, Reasons, Verdict};

use crate::report::evidence::{Evidence, Shoulder, Tyre};
use crate::report::figures::{boxes, rounds, scale};
use crate::report::pages::page::{self, figure, small_figure, verdict_word};
use crate::report::pages::paper::{self, Paper};
use crate::report::pages::rig::RigsOfShift;
use crate::report::pages::tyre::boxes_words;
use crate::report::pages::words::{LIMITS, bodies, body, moment, side};
use crate::report::span::Span;
use crate::shown::refused::without_file;
use crate::shown::verdict::{DamageArc, places};

/// Most tyres whose index is drawn.
const DRAWN_MOST: usize = 60;

/// Most serials that are named as scanned more than once.
const AGAIN_MOST: usize = 20;

/// Contents of the page of a shift, collected archive by archive.
#[derive(Default)]
pub(crate) struct Shift {
    /// The evidence of the first archive, with the tyres of all.
    evidence: Option<Evidence>,
    /// File names of the tyres' pages; `None` for one that has none.
    names: Vec<Option<String>>,
    refusals: BTreeMap<String, usize>,
    /// For each row of the list at the top its texts, each with the number of tyres that it holds for.
    made_by: BTreeMap<(usize, &'static str), BTreeMap<String, usize>>,
    /// Archives that could not be read, and files of casings that are not finished.
    pub(crate) left_out: Vec<String>,
    pub(crate) unfinished: Vec<String>,
    /// Of which times casings are on the page; and how many archives are of other times, and which have none.
    span: Span,
    pub(crate) others: usize,
    pub(crate) timeless: Vec<String>,
    scores: ScorePool,
    /// Whether anything has a score.
    is_scored: bool,
}

impl Shift {
    /// One of casings of this `span`.
    pub(crate) fn of(span: Span) -> Self {
        Self { span, ..Self::default() }
    }

    /// Collects what is not in `evidence` from its archive, behind `reader`.
    pub(crate) fn look_at(&mut self, reader: &Reader, evidence: &Evidence) -> Result<()> {
        let refusals = reader.refusals()?;
        for refusal in refusals {
            *self.refusals.entry(without_file(&refusal.reason).to_owned()).or_default() += 1;
        }
        for (place, (name, text)) in page::made_by(evidence).into_iter().enumerate() {
            let texts = self.made_by.entry((place, name)).or_default();
            *texts.entry(text.into_string()).or_default() += evidence.tyres.len();
        }
        if evidence.has_truth {
            // The score that a run prints at its end. There is none if the configuration does not fit the plan.
            let records: Vec<_> = evidence.tyres.iter().flat_map(Tyre::taps).filter_map(|tap| tap.found).collect();
            let fusion = Fusion::by(&evidence.config.fuse, reader.plan(), evidence.reference.clone());
            let added = fusion.and_then(|fusion| self.scores.add(fusion, &records));
            self.is_scored |= added.is_ok();
        }
        Ok(())
    }

    /// Adds the file of a tyre's page, to which the page of the shift links, if the tyre has one.
    pub(crate) fn add_page(&mut self, name: Option<String>) {
        self.names.push(name);
    }

    /// Adds the tyres of `evidence`.
    pub(crate) fn add_tyres(&mut self, evidence: Evidence) {
        match &mut self.evidence {
            None => self.evidence = Some(evidence),
            Some(first) => first.join(evidence),
        }
    }

    /// Whether it has no tyres.
    pub(crate) fn is_empty(&self) -> bool {
        self.evidence.is_none()
    }

    /// The page, called `title`, or named after the archive if that is empty; `None` if there is nothing to show.
    pub(crate) fn page(mut self, title: String, shift: Option<&str>) -> Result<Option<String>> {
        let Some(mut evidence) = self.evidence.take() else { return Ok(None) };
        if !title.is_empty() {
            evidence.archive = title;
        }
        page(&self, &evidence, shift).map(Some)
    }

    /// The text that the row `name` has for every tyre; `None` if it differs.
    fn only(&self, name: &str) -> Option<&str> {
        let texts = self.made_by.iter().find(|((_, of), _)| *of == name).map(|(_, texts)| texts)?;
        texts.keys().next().filter(|text| texts.len() == 1 && !text.is_empty()).map(String::as_str)
    }
}

/// The page of `evidence`, which is that of all tyres of `of`.
fn page(of: &Shift, evidence: &Evidence, shift: Option<&str>) -> Result<String> {
    let Shift { names, left_out, unfinished, timeless, .. } = of;
    let refusals = &page::frequent_first(of.refusals.clone());
    let score = of.is_scored.then(|| of.scores.score());
    let shift = shift.map(|name| format!("shift {name}"));
    let place = of.only("Plant").map(|_| evidence.config.report.place());
    let name = match (place, shift) {
        (None, None) => evidence.archive.clone(),
        (place, shift) => place.into_iter().chain(shift).collect::<Vec<_>>().join(", "),
    };
    let geometry = evidence.geometry;
    let mut order: Vec<(&Tyre, &Option<String>)> = evidence.tyres.iter().zip(names).collect();
    order.sort_by(|(a, _), (b, _)| {
        let strongest = |tyre: &Tyre| tyre.strongest_arc().unwrap_or(f64::INFINITY);
        b.verdict().cmp(&a.verdict()).then(strongest(b).total_cmp(&strongest(a)))
    });
    let named: Vec<(String, &Shoulder)> = evidence
        .tyres
        .iter()
        .flat_map(|tyre| {
            tyre.shoulders.iter().map(|s| (format!("{}, {} {}", tyre.serial, side(geometry), s.number), s))
        })
        .collect();
    let taps = || evidence.tyres.iter().flat_map(Tyre::taps);
    let rigs = RigsOfShift::new(evidence);
    let body = html! {
        header {
            p class="kind" { "tapline, report on a shift" }
            h1 { (name) }
            (span(of))
            (again(evidence))
            (page::notices(evidence, &named, refusals))
            (absent("could not be read and is left out", "could not be read and are left out", left_out))
            (absent("has no tap with a time and is left out", "have no tap with a time and are left out", timeless))
            (absent("is not finished and is left out", "are not finished and are left out", unfinished))
            (rigs.notice())
            dl {
                dt { "Tapped" } dd { (page::when(taps())) }
                dt { "Verdicts" } dd {
                    @for verdict in [Verdict::Reject, Verdict::ReInspect, Verdict::Pass] {
                        (evidence.tyres.iter().filter(|tyre| tyre.verdict() == verdict).count()) " " (verdict_word(verdict)) " \u{a0} "
                    }
                    @let scans = scans(evidence);
                    @if scans.contains(" of ") { "(" (scans) ")" }
                }
                (rows(&of.made_by))
                (page::by_itself(evidence))
            }
        }
        (overview(evidence, &order))
        (why(evidence))
        (rigs.section(evidence)?)
        (indices(evidence, &order)?)
        (truth(evidence, score)?)
        section { h2 { "Taps" } (page::ledger(&named, refusals)) }
        section { h2 { "Lineage" } (page::lineage(evidence)) }
        (paper::signature(of.only("Operator").and(evidence.config.report.operator.as_deref())))
    };
    let paper = Paper {
        top_left: format!("Shift: {name}"),
        top_right: scans(evidence),
        bottom_left: format!("tapped {}", page::when(taps())),
    };
    Ok(page::page(&format!("Shift {name}"), &paper, &body))
}

/// Which casings are on the page, if that depends on their time.
fn span(of: &Shift) -> Markup {
    let Shift { span, others, .. } = of;
    html! {
        @if let Some(words) = span.words() {
            p {
                strong { "Casings last tapped " (words) "." }
                @if *others > 0 { " Left out: " (counted(*others, "archive", "archives")) " of other times." }
            }
        }
    }
}

/// The serials that were scanned more than once, with their verdicts in the order of tapping: those that do not agree come first.
fn again(evidence: &Evidence) -> Markup {
    let mut scans: BTreeMap<&str, Vec<&Tyre>> = BTreeMap::new();
    for tyre in &evidence.tyres {
        scans.entry(tyre.serial.as_str()).or_default().push(tyre);
    }
    let mut again: Vec<_> = scans.into_iter().filter(|(_, tyres)| tyres.len() > 1).collect();
    for (_, tyres) in &mut again {
        tyres.sort_by_key(|tyre| last_ns(tyre));
    }
    again.sort_by_key(|(_, tyres)| tyres.iter().all(|tyre| tyre.verdict() == tyres[0].verdict()));
    let verdicts = |tyres: &[&Tyre]| tyres.iter().map(|tyre| tyre.verdict().to_string()).collect::<Vec<_>>().join(", ");
    let said = |(serial, tyres): &(&str, Vec<&Tyre>)| format!("{serial} ({})", verdicts(tyres));
    let shown: Vec<String> = again.iter().take(AGAIN_MOST).map(said).collect();
    html! {
        @if !again.is_empty() {
            div class="notice" role="note" { p {
                strong { "Scanned more than once: " } (shown.join(", "))
                @if again.len() > shown.len() { " and " (again.len() - shown.len()) " more" } "."
            } }
        }
    }
}

/// How many scans the page has, and of how many casings, if these are fewer.
fn scans(evidence: &Evidence) -> String {
    let (count, one, several) =
        (evidence.tyres.len(), body(evidence.geometry).to_lowercase(), bodies(evidence.geometry));
    let serials: BTreeSet<&str> = evidence.tyres.iter().map(|tyre| tyre.serial.as_str()).collect();
    let bodies = |count| counted(count, &one, several);
    match serials.len() {
        all if all == count => bodies(count),
        fewer => format!("{} of {}", counted(count, "scan", "scans"), bodies(fewer)),
    }
}

/// Names the `files` that are not on the page, if there are any.
fn absent(one: &str, several: &str, files: &[String]) -> Markup {
    // Nobody would read a longer list.
    let shown = &files[..files.len().min(8)];
    html! {
        @if !files.is_empty() {
            div class="notice" role="note" { p {
                strong { (counted(files.len(), "archive", "archives")) " " (if files.len() == 1 { one } else { several }) } ": " (shown.join(", "))
                @if files.len() > shown.len() { " and " (files.len() - shown.len()) " more" } "."
            } }
        }
    }
}

/// The rows of the list at the top: a text that does not hold for all tyres with their number.
fn rows(made_by: &BTreeMap<(usize, &'static str), BTreeMap<String, usize>>) -> Markup {
    html! {
        @for ((_, name), texts) in made_by {
            @match texts.iter().next() {
                Some((text, _)) if texts.len() == 1 => @if !text.is_empty() { dt { (name) } dd { (PreEscaped(text)) } },
                _ => {
                    dt { (name) } dd { @for (text, count) in texts {
                        strong { (counted(*count, "tyre", "tyres")) ": " } (PreEscaped(if text.is_empty() { "not stated" } else { text })) br;
                    } }
                }
            }
        }
    }
}

/// How many shoulders did not pass for each reason, at each station.
fn why(evidence: &Evidence) -> Markup {
    let mut counts: BTreeMap<&str, BTreeMap<u16, usize>> = BTreeMap::new();
    for shoulder in evidence.shoulders() {
        let refused = shoulder.reasons.intersection(Reasons::TAPS_REFUSED);
        for reason in names(against_pass(shoulder).union(refused)) {
            *counts.entry(reason).or_default().entry(shoulder.station).or_default() += 1;
        }
    }
    if counts.is_empty() {
        return html! {};
    }
    let stations: BTreeSet<u16> = evidence.shoulders().map(|shoulder| shoulder.station).collect();
    let of = |station: u16| evidence.shoulders().filter(move |shoulder| shoulder.station == station);
    let passed = |station: u16| of(station).filter(|shoulder| shoulder.verdict == Verdict::Pass).count();
    let mut rows: Vec<_> = counts.into_iter().collect();
    rows.sort_by_key(|(_, counts)| Reverse(counts.values().sum::<usize>()));
    html! {
        section { h2 { "Why shoulders did not pass" }
            div class="scroll" { table {
                thead { tr { th { "reason" } th { "meaning" } @for station in &stations { th class="n" { "station " (station) } } } }
                tbody {
                    @for (reason, counts) in rows { tr {
                        td { code { (reason) } } td { (Reasons::named(reason).meaning()) }
                        @for station in &stations { td class="n" { (counts.get(station).copied().unwrap_or(0)) } }
                    } }
                    tr { th { "passed" } th {} @for &station in &stations { th class="n" { (passed(station)) " of " (of(station).count()) } } }
                }
            } }
        }
    }
}

/// The reasons for which `shoulder` did not pass: no remarks, and nothing that merely follows from refused taps.
fn against_pass(shoulder: &Shoulder) -> Reasons {
    shoulder.reasons_left().difference(Reasons::REMARKS)
}

fn names<'a>(reasons: Reasons) -> impl Iterator<Item = &'a str> {
    Reasons::ALL.iter().filter(move |(flag, _)| reasons.contains(*flag)).map(|&(_, name)| name)
}

fn overview(evidence: &Evidence, order: &[(&Tyre, &Option<String>)]) -> Markup {
    let geometry = evidence.geometry;
    html! {
        h2 { "Overview" }
        div class="scroll" { table class="cards" {
            thead { tr {
                th { (body(geometry)) } th { "tapped" } th { "verdict" } th { "by " (side(geometry)) } th class="n" { "regions" } th class="n" { "strongest arc" } th class="n" { "station" }
            } }
            tbody { @for (tyre, name) in order { tr {
                td class="tyre" data-label=(body(geometry)) { @if let Some(name) = name {
                    a href=(name) { (tyre.serial) }
                    // A serial number that came again: the names of its pages distinguish them.
                    @if order.iter().filter(|(other, _)| other.serial == tyre.serial).count() > 1 {
                        span class="at" { (name.trim_end_matches(".html")) }
                    }
                } @else { (tyre.serial) } }
                td class="when" data-label="tapped" { (tapped_at(tyre)) }
                td data-label="verdict" { (verdict_word(tyre.verdict())) }
                td data-label={ "by " (side(geometry)) } { @for shoulder in &tyre.shoulders {
                    (shoulder.number) ": " (shoulder.verdict)
                    @let names = names(against_pass(shoulder)).collect::<Vec<_>>().join(", ");
                    @let refused = shoulder.refused.iter().map(|refused| refused.text.clone());
                    @let why = refused.chain(Some(names).filter(|names| !names.is_empty())).collect::<Vec<_>>();
                    @if !why.is_empty() { " (" (why.join("; ")) ")" }
                    @if !shoulder.regions.is_empty() { ", " (places(shoulder.regions.iter().map(DamageArc::from))) } " " br;
                } }
                td class="n" data-label="regions" { (tyre.shoulders.iter().map(|shoulder| shoulder.regions.len()).sum::<usize>()) }
                td class="n" data-label="strongest arc" { (tyre.strongest_arc().map_or_else(|| "none".to_owned(), |arc| format!("{arc:.2}"))) }
                td class="n" data-label="station" { (tyre.stations().iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")) }
            } } }
        } }
    }
}

/// When `tyre` was tapped last; empty if that was not recorded.
fn tapped_at(tyre: &Tyre) -> Markup {
    let moment = last_ns(tyre).map_or_else(String::new, moment);
    // In a narrow column the day stays whole.
    let (day, time) = moment.split_once(' ').unwrap_or((&moment, ""));
    html! { span { (day) } " " span { (time) } }
}

fn last_ns(tyre: &Tyre) -> Option<i64> {
    tyre.taps().filter_map(|tap| tap.time_ns).filter(|&time_ns| time_ns != 0).max()
}

fn indices(evidence: &Evidence, order: &[(&Tyre, &Option<String>)]) -> Result<Markup> {
    let geometry = evidence.geometry;
    let range = scale::range(evidence);
    let mut pictures = Vec::new();
    for (tyre, _) in order.iter().take(DRAWN_MOST) {
        for shoulders in tyre.shoulders.chunks(rounds::SHOULDERS) {
            let title = format!("{} {}: {}", body(geometry), tyre.serial, tyre.verdict());
            pictures.push(rounds::index(geometry, title, shoulders, range)?);
        }
    }
    let what = html! {
        strong { "The damage index along every " (side(geometry)) ", all on one scale, with the limits of the verdicts." }
        " " (LIMITS) " Gaps are locations without a value."
        @if order.len() > DRAWN_MOST { " Shown: the " (DRAWN_MOST) " worst of " (order.len()) "." }
    };
    Ok(html! { section { h2 { "Damage index" } (figure(pictures, &what)) } })
}

fn truth(evidence: &Evidence, score: Option<Score>) -> Result<Markup> {
    let pictures = boxes::pictures(evidence, &evidence.tyres)?;
    if pictures.is_empty() {
        return Ok(html! {});
    }
    let number = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| format!("{value:.4}"));
    Ok(html! {
        section {
            h2 { "Compared with the truth" }
            (small_figure(pictures, &boxes_words("the whole shift", "at the offset and velocity that are drawn on each tyre's page")))
            @if let Some(score) = score {
                p { "All taps together, each offset and velocity standardised separately: AUC of the index " (number(score.index)) " over " (score.cracked_count) " cracked and " (score.sound_count) " sound locations; each alone, also as a mean over three neighbours: "
                    @for (order, (which, alone)) in Discriminator::ALL.into_iter().zip(score.discriminators).enumerate() {
                        @if order > 0 { ", " } (which.printed()) " " (number(alone))
                    } "." }
            }
        }
    })
}
