//! `tapline verify`: checks that archives are complete and unaltered.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use serde_json::{Value, json};
use tapline_host::colour::Colour;
use tapline_host::messages::counted;
use tapline_host::stdout::Stdout;
use tapline_store::{Error, Reader, Report, hex_of};
use tapline_wire::TapState;

use crate::archives::work::Work;
use crate::archives::{Archives, Which};

/// Checks the archives at `paths`.
pub(crate) fn verify(paths: &[PathBuf], as_json: bool) -> Result<bool> {
    let archives = Archives::find(paths, Which::All)?;
    let mut work = Work::on(&archives);
    let (mut incomplete, mut damaged) = (0, 0);
    for file in &archives.files {
        work.begin(file);
        let found = check(&file.path, as_json, &mut work);
        match work.take(file, found)? {
            Some(Found::Complete) => {}
            Some(Found::Incomplete) => incomplete += 1,
            Some(Found::Damaged) | None => damaged += 1,
        }
    }
    work.note(incomplete == 0 && archives.unfinished.is_empty());
    if archives.is_many {
        work.beside(|| sum_up(&archives, incomplete, damaged, as_json))?;
    }
    let is_complete = work.end()?;
    ensure!(damaged == 0, "{} altered or unreadable", counted(damaged, "archive is", "archives are"));
    Ok(is_complete)
}

/// What an archive is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Found {
    Complete,
    /// A tap is missing or refused, a scan has no verdict, or it is not finished; what is there is as it was written.
    Incomplete,
    Damaged,
}

fn sum_up(archives: &Archives, incomplete: usize, damaged: usize, as_json: bool) -> Result<()> {
    let (count, unfinished) = (archives.files.len(), &archives.unfinished);
    let complete = count - incomplete - damaged;
    let mut out = Stdout;
    if as_json {
        let text = json!({
            "kind": "summary",
            "archives": count,
            "complete": complete,
            "incomplete": incomplete,
            "damaged": damaged,
            "unfinished": unfinished.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
            "is_complete": complete == count && unfinished.is_empty(),
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
    writeln!(out, "{archives}: {complete} complete, {incomplete} incomplete, {damaged} damaged{besides}")?;
    Ok(())
}

/// Checks an archive, and prints the report.
fn check(archive: &Path, as_json: bool, work: &mut Work) -> Result<Found> {
    let checked = tapline_store::verify_with(archive, |part| work.note_part(part));
    work.beside(|| print(archive, checked, as_json))
}

/// Prints what was found in an archive.
fn print(archive: &Path, checked: tapline_store::Result<Report>, as_json: bool) -> Result<Found> {
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
            return Ok(Found::Damaged);
        }
        report => report?,
    };
    let found = match (is_complete(&report), report.problems.is_empty()) {
        (true, _) => Found::Complete,
        (false, true) => Found::Incomplete,
        (false, false) => Found::Damaged,
    };
    let mut problems: Vec<String> = report.problems.iter().map(ToString::to_string).collect();
    if !report.is_finished {
        problems.push(Error::NotFinished { path: archive.to_owned() }.to_string());
    }
    if as_json {
        writeln!(out, "{}", json_of(archive, Some(&report), &problems))?;
        return Ok(found);
    }
    let count = |state| report.ledger.count(state);
    let [archived, refused, missing] = [TapState::Archived, TapState::Refused, TapState::Missing].map(count);
    let file = archive.display().to_string();
    for problem in &problems {
        let is_named = problem.contains(&file);
        writeln!(out, "{}{problem}", if is_named { String::new() } else { format!("{file}: ") })?;
    }
    let judged = match found {
        _ if report.is_judged() => "all scans judged",
        Found::Damaged => "scans without a valid verdict",
        Found::Complete | Found::Incomplete => "scans without a verdict",
    };
    let state = match found {
        Found::Complete => Colour::Good.on_stdout("complete"),
        Found::Incomplete if !report.is_finished => Colour::Doubtful.on_stdout("NOT FINISHED"),
        Found::Incomplete => Colour::Doubtful.on_stdout("INCOMPLETE"),
        Found::Damaged => Colour::Bad.on_stdout("DAMAGED"),
    };
    writeln!(
        out,
        "{file}: {state}: {archived} archived, {refused} refused, {missing} missing; {judged}; {}{}",
        counted(problems.len(), "problem", "problems"),
        identity(archive).map_or_else(String::new, |[casing, raw, lineage]| format!(
            "; casing {casing}, taps {}, results {}",
            &raw[..12],
            &lineage[..lineage.len().min(12)]
        ))
    )?;
    Ok(found)
}

/// Whose casing the archive is of, whatever the name of its file, the digest of its taps, and the key of its results: to be compared with what
/// was written down before.
fn identity(archive: &Path) -> Option<[String; 3]> {
    let reader = Reader::open_unfinished(archive).ok()?;
    let casings: BTreeSet<&str> = reader.plan().scans().iter().map(|scan| scan.tyre.as_str()).collect();
    let casings = casings.into_iter().collect::<Vec<_>>().join(" and ");
    Some([casings, hex_of(&reader.raw_digest().ok()?), reader.lineage_key().ok()?])
}

/// As JSON; without a report if the archive cannot be read.
fn json_of(archive: &Path, report: Option<&Report>, problems: &[String]) -> Value {
    let count = |state| report.map(|report| report.ledger.count(state));
    let identity = report.and_then(|_| identity(archive));
    let [casing, raw_digest, lineage] = [0, 1, 2].map(|k| identity.as_ref().map(|identity| &identity[k]));
    json!({
        "archive": archive.display().to_string(),
        "casing": casing,
        "raw_digest": raw_digest,
        "lineage": lineage,
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
