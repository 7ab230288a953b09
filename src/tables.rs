//! The verbs that read and print: the state of an archive, tables of the dissertation.

use std::io::{self, Write};
use std::path::Path;

use anyhow::Result;
use serde_json::json;
use tapline_model::EffectiveLength;
use tapline_wire::TapState;

use crate::cli::Length;

pub(crate) fn verify(archive: &Path, as_json: bool) -> Result<bool> {
    let report = tapline_store::verify(archive)?;
    let count = |state| report.ledger.count(state);
    let (archived, refused, missing) = (count(TapState::Archived), count(TapState::Refused), count(TapState::Missing));
    let is_whole = report.is_complete() && refused == 0;
    let mut out = io::stdout().lock();
    if as_json {
        let problems: Vec<String> = report.problems.iter().map(ToString::to_string).collect();
        let text = json!({
            "archive": archive.display().to_string(),
            "plan_digest": format!("{:016x}", report.plan_digest),
            "archived": archived,
            "refused": refused,
            "missing": missing,
            "scans": report.ledger.scans().len(),
            "is_judged": report.ledger.is_judged(),
            "problems": problems,
            "is_whole": is_whole,
        });
        writeln!(out, "{text:#}")?;
        return Ok(is_whole);
    }
    for problem in &report.problems {
        writeln!(out, "{problem}")?;
    }
    let judged = if report.ledger.is_judged() { "all scans judged" } else { "scans without verdict" };
    let whole = if is_whole { "whole" } else { "NOT WHOLE" };
    writeln!(
        out,
        "{}: {whole}: {archived} archived, {refused} refused, {missing} missing; {judged}; {} problems",
        archive.display(),
        report.problems.len()
    )?;
    Ok(is_whole)
}

pub(crate) fn model(number: u8, length: Length) -> Result<bool> {
    let rule = match length {
        Length::Published => EffectiveLength::Published,
        Length::Table1 => EffectiveLength::Table1,
    };
    let table = tapline_model::table(number, rule)?;
    let mut out = csv::Writer::from_writer(io::stdout().lock());
    out.write_record(&table.columns)?;
    for row in &table.rows {
        out.write_record(row.iter().map(ToString::to_string))?;
    }
    out.flush()?;
    Ok(true)
}
