//! The verbs that read and print: the state of an archive, tables of the dissertation.

use std::io::{self, Write};
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use serde_json::json;
use tapline_model::EffectiveLength;
use tapline_store::{Codec, Repacked};
use tapline_wire::TapState;

use crate::cli::{Length, PackedBy};

/// What a check ends with that has found something.
const INCOMPLETE: i32 = crate::INCOMPLETE as i32;

/// Checks an archive in a process of its own: where its structure is damaged, the HDF5 library may bring that process down,
/// and this one tells.
pub(crate) fn verify(archive: &Path, as_json: bool) -> Result<bool> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut child = Command::new(program);
    child.arg("verify").arg(archive).arg("--here").args(as_json.then_some("--json"));
    let done = child.output().context("cannot start the check")?;
    io::stdout().write_all(&done.stdout)?;
    match (done.status.code(), done.status.signal()) {
        (Some(0), _) => Ok(true),
        (Some(INCOMPLETE), _) => {
            io::stderr().write_all(&done.stderr)?;
            Ok(false)
        }
        (_, Some(signal)) => {
            let died = format!("the HDF5 library fell over it (signal {signal}): its structure is damaged");
            tell_unreadable(archive, &died, as_json)
        }
        _ => {
            let told = String::from_utf8_lossy(&done.stderr);
            bail!("{}", told.trim().trim_start_matches("tapline: "))
        }
    }
}

/// Tells of an archive that is damaged so that it cannot be checked row by row.
fn tell_unreadable(archive: &Path, why: &str, as_json: bool) -> Result<bool> {
    let mut out = io::stdout().lock();
    match as_json {
        true => {
            let text = json!({ "archive": archive.display().to_string(), "problems": [why], "is_whole": false });
            writeln!(out, "{text:#}")?;
        }
        false => writeln!(out, "{why}\n{}: NOT WHOLE", archive.display())?,
    }
    Ok(false)
}

/// Checks an archive in this process.
pub(crate) fn verify_here(archive: &Path, as_json: bool) -> Result<bool> {
    use tapline_store::Error;
    let report = match tapline_store::verify(archive) {
        Err(error @ (Error::Damaged { .. } | Error::Hdf5 { .. } | Error::NotARun { .. })) => {
            return tell_unreadable(archive, &error.to_string(), as_json);
        }
        report => report?,
    };
    let count = |state| report.ledger.count(state);
    let (archived, refused, missing) = (count(TapState::Archived), count(TapState::Refused), report.missing_count);
    let later = count(TapState::Missing) - missing;
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
            "in_later_files": later,
            "scans": report.ledger.scans().len(),
            "is_judged": report.is_judged(),
            "problems": problems,
            "is_whole": is_whole,
        });
        writeln!(out, "{text:#}")?;
        return Ok(is_whole);
    }
    for problem in &report.problems {
        writeln!(out, "{problem}")?;
    }
    let judged = if report.is_judged() { "all scans judged" } else { "scans without verdict" };
    let whole = if is_whole { "whole" } else { "NOT WHOLE" };
    let later = if later > 0 { format!(", {later} in later files of the run") } else { String::new() };
    writeln!(
        out,
        "{}: {whole}: {archived} archived, {refused} refused, {missing} missing{later}; {judged}; {} problems",
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

pub(crate) fn repack(archive: &Path, codec: Codec, out: &Path) -> Result<bool> {
    let Repacked { sample_bytes, before_bytes, after_bytes } = tapline_store::repack(archive, out, codec)?;
    let mb = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    #[expect(clippy::cast_precision_loss, reason = "a ratio for people to read")]
    let ratio = sample_bytes as f64 / after_bytes as f64;
    let (samples, before, after) = (mb(sample_bytes), mb(before_bytes), mb(after_bytes));
    writeln!(
        io::stdout(),
        "{}: {after}, from {before}; {samples} of samples, {ratio:.2} times the file",
        out.display()
    )?;
    Ok(true)
}

impl From<PackedBy> for Codec {
    fn from(by: PackedBy) -> Self {
        match by {
            PackedBy::None => Self::None,
            PackedBy::Lz4 => Self::Lz4,
            PackedBy::Zstd => Self::Zstd,
            PackedBy::Lzf => Self::Lzf,
            PackedBy::Gzip => Self::Gzip,
        }
    }
}
