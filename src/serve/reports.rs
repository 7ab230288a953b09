//! The reports of the last casings. Each is made on request by a process of its own, so that a file that is slow to
//! read delays nobody else.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{IntoResponse as _, Response};
use rustix::process::{Pid, setpriority_process};
use serde::Deserialize;
use tokio::sync::Semaphore;

use crate::serve::{beside, refuse};
use crate::shown::status::Status;

/// How long a report may take, and may wait for others.
const TIMEOUT: Duration = Duration::from_secs(60);

/// How far a report gives way to the line, as a value of `nice`.
const NICE: i32 = 15;

/// Reports contain their own style, and no script.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'none'";

/// The report that is asked for.
#[derive(Debug, Deserialize)]
pub(super) struct Wanted {
    /// The casing's file, as its verdict names it.
    file: PathBuf,
    /// Which of its tyres, from 0.
    #[serde(default)]
    tyre: usize,
}

/// The page of a tyre of one of the last casings. Reports are made one at a time, so each waits for its `turn`.
pub(super) async fn page(turn: &Semaphore, status: &Status, wanted: Wanted) -> Response {
    // No other file can be asked for.
    if !status.verdicts.iter().any(|verdict| verdict.file == wanted.file) {
        let why = format!("{} is not the file of one of the last casings", wanted.file.display());
        return refuse(StatusCode::NOT_FOUND, why);
    }
    let Ok(Ok(_turn)) = tokio::time::timeout(TIMEOUT, turn.acquire()).await else {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "other reports are being made".to_owned());
    };
    let file = wanted.file.display().to_string();
    let made = beside(TIMEOUT + Duration::from_secs(5), move || make(&wanted.file, wanted.tyre)).await;
    match made {
        Ok(Ok(None)) => {
            let why = format!("{file} is not there any more: it was moved or deleted, so no report can be made of it");
            refuse(StatusCode::NOT_FOUND, why)
        }
        Ok(Ok(Some(page))) => {
            ([(CONTENT_TYPE, "text/html; charset=utf-8"), (CONTENT_SECURITY_POLICY, POLICY)], page).into_response()
        }
        Ok(Err(error)) => refuse(StatusCode::INTERNAL_SERVER_ERROR, format!("there is no report: {error:#}")),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, format!("there is no report: {error}")),
    }
}

/// Has this program write the pages of `file`, and returns the page of one tyre; `None` if the file is not there.
fn make(file: &Path, tyre: usize) -> Result<Option<String>> {
    if !file.try_exists().with_context(|| format!("cannot look for {}", file.display()))? {
        return Ok(None);
    }
    let folder = tempfile::tempdir().context("cannot make a folder for it")?;
    let mut child = Command::new("/proc/self/exe")
        .arg("report")
        .arg(file)
        .arg("--out")
        .arg(folder.path())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .context("it cannot be started")?;
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    if let Err(error) = setpriority_process(pid, NICE) {
        tracing::debug!(%error, "a report does not give way");
    }
    let since = Instant::now();
    let status = loop {
        match child.try_wait()? {
            Some(status) => break status,
            None if since.elapsed() > TIMEOUT => {
                child.kill()?;
                child.wait()?;
                bail!("it took longer than {} s", TIMEOUT.as_secs());
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let mut printed = String::new();
    child.stdout.take().context("it has no output")?.read_to_string(&mut printed)?;
    // A page for each tyre, and one for the shift.
    let Some(path) = printed.lines().nth(tyre) else { bail!("it ended with {status}; the file may be damaged") };
    ensure!(Path::new(path).starts_with(folder.path()), "{path} is none of its pages");
    std::fs::read_to_string(path).with_context(|| format!("cannot read {path}")).map(Some)
}
