//! `tapline verify`: whether archives are what was written, and whole.

use std::io::{self, Write};
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use crossbeam::channel::{RecvTimeoutError, bounded};
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};
use serde_json::{Value, json};
use tapline_wire::TapState;

use crate::archives::{Archives, Outcome, Which};

/// What a check ends with that has found something.
const INCOMPLETE: i32 = crate::INCOMPLETE as i32;

/// Seconds that a check may take, and bytes that it goes through in another one at least: no disk is as slow.
const CHECK_S: u64 = 10;
const CHECK_BYTES_PER_S: u64 = 1_000_000;

/// Checks the archives at `paths`, each in a process of its own; or, if it `is_here`, the one in this process.
pub(crate) fn verify(paths: &[PathBuf], as_json: bool, is_here: bool) -> Result<bool> {
    if let ([path], true) = (paths, is_here) {
        return verify_here(path, as_json);
    }
    let archives = Archives::find(paths, Which::All)?;
    if !archives.is_many {
        let Some(file) = archives.files.first() else { return Ok(false) };
        return check(&file.path, as_json, false);
    }
    let mut outcome = Outcome::of(&archives);
    let mut hurt = 0;
    for file in &archives.files {
        let is_whole = outcome.take(file, check(&file.path, as_json, true))?;
        hurt += usize::from(is_whole != Some(true));
    }
    outcome.note(hurt == 0 && archives.unfinished.is_empty());
    sum_up(&archives, hurt, as_json)?;
    // What cannot be read at all is not whole, also where that is so of every file.
    Ok(outcome.end().unwrap_or(false))
}

fn sum_up(archives: &Archives, hurt: usize, as_json: bool) -> Result<()> {
    let (count, unfinished) = (archives.files.len(), &archives.unfinished);
    let mut out = io::stdout().lock();
    if as_json {
        let text = json!({
            "kind": "summary",
            "archives": count,
            "whole": count - hurt,
            "unfinished": unfinished.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
            "is_whole": hurt == 0 && unfinished.is_empty(),
        });
        writeln!(out, "{text}")?;
        return Ok(());
    }
    for path in unfinished {
        writeln!(out, "{}: NOT FINISHED", path.display())?;
    }
    writeln!(out, "{count} archives: {} whole, {hurt} NOT WHOLE; {} not finished", count - hurt, unfinished.len())?;
    Ok(())
}

/// Checks an archive in a process of its own: where its structure is damaged, the HDF5 library may bring that process down or
/// go round in it for ever, and this one tells.
fn check(archive: &Path, as_json: bool, is_of_many: bool) -> Result<bool> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut child = Command::new(program);
    child.arg("verify").arg(archive).arg("--here").args(as_json.then_some("--json"));
    child.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let limit = Duration::from_secs(CHECK_S + bytes_beside(archive) / CHECK_BYTES_PER_S);
    let Some(done) = output_within(child, limit)? else {
        let hung = format!("the HDF5 library did not come to an end with it in {limit:.0?}: its structure is damaged");
        return tell_unreadable(archive, &hung, as_json, is_of_many);
    };
    match serde_json::from_slice::<Value>(&done.stdout) {
        // A line each, so that the reports of many can be told apart.
        Ok(report) if as_json && is_of_many => writeln!(io::stdout(), "{report}")?,
        _ => io::stdout().write_all(&done.stdout)?,
    }
    match (done.status.code(), done.status.signal()) {
        (Some(0), _) => Ok(true),
        (Some(INCOMPLETE), _) => {
            io::stderr().write_all(&done.stderr)?;
            Ok(false)
        }
        (_, Some(signal)) => {
            let died = format!("the HDF5 library fell over it (signal {signal}): its structure is damaged");
            tell_unreadable(archive, &died, as_json, is_of_many)
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
fn tell_unreadable(archive: &Path, why: &str, as_json: bool, is_of_many: bool) -> Result<bool> {
    let mut out = io::stdout().lock();
    match as_json {
        true => {
            let text = json!({ "archive": archive.display().to_string(), "problems": [why], "is_whole": false });
            if is_of_many { writeln!(out, "{text}")? } else { writeln!(out, "{text:#}")? }
        }
        false => writeln!(out, "{why}\n{}: NOT WHOLE", archive.display())?,
    }
    Ok(false)
}

/// Checks an archive in this process, which ends with the one that started it.
fn verify_here(archive: &Path, as_json: bool) -> Result<bool> {
    use tapline_store::Error;
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot ask to end with the check")?;
    let report = match tapline_store::verify(archive) {
        Err(
            error
            @ (Error::Damaged { .. } | Error::Hdf5 { .. } | Error::NotAnArchive { .. } | Error::OtherUnits { .. }),
        ) => {
            return tell_unreadable(archive, &error.to_string(), as_json, false);
        }
        report => report?,
    };
    let count = |state| report.ledger.count(state);
    let (archived, refused, missing) = (count(TapState::Archived), count(TapState::Refused), report.missing_count);
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
            "is_judged": report.is_judged(),
            "problems": problems,
            "is_finished": report.is_finished,
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
    writeln!(
        out,
        "{}: {whole}: {archived} archived, {refused} refused, {missing} missing; {judged}; {} problems",
        archive.display(),
        report.problems.len()
    )?;
    Ok(is_whole)
}
