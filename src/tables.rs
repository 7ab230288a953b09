//! The verbs that read and print: the state of an archive, tables of the dissertation.

use std::io::{self, Write};
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use crossbeam::channel::{RecvTimeoutError, bounded};
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};
use serde_json::json;
use tapline_model::EffectiveLength;
use tapline_store::{Codec, Repacked};
use tapline_wire::TapState;

use crate::cli::{Length, PackedBy};

/// What a check ends with that has found something.
const INCOMPLETE: i32 = crate::INCOMPLETE as i32;

/// Seconds that a check may take, and bytes that it goes through in another one at least: no disk is as slow.
const CHECK_S: u64 = 10;
const CHECK_BYTES_PER_S: u64 = 1_000_000;

/// Checks an archive in a process of its own: where its structure is damaged, the HDF5 library may bring that process down or
/// go round in it for ever, and this one tells.
pub(crate) fn verify(archive: &Path, as_json: bool) -> Result<bool> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut child = Command::new(program);
    child.arg("verify").arg(archive).arg("--here").args(as_json.then_some("--json"));
    child.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let limit = Duration::from_secs(CHECK_S + bytes_beside(archive) / CHECK_BYTES_PER_S);
    let Some(done) = output_within(child, limit)? else {
        let hung = format!("the HDF5 library did not come to an end with it in {limit:.0?}: its structure is damaged");
        return tell_unreadable(archive, &hung, as_json);
    };
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

/// Bytes of `archive`, and of all that may be archives with its taps: in its folder, or in the folder of that folder.
fn bytes_beside(archive: &Path) -> u64 {
    let first = |path: &Path| path.file_name().and_then(|name| name.to_str()?.split('.').next().map(str::to_owned));
    // A name without a folder is one in this folder.
    let whole = std::path::absolute(archive).unwrap_or_else(|_| archive.to_owned());
    let is_meant = |path: &Path| path.extension().is_some_and(|end| end == "h5") || first(path) == first(&whole);
    let files = whole.ancestors().take(3).flat_map(std::fs::read_dir).flatten().flatten().map(|file| file.path());
    let beside = files.filter(|path| is_meant(path) && *path != whole);
    beside.chain([whole.clone()]).filter_map(|path| path.metadata().ok()).map(|file| file.len()).sum()
}

/// What `command` puts out; `None` where it took longer than `limit`, and was ended.
fn output_within(mut command: Command, limit: Duration) -> Result<Option<Output>> {
    let child = command.spawn().context("cannot start the check")?;
    let pid = Pid::from_child(&child);
    let (tell, ended) = bounded::<()>(1);
    let watch = move || {
        let is_late = ended.recv_timeout(limit) == Err(RecvTimeoutError::Timeout);
        if is_late {
            // It is there: nobody has asked how it ended.
            let _gone = kill_process(pid, Signal::KILL);
        }
        is_late
    };
    let watch = std::thread::Builder::new().name("limit".to_owned()).spawn(watch).context("cannot watch the check")?;
    let done = child.wait_with_output();
    drop(tell);
    let is_late = watch.join().unwrap_or(false);
    let done = done.context("cannot hear the check")?;
    Ok((!is_late || done.status.signal().is_none()).then_some(done))
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

/// Checks an archive in this process, which ends with the one that started it.
pub(crate) fn verify_here(archive: &Path, as_json: bool) -> Result<bool> {
    use tapline_store::Error;
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot ask to end with the check")?;
    let report = match tapline_store::verify(archive) {
        Err(
            error @ (Error::Damaged { .. } | Error::Hdf5 { .. } | Error::NotARun { .. } | Error::OtherUnits { .. }),
        ) => {
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
