//! The verdict on a casing whose file is closed, with that on each shoulder, for people and for programs.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use serde::{Deserialize, Serialize};
use tapline_host::colour::Colour;
use tapline_host::stdout::Stdout;
use tapline_store::{Judged, Reader, Region, casing_id, peak, regions};
use tapline_wire::{Channel, Judgement, Reasons, Scan, TapState, Verdict, monotonic_ns};

use crate::shown::refused::RefusedTaps;
use crate::shown::whole::Whole;

/// The result of one casing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CasingVerdict {
    /// The kind of this line of JSON: `verdict`.
    pub kind: String,
    /// Its id: no other casing has it, and every report of this verdict has the same.
    pub id: String,
    /// When the casing's file was finished, in ns since the Unix epoch.
    pub at_ns: i64,
    /// The casing's name.
    pub casing: String,
    pub station: u16,
    /// The worst of its shoulders.
    pub verdict: Verdict,
    pub shoulders: Vec<ShoulderVerdict>,
    pub archived: usize,
    pub refused: usize,
    pub missing: usize,
    /// Its file.
    pub file: PathBuf,
}

/// How a verdict is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// Verdict and name: the rest follows in a table.
    Short,
    Full,
    Json,
}

/// The verdict on one shoulder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ShoulderVerdict {
    pub tyre: String,
    pub shoulder: u16,
    pub station: u16,
    pub verdict: Verdict,
    pub reasons: String,
    #[serde(flatten)]
    pub whole: Whole,
    pub regions: usize,
    /// The regions: where damage lies.
    pub arcs: Vec<DamageArc>,
    /// The greatest damage index in the region of the strongest arc; without regions, in the shoulder.
    pub peak_damage_index: Option<f64>,
    /// Where it is.
    pub peak_location: Option<u32>,
    /// How far the strongest arc stands out; the limits apply to it.
    pub strongest_arc: Option<f64>,
    pub limit_re_inspect: Option<f64>,
    pub limit_reject: Option<f64>,
    /// Why taps of it were refused, for people who look at the line; not in the JSON of a verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused_taps: Option<RefusedTaps>,
}

/// Where a region of damage lies. Angles are in degrees, clockwise from the start mark, and absent on a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct DamageArc {
    pub first_location: u32,
    /// On a ring it may be less than the first.
    pub last_location: u32,
    pub peak_location: u32,
    /// Angle of the first location.
    pub start_deg: Option<f64>,
    /// Angle of the last location.
    pub end_deg: Option<f64>,
    pub peak_deg: Option<f64>,
    /// Its extent, in which each location counts as one step.
    pub extent_deg: Option<f64>,
}

/// Where `arcs` lie, for people: from the first to the last location of each, in degrees if they are known.
pub(crate) fn places(arcs: impl Iterator<Item = DamageArc>) -> String {
    let place = |arc: DamageArc| match (arc.start_deg, arc.end_deg) {
        (Some(start), Some(end)) => format!("{start:.0}° to {end:.0}°"),
        _ => format!("locations {} to {}", arc.first_location, arc.last_location),
    };
    arcs.map(place).collect::<Vec<_>>().join(", ")
}

impl From<&Region> for DamageArc {
    fn from(region: &Region) -> Self {
        Self {
            first_location: region.first_location,
            last_location: region.last_location,
            peak_location: region.peak_location,
            start_deg: region.start_deg,
            end_deg: region.end_deg,
            peak_deg: region.peak_angle_deg,
            extent_deg: region.extent_deg,
        }
    }
}

impl CasingVerdict {
    /// The verdict in the file of the casing `name` with this `number`, which was finished at `at_ns`.
    pub(crate) fn read(name: &str, number: u64, at_ns: i64, reader: &Reader) -> Result<Self> {
        let (plan, ledger) = (reader.plan(), reader.ledger());
        let shoulders = ShoulderVerdict::all(reader, true)?;
        let worst = shoulders.iter().map(|s| s.verdict).max().unwrap_or(Verdict::ReInspect);
        Ok(Self {
            kind: "verdict".to_owned(),
            id: casing_id(number),
            at_ns,
            casing: name.to_owned(),
            station: plan.scans().first().map_or(0, |scan| scan.station),
            verdict: worst,
            shoulders,
            archived: ledger.count(TapState::Archived),
            refused: ledger.count(TapState::Refused),
            missing: ledger.count(TapState::Missing),
            file: reader.path().to_owned(),
        })
    }

    /// The same as JSON, which `docs/verdict.schema.json` describes.
    pub(crate) fn json(&self) -> String {
        let mut verdict = self.clone();
        verdict.shoulders.iter_mut().for_each(|shoulder| shoulder.refused_taps = None);
        serde_json::to_string(&verdict).unwrap_or_default() // all keys are text, and a line refuses a folder whose name is not
    }

    /// Prints it: a short or full line for each shoulder, or one line of JSON for all.
    pub(crate) fn print(&self, form: Form) -> Result<()> {
        let lines: Vec<String> = match form {
            Form::Json => vec![self.json()],
            Form::Short => self.shoulders.iter().map(ShoulderVerdict::short).collect(),
            Form::Full => self.shoulders.iter().map(|shoulder| self.line(shoulder)).collect(),
        };
        // In one piece: the log may go to the same place.
        Stdout.write_all((lines.join("\n") + "\n").as_bytes())?;
        Ok(Stdout.flush()?)
    }

    fn line(&self, shoulder: &ShoulderVerdict) -> String {
        // The line says at its start that its rates are extrapolated; only a shoulder that scatters more has limits of its own.
        let said: &[&str] = if shoulder.reasons.contains("scatter_off") { &[] } else { &["extrapolated"] };
        let reasons = shoulder.why("|", said, &[]);
        let mut line = shoulder.short();
        if let (Some(arc), Some(re_inspect), Some(reject)) =
            (shoulder.strongest_arc, shoulder.limit_re_inspect, shoulder.limit_reject)
        {
            line.push_str(&format!(
                "  strongest arc {arc:.2}, re-inspect from {re_inspect:.2}, reject from {reject:.2}"
            ));
        }
        if !shoulder.arcs.is_empty() {
            line.push_str(&format!(", damage at {}", shoulder.places()));
        }
        if let Some(at) = shoulder.peak_location {
            line.push_str(&format!(", most at location {at}"));
        }
        if !reasons.is_empty() {
            line.push_str(&format!("  ({reasons})"));
        }
        line.push_str(&format!("  station {}  {}", self.station, self.file.display()));
        line
    }
}

impl ShoulderVerdict {
    /// The verdict on each shoulder of a casing: RE-INSPECT until it is judged. If `says_why`, also why taps of it were refused.
    pub(crate) fn all(reader: &Reader, says_why: bool) -> Result<Vec<Self>> {
        let unjudged =
            |number| (Judgement { reasons: reader.verdict(number, None).1, ..Judgement::default() }, Vec::new());
        let scans = reader.plan().scans().iter().zip(reader.judgements()?).enumerate();
        let verdict = |(number, (scan, judged)): (usize, (&Scan, Option<Judged>))| {
            let judged = judged.unwrap_or_else(|| unjudged(number));
            // Words for people: a verdict does not fail for them.
            let refused = || RefusedTaps::of(reader, scan, judged.0.absent_count).unwrap_or_default();
            let refused_taps = if says_why { refused() } else { None };
            Ok(Self { refused_taps, ..Self::new(reader, scan, &judged)? })
        };
        scans.map(verdict).collect()
    }

    pub(crate) fn new(reader: &Reader, scan: &Scan, (judgement, cells): &Judged) -> Result<Self> {
        let is_flagged = judgement.reasons.contains(Reasons::FLAGGED);
        let found = if is_flagged { reader.discriminators()? } else { Vec::new() };
        let qualities = || scan.taps.iter().filter_map(|&row| found[row as usize].map(|found| found.quality));
        let regions = regions(reader.plan().geometry, cells);
        let known = |value: f64| Some(value).filter(|value| value.is_finite());
        // Of the strongest region; without one, of the whole shoulder. What a second reading cleared is in no region.
        let strength = |region: &&Region| region.region_index.unwrap_or(f64::NEG_INFINITY);
        let at_peak = match regions.iter().rev().max_by(|a, b| strength(a).total_cmp(&strength(b))) {
            Some(region) => region.peak_damage_index.map(|index| (region.peak_location, index)),
            None => peak(cells).map(|cell| (cell.location, cell.damage_index)),
        };
        let arcs: Vec<_> = regions.iter().map(DamageArc::from).collect();
        Ok(Self {
            tyre: scan.tyre.to_string(),
            shoulder: scan.shoulder,
            station: scan.station,
            verdict: Verdict::from_code(judgement.verdict).unwrap_or(Verdict::ReInspect),
            reasons: judgement.reasons.to_string(),
            whole: Whole::new(judgement, qualities),
            regions: arcs.len(),
            arcs,
            peak_damage_index: at_peak.map(|(_, index)| index),
            peak_location: at_peak.map(|(location, _)| location),
            strongest_arc: known(judgement.strongest_arc),
            limit_re_inspect: known(judgement.limit_re_inspect),
            limit_reject: known(judgement.limit_reject),
            refused_taps: None,
        })
    }

    /// Where its regions lie, for people.
    pub(crate) fn places(&self) -> String {
        places(self.arcs.iter().cloned())
    }

    /// The verdict in colour, and its name.
    fn short(&self) -> String {
        let colour = match self.verdict {
            Verdict::Pass => Colour::Good,
            Verdict::ReInspect => Colour::Doubtful,
            Verdict::Reject => Colour::Bad,
        };
        let verdict = colour.on_stdout(&format!("{:<10}", self.verdict.to_string()));
        format!("{verdict} {}/{}", self.tyre, self.shoulder)
    }

    /// Its reasons except `but`, for people, with `between` them, each with its details unless it is one of `bare`; first why taps were
    /// refused, in place of the reasons that follow from that.
    pub(crate) fn why(&self, between: &str, but: &[&str], bare: &[&str]) -> String {
        let detail = |reason: &str| self.whole.detail(reason).filter(|_| !bare.contains(&reason));
        let with_detail = |reason: &str| match detail(reason) {
            Some(detail) => format!("{reason}: {detail}"),
            None => reason.to_owned(),
        };
        let refused = self.refused_taps.as_ref();
        let follows = |reason: &str| refused.is_some_and(|refused| refused.covers(reason));
        let reasons =
            self.reasons.split('|').filter(|reason| !but.contains(reason) && !follows(reason)).map(with_detail);
        let is_above = self.strongest_arc.zip(self.limit_re_inspect).is_some_and(|(arc, limit)| arc >= limit);
        let cleared = (self.verdict == Verdict::Pass && is_above).then(|| "cleared by the second reading".to_owned());
        let first = refused.map(|refused| refused.text.clone());
        first
            .into_iter()
            .chain(cleared)
            .chain(reasons)
            .filter(|reason| !reason.is_empty())
            .collect::<Vec<_>>()
            .join(between)
    }
}

/// Time since the last tap of a finished casing was sent, in seconds, by the monotonic clock of this machine; `None`
/// if no tap is archived.
pub(crate) fn since_last_tap_s(reader: &Reader) -> Result<Option<f64>> {
    let sent_ns = reader.headers()?.into_iter().flatten().map(|header| header.sent_ns).max();
    Ok(sent_ns.map(|sent_ns| monotonic_ns().saturating_sub(sent_ns) as f64 / 1e9))
}

/// Day of the casing's oldest calibration certificate, the last day of the one that ends first, and whether one was out of date;
/// computed samples need none.
pub(crate) fn calibration(reader: &Reader) -> (Option<String>, Option<String>, bool) {
    let recording = &reader.plan().recording;
    let channels = Channel::BOTH;
    let certificates = || channels.iter().filter_map(|&channel| recording.calibration.certificate(channel));
    let begun = certificates().map(|certificate| certificate.date.clone()).min();
    let ends = certificates().filter_map(|certificate| certificate.valid_until.clone()).min();
    (begun, ends, recording.calibration.is_out_of_date(&channels))
}
