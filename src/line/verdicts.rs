//! The verdict on a casing when its file is closed: that on each shoulder, for people and for programs.

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use tapline_store::{Reader, regions};
use tapline_wire::{DamageCell, Judgement, Reasons, Scan, TapState, Verdict};

/// The result of one casing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CasingVerdict {
    /// The kind of this line of JSON: `verdict`.
    pub kind: String,
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

/// The verdict on one shoulder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ShoulderVerdict {
    pub tyre: String,
    pub shoulder: u16,
    pub station: u16,
    pub verdict: Verdict,
    pub reasons: String,
    pub regions: usize,
    pub peak_damage_index: Option<f64>,
    pub peak_location: Option<u32>,
    /// How far the strongest arc stands out, which the limits are for.
    pub strongest_arc: Option<f64>,
    pub limit_re_inspect: Option<f64>,
    pub limit_reject: Option<f64>,
}

impl CasingVerdict {
    /// The verdict in the finished file at `path`, of the casing `name`.
    pub(crate) fn read(name: &str, path: &Path) -> Result<Self> {
        let reader = Reader::open(path)?;
        let (plan, ledger) = (reader.plan(), reader.ledger());
        let judgements = reader.judgements()?;
        let shoulders: Vec<ShoulderVerdict> = plan
            .scans()
            .iter()
            .zip(judgements)
            .map(|(scan, judged)| ShoulderVerdict::new(&reader, scan, judged))
            .collect();
        let worst = shoulders.iter().map(|s| s.verdict).max().unwrap_or(Verdict::ReInspect);
        Ok(Self {
            kind: "verdict".to_owned(),
            casing: name.to_owned(),
            station: plan.scans().first().map_or(0, |scan| scan.station),
            verdict: worst,
            shoulders,
            archived: ledger.count(TapState::Archived),
            refused: ledger.count(TapState::Refused),
            missing: ledger.count(TapState::Missing),
            file: path.to_owned(),
        })
    }

    /// Prints it: a line for each shoulder, or one of JSON for all.
    pub(crate) fn print(&self, as_json: bool) -> Result<()> {
        let mut out = io::stdout().lock();
        if as_json {
            writeln!(out, "{}", serde_json::to_string(self)?).context("cannot print the verdict")?;
        } else {
            for shoulder in &self.shoulders {
                writeln!(out, "{}", self.line(shoulder)).context("cannot print the verdict")?;
            }
        }
        out.flush().context("cannot print the verdict")
    }

    fn line(&self, shoulder: &ShoulderVerdict) -> String {
        let ShoulderVerdict { tyre, shoulder: number, verdict, reasons, .. } = shoulder;
        let mut line = format!("{:<10} {tyre}/{number}", verdict.to_string());
        if let (Some(arc), Some(limit)) = (shoulder.strongest_arc, shoulder.limit_reject) {
            line.push_str(&format!("  strongest arc {arc:.2}, reject from {limit:.2}"));
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
    pub(crate) fn new(reader: &Reader, scan: &Scan, judged: Option<(Judgement, Vec<DamageCell>)>) -> Self {
        let mut line = Self {
            tyre: scan.tyre.to_string(),
            shoulder: scan.shoulder,
            station: scan.station,
            verdict: Verdict::ReInspect,
            reasons: Reasons::NOT_ENDED.to_string(),
            regions: 0,
            peak_damage_index: None,
            peak_location: None,
            strongest_arc: None,
            limit_re_inspect: None,
            limit_reject: None,
        };
        if let Some((judgement, cells)) = judged {
            // Of equals the first, as everywhere.
            let peak = cells
                .iter()
                .filter(|cell| !cell.damage_index.is_nan())
                .rev()
                .max_by(|a, b| a.damage_index.total_cmp(&b.damage_index));
            line.verdict = Verdict::from_code(judgement.verdict).unwrap_or(Verdict::ReInspect);
            line.reasons = judgement.reasons.to_string();
            line.regions = regions(reader.plan().geometry, &cells).len();
            line.peak_damage_index = peak.map(|cell| cell.damage_index);
            line.peak_location = peak.map(|cell| cell.location);
            let known = |value: f64| Some(value).filter(|value| value.is_finite());
            line.strongest_arc = known(judgement.strongest_arc);
            line.limit_re_inspect = known(judgement.limit_re_inspect);
            line.limit_reject = known(judgement.limit_reject);
        }
        line
    }
}
