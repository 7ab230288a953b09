//! `tapline verify`: checks that archives are complete and unaltered.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::{Value, json};
use tapline_host::colour::Colour;
use tapline_host::messages::counted;
use tapline_store::{Error, Report};
use tapline_wire::TapState;

use crate::archives::{ArchiveProgress, Archives, Outcome, Which};
use tapline_host::stdout::Stdout;

/// Checks the archives at `paths`.
pub(crate) fn verify(paths: &[PathBuf], as_json: bool) -> Result<bool> {
    let archives = Archives::find(paths, Which::All)?;
    let mut progress = ArchiveProgress::new(&archives);
    let mut outcome = Outcome::new(&archives);
    let mut hurt = 0;
    for file in &archives.files {
        progress.begin(file);
        let is_complete = outcome.take(file, check(&file.path, as_json, &mut progress))?;
        hurt += usize::from(is_complete != Some(true));
    }
    drop(progress);
    outcome.note(hurt == 0 && archives.unfinished.is_empty());
    if archives.is_many {
        sum_up(&archives, hurt, as_json)?;
    }
    // An archive that cannot be read is incomplete, even if none can be read.
    Ok(outcome.end().unwrap_or(false))
}

fn sum_up(archives: &Archives, hurt: usize, as_json: bool) -> Result<()> {
    let (count, unfinished) = (archives.files.len(), &archives.unfinished);
    let mut out = Stdout;
    if as_json {
        let text = json!({
            "kind": "summary",
            "archives": count,
            "complete": count - hurt,
            "unfinished": unfinished.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
            "is_complete": hurt == 0 && unfinished.is_empty(),
        });
        writeln!(out, "{text}")?;
        return Ok(());
    }
    for path in unfinished {
        writeln!(out, "{}: NOT FINISHED", path.display())?;
    }
    let archives = counted(count, "archive", "archives");
    let besides = match unfinished.len() {
        0 => String::new(),
        some => format!("; in addition, {} not finished", counted(some, "file is", "files are")),
    };
    writeln!(out, "{archives}: {} complete, {hurt} not{besides}", count - hurt)?;
    Ok(())
}

/// Checks an archive, and prints the report.
fn check(archive: &Path, as_json: bool, progress: &mut ArchiveProgress) -> Result<bool> {
    let checked = tapline_store::verify_with(archive, |part| progress.note_part(part));
    progress.beside(|| print(archive, checked, as_json))
}

/// Prints what was found in an archive; whether it is complete.
fn print(archive: &Path, checked: tapline_store::Result<Report>, as_json: bool) -> Result<bool> {
    let mut out = Stdout;
    let report = match checked {
        // It cannot be checked row by row.
        Err(
            error @ (Error::Damaged { .. }
            | Error::Hdf5 { .. }
            | Error::NotHdf5 { .. }
            | Error::NotAnArchive { .. }
            | Error::FormatVersion { .. }
            | Error::OtherUnits { .. }
            | Error::OtherTaps { .. }),
        ) => {
            match as_json {
                true => writeln!(out, "{}", json_of(archive, None, &[error.to_string()]))?,
                false => writeln!(out, "{error}\n{}: UNREADABLE", archive.display())?,
            }
            return Ok(false);
        }
        report => report?,
    };
    let is_complete = is_complete(&report);
    let mut problems: Vec<String> = report.problems.iter().map(ToString::to_string).collect();
    if !report.is_finished {
        problems.push(Error::NotFinished { path: archive.to_owned() }.to_string());
    }
    if as_json {
        writeln!(out, "{}", json_of(archive, Some(&report), &problems))?;
        return Ok(is_complete);
    }
    let count = |state| report.ledger.count(state);
    let [archived, refused, missing] = [TapState::Archived, TapState::Refused, TapState::Missing].map(count);
    let file = archive.display().to_string();
    for problem in &problems {
        let is_named = problem.contains(&file);
        writeln!(out, "{}{problem}", if is_named { String::new() } else { format!("{file}: ") })?;
    }
    let judged = if report.is_judged() { "all scans judged" } else { "scans without a verdict" };
    let state = match (is_complete, report.problems.is_empty()) {
        (true, _) => Colour::Good.on_stdout("complete"),
        (false, true) if !report.is_finished => Colour::Bad.on_stdout("NOT FINISHED"),
        (false, true) => Colour::Bad.on_stdout("INCOMPLETE"),
        (false, false) => Colour::Bad.on_stdout("DAMAGED"),
    };
    writeln!(
        out,
        "{file}: {state}: {archived} archived, {refused} refused, {missing} missing; {judged}; {}",
        counted(problems.len(), "problem", "problems")
    )?;
    Ok(is_complete)
}

/// As JSON; without a report if the archive cannot be read.
fn json_of(archive: &Path, report: Option<&Report>, problems: &[String]) -> Value {
    let count = |state| report.map(|report| report.ledger.count(state));
    json!({
        "archive": archive.display().to_string(),
        "plan_digest": report.map(|report| format!("{:016x}", report.plan_digest)),
        "archived": count(TapState::Archived),
        "refused": count(TapState::Refused),
        "missing": count(TapState::Missing),
        "scans": report.map(|report| report.ledger.scans().len()),
        "is_judged": report.map(Report::is_judged),
        "problems": problems,
        "is_finished": report.map(|report| report.is_finished),
        "is_complete": report.is_some_and(is_complete),
    })
}

fn is_complete(report: &Report) -> bool {
    report.is_complete() && report.ledger.count(TapState::Refused) == 0
}
