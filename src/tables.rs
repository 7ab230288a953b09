//! The verbs that read and print: tables of an archive, its state, tables of the dissertation.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use serde_json::json;
use tapline_model::EffectiveLength;
use tapline_store::{Export, Reader};
use tapline_wire::TapState;

use crate::cli::{Format, Length, Table};

pub(crate) fn export(archive: &Path, table: Table, format: Format, out: Option<&Path>) -> Result<bool> {
    let Format::Csv = format;
    let table = match table {
        Table::Discriminators => Export::Discriminators,
        Table::Damage => Export::Damage,
        Table::Regions => Export::Regions,
        Table::Verdicts => Export::Verdicts,
        Table::Ledger => Export::Ledger,
    };
    let reader = Reader::open(archive)?;
    match out {
        None => quiet_pipe(tapline_store::export(&reader, table, BufWriter::new(io::stdout().lock())))?,
        Some(path) => {
            // Whole or not at all: what stands at `path` is replaced at the end, and never if it is the archive.
            if path.canonicalize().is_ok_and(|path| Some(path) == archive.canonicalize().ok()) {
                bail!("--out {} is the archive itself", path.display());
            }
            let draft = path.with_added_extension("new");
            let context = || format!("cannot write {}", path.display());
            let file = File::create(&draft).with_context(context)?;
            tapline_store::export(&reader, table, BufWriter::new(file)).with_context(context)?;
            fs::rename(&draft, path).with_context(context)?;
        }
    }
    Ok(true)
}

/// A reader that has seen enough, as `head` has, is no failure.
fn quiet_pipe(written: tapline_store::Result<()>) -> Result<()> {
    match written {
        Err(tapline_store::Error::Csv(error)) if matches!(error.kind(), csv::ErrorKind::Io(e) if e.kind() == io::ErrorKind::BrokenPipe) => {
            Ok(())
        }
        other => Ok(other?),
    }
}

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
