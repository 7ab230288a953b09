//! The frame of a page and the parts that all pages have.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use tapline_draw::canvas::number;
use tapline_fuse::Reference;
use tapline_host::messages::counted;
use tapline_wire::{Reasons, TapState, Verdict};

use crate::report::evidence::{Evidence, Shoulder, Tap, flags};
use crate::report::pages::paper::Paper;
use crate::report::pages::words;

/// The reasons of a shoulder that was compared with its own casing although there is another reference.
const BY_ITS_CASING: Reasons = Reasons::SCATTER_OFF.union(Reasons::SELF_REFERENCE);

/// A page called `title`, which needs no other file.
pub(crate) fn page(title: &str, paper: &Paper, body: &Markup) -> String {
    let style = include_str!("style.css").replace('\n', "") + &paper.style();
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(style)) }
            }
            body { main { (body) } }
        }
    }
    .into_string()
}

/// A figure of `pictures` with the caption `what`.
pub(crate) fn figure(pictures: Vec<String>, what: &Markup) -> Markup {
    grid("pictures", pictures, what)
}

/// The same with pictures of half the width.
pub(crate) fn small_figure(pictures: Vec<String>, what: &Markup) -> Markup {
    grid("pictures small", pictures, what)
}

fn grid(class: &str, pictures: Vec<String>, what: &Markup) -> Markup {
    html! {
        figure {
            div class=(class) { @for picture in pictures { (PreEscaped(picture)) } }
            figcaption { (what) }
        }
    }
}

/// Class of the verdict in the style sheet.
fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::ReInspect => "re-inspect",
        Verdict::Reject => "reject",
    }
}

/// The verdict as a word in the text; its mark comes from the style sheet.
pub(crate) fn verdict_word(verdict: Verdict) -> Markup {
    html! { span class={ "word-" (class(verdict)) } { (verdict) } }
}

/// The verdict as a traffic light, with a caption.
pub(crate) fn verdict_light(verdict: Verdict) -> Markup {
    html! {
        div class={ "verdict " (class(verdict)) } {
            (light(verdict))
            div { p class="word" { (verdict) } p { (words::verdict(verdict)) } }
        }
    }
}

/// Three lamps, each with its own shape and sign; one is lit.
fn light(verdict: Verdict) -> Markup {
    let lit = |lamp: Verdict, color: &'static str| if lamp == verdict { color } else { "#3d3d3d" };
    let sign = |lamp: Verdict, color: &'static str| if lamp == verdict { color } else { "#6e6e6e" };
    html! {
        svg viewBox="0 0 62 158" role="img" aria-label={ "traffic light: " (verdict) } {
            rect x="1" y="1" width="60" height="156" rx="12" fill="#222" {}
            polygon points="22,7 40,7 53,20 53,38 40,51 22,51 9,38 9,20" fill=(lit(Verdict::Reject, "#d5001c")) {}
            path d="M22 20 L40 38 M40 20 L22 38" stroke-width="5" fill="none" stroke=(sign(Verdict::Reject, "#fff")) {}
            polygon points="31,55 55,100 7,100" fill=(lit(Verdict::ReInspect, "#f0b400")) {}
            path d="M31 70 L31 86 M31 90 L31 95" stroke-width="5" fill="none" stroke=(sign(Verdict::ReInspect, "#000")) {}
            circle cx="31" cy="129" r="22" fill=(lit(Verdict::Pass, "#009e73")) {}
            path d="M20 129 L28 138 L43 120" stroke-width="5" fill="none" stroke=(sign(Verdict::Pass, "#fff")) {}
        }
    }
}

/// What is missing from the page, for its top; empty if nothing is. The `refusals` are counted by reason, the most frequent first.
pub(crate) fn notices(evidence: &Evidence, shoulders: &[(String, &Shoulder)], refusals: &[(String, usize)]) -> Markup {
    let planned: usize = shoulders.iter().map(|(_, shoulder)| shoulder.taps.len()).sum();
    let count = |state| shoulders.iter().map(|(_, shoulder)| shoulder.count(state)).sum::<usize>();
    let (missing, refused) = (count(TapState::Missing), count(TapState::Refused));
    let open: Vec<&str> = shoulders.iter().filter(|(_, s)| s.limits.is_none()).map(|(name, _)| name.as_str()).collect();
    if missing + refused == 0 && open.is_empty() && evidence.config_problem.is_none() {
        return html! {};
    }
    // Nobody would read a longer list.
    let shown = &open[..open.len().min(8)];
    html! {
        div class="notice" role="note" {
            @if missing + refused > 0 { p { strong { "Incomplete." } " What follows is based on what is there." } }
            @if missing > 0 { p { (missing) " of " (counted(planned, "planned tap is", "planned taps are")) " missing." } }
            @if refused > 0 {
                p {
                    (refused) " of " (counted(planned, "planned tap was", "planned taps were")) " refused"
                    @if let Some((reason, count)) = refusals.first() {
                        ": " (reason)
                        @if refusals.len() > 1 { " (" (count) " of them); all reasons are below" }
                    }
                    "."
                }
            }
            @if !open.is_empty() {
                p {
                    "No limits or no verdict, which counts as RE-INSPECT: " (shown.join(", "))
                    @if open.len() > shown.len() { " and " (open.len() - shown.len()) " more" } "."
                }
            }
            @if let Some(problem) = &evidence.config_problem {
                p { "The configuration could not be read by this version (" (problem) "); its defaults are used for directions and bands." }
            }
        }
    }
}

/// The `counts` of reasons, the most frequent first.
pub(crate) fn frequent_first(counts: BTreeMap<String, usize>) -> Vec<(String, usize)> {
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|&(_, count)| Reverse(count));
    counts
}

/// The states of the planned taps, and the flags of the archived ones.
pub(crate) fn ledger(shoulders: &[(String, &Shoulder)], refusals: &[(String, usize)]) -> Markup {
    const STATES: [TapState; 3] = [TapState::Archived, TapState::Refused, TapState::Missing];
    let taps = || shoulders.iter().flat_map(|(_, shoulder)| &shoulder.taps);
    let flags = flags(taps());
    let counts = |shoulder: &Shoulder| STATES.map(|state| shoulder.count(state));
    let total = shoulders.iter().map(|(_, shoulder)| counts(shoulder));
    let total = total.fold([0; 3], |sum, counts| [0, 1, 2].map(|k| sum[k] + counts[k]));
    html! {
        div class="scroll" { table {
            thead { tr { th { "" } th class="n" { "planned" } @for state in STATES { th class="n" { (state.name()) } } } }
            tbody {
                @for (name, shoulder) in shoulders {
                    tr {
                        td class="tyre" { (name) } td class="n" { (shoulder.taps.len()) }
                        @for count in counts(shoulder) { td class="n" { (count) } }
                    }
                }
                @if shoulders.len() > 1 {
                    tr { th { "all" } th class="n" { (taps().count()) } @for count in total { th class="n" { (count) } } }
                }
            }
        } }
        @if !refusals.is_empty() {
            div class="scroll" { table {
                thead { tr { th { "reason for refusal" } th class="n" { "taps" } } }
                tbody { @for (reason, count) in refusals { tr { td { (reason) } td class="n" { (count) } } } }
            } }
        }
        @if flags.is_empty() {
            p { "No archived tap has a quality flag." }
        } @else {
            div class="scroll" { table {
                thead { tr { th { "flag" } th { "what it means for a tap" } th class="n" { "taps" } } }
                tbody {
                    @for (flag, count) in flags { tr { td { code { (flag) } } td { (flag.meaning()) } td class="n" { (count) } } }
                }
            } }
        }
    }
}

/// Who made the scan, with what, and what its verdicts are based on: name and text of each row of the list at the top. An empty text is
/// not stated.
pub(crate) fn made_by(evidence: &Evidence) -> [(&'static str, Markup); 6] {
    let printed = &evidence.config.report;
    let stated = |text: &Option<String>| html! { (text.as_deref().unwrap_or_default()) };
    [
        ("Plant", html! { (printed.place()) }),
        ("Operator", stated(&printed.operator)),
        ("Procedure", stated(&printed.procedure)),
        ("Calibration", calibration(evidence)),
        ("Based on", based_on(evidence)),
        ("Program", html! { "tapline " (evidence.written_by.as_deref().unwrap_or("(unknown)")) }),
    ]
}

/// The row that says which shoulders were not compared with the reference, if there are any.
pub(crate) fn by_itself(evidence: &Evidence) -> Markup {
    let count = evidence.shoulders().filter(|shoulder| shoulder.reasons.contains(BY_ITS_CASING)).count();
    html! {
        @if count > 0 {
            dt { "But" } dd { (counted(count, "shoulder was", "shoulders were")) " compared with the casing itself, because of scatter_off" }
        }
    }
}

fn calibration(evidence: &Evidence) -> Markup {
    let recording = &evidence.recording;
    html! {
        @for (order, &channel) in recording.channels.iter().enumerate() {
            @if order > 0 { "; " }
            (channel.name()) " "
            @match &recording.calibration.of(channel).certificate {
                Some(certificate) => {
                    "in " (recording.calibration.unit(channel).name()) ", " (certificate.method)
                    @if let Some(until) = &certificate.valid_until { ", " (certificate.date) ", valid until " (until) }
                }
                None if recording.calibration.unit(channel).is_known() => { "in " (recording.calibration.unit(channel).name()) ", not calibrated" }
                None => "not calibrated: parts of full scale (FS)",
            }
        }
    }
}

fn based_on(evidence: &Evidence) -> Markup {
    let printed = &evidence.config.report;
    html! {
        @match (&evidence.config.fuse.reference, &evidence.reference) {
            (Some(Reference::Own), _) => "only itself: damage all round would not show",
            (Some(reference), Some(set)) => {
                (reference) ", " (counted(set.summary.casing_count, "casing", "casings")) " taken to be sound"
                @if !set.summary.standing_out.is_empty() {
                    " (" (set.summary.standing_out.join(", ")) ": stands out from the others and may be cracked)"
                }
                @match set.summary.supported_rate {
                    Some(rate) => { ", which support a rate of false calls of " (percent(rate)) " %" }
                    None => ", which supports no rate of false calls",
                }
            }
            (Some(reference), None) => (reference),
            (None, _) => "no named reference",
        }
        @match (printed.a90_95_mm, &printed.a90_95_source) {
            (Some(mm), Some(source)) => { ". Of cracks of " (number(mm)) " mm or longer, 90 % are found, with 95 % confidence (" (source) ")" }
            _ => { ". The smallest crack that is reliably found is not known (" code { "tapline-lab pod" } " estimates it)" }
        }
        "."
    }
}

/// `rate` in percent, to three significant digits.
fn percent(rate: f64) -> String {
    let percent = 100.0 * rate;
    if percent.is_normal() {
        let unit = 10_f64.powf(percent.abs().log10().floor() - 2.0);
        number((percent / unit).round() * unit)
    } else {
        number(percent)
    }
}

/// The origin of the numbers.
pub(crate) fn lineage(evidence: &Evidence) -> Markup {
    let recording = &evidence.recording;
    let channels: Vec<&str> = recording.channels.iter().map(|channel| channel.name()).collect();
    html! {
        dl {
            dt { "Archive" } dd { (evidence.archive) @if evidence.others > 0 { ", " (evidence.others + 1) " archives; what follows describes the first" } }
            dt { "Plan digest" } dd { code { (format!("{:016x}", evidence.plan_digest)) } }
            @if evidence.source_digest != 0 { dt { "Source digest" } dd { code { (format!("{:016x}", evidence.source_digest)) } } }
            dt { "Taps from" } dd { (evidence.source.map_or("unknown", |source| source.name())) }
            dt { "Recorded" } dd { (channels.join(" and ")) " at " (recording.sample_rate_hz) " Hz, up to " (recording.sample_count_max) " samples per channel, " (recording.pre_trigger_samples) " before the trigger" }
            dt { "Program" } dd { "archive by tapline " (evidence.written_by.as_deref().unwrap_or("(unknown)")) ", report by tapline " (env!("CARGO_PKG_VERSION")) }
            dt { "Lineage" } dd { code { (evidence.lineage_key) } }
            dt { "Compared with" } dd {
                @match &evidence.config.fuse.reference {
                    Some(Reference::Own) => "self (each tyre with itself)",
                    Some(reference) => (reference),
                    None => "no named reference",
                }
                @if let Some(set) = &evidence.reference { ", kept in the archive, digest " code { (set.digest()) } }
            }
            @if let Some([re_inspect, reject]) = evidence.shoulders().find_map(|shoulder| shoulder.rates) {
                dt { "False calls" } dd { "the limits are set so that " (percent(re_inspect)) " % of sound shoulders do not pass and " (percent(reject)) " % are rejected" }
            }
        }
        details { summary { "Configuration in the archive" } pre { (evidence.config_toml) } }
    }
}

/// First and last time of `taps`, as text. A recording from elsewhere has no time: it has the epoch instead.
pub(crate) fn when<'a>(taps: impl Iterator<Item = &'a Tap>) -> String {
    between(taps.filter_map(|tap| tap.time_ns))
}

fn between(times_ns: impl Iterator<Item = i64>) -> String {
    let (unknown, known): (Vec<i64>, Vec<i64>) = times_ns.partition(|&time_ns| time_ns == 0);
    let others = if unknown.is_empty() { "" } else { ", some at a time that was not recorded" };
    match known.iter().min().zip(known.iter().max()) {
        None if unknown.is_empty() => "at no time yet".to_owned(),
        None => "at a time that was not recorded".to_owned(),
        Some((first, last)) if first == last => format!("{}{others}", words::moment(*first)),
        Some((first, last)) => format!("{} to {}{others}", words::moment(*first), words::moment(*last)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a shift that seems to have begun in 1970 because some of its recordings have no time.
    #[test]
    fn unknown_times_are_no_times() {
        let (one, two) = (1_767_225_600_000_000_000, 1_767_225_640_000_000_000);
        let said =
            [vec![], vec![0, 0], vec![one], vec![two, one], vec![0, two, one]].map(|all| between(all.into_iter()));
        let [first, last] = [one, two].map(words::moment);
        let range = format!("{first} to {last}");
        let unknown = "at a time that was not recorded";
        assert_eq!(said[..4], ["at no time yet", unknown, &first, &range]);
        assert_eq!(said[4], format!("{range}, some {unknown}"));
    }

    /// Catches a rate with the noise of its division, and one that is rounded to nothing.
    #[test]
    fn a_rate_has_three_significant_digits() {
        let shown = [1.0 / 9.0, 0.02, 0.001, 0.000_123_45, 0.999_9, 0.0, 1.0].map(percent);
        assert_eq!(shown, ["11.1", "2", "0.1", "0.0123", "100", "0", "100"]);
    }
}
