//! The command that a plant has run at each verdict: by a thread of its own, one at a time, so that it holds up nothing.

use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};

use crate::line::verdicts::CasingVerdict;

/// Verdicts that may wait for the command.
const WAITING_MAX: usize = 256;

/// How long the command may take.
const TAKES_MOST: Duration = Duration::from_secs(60);

/// Runs the command; when it is dropped, what waits is run first.
#[derive(Debug)]
pub(crate) struct Hook {
    /// `None` once it is to end.
    verdicts: Option<Sender<CasingVerdict>>,
    thread: Option<JoinHandle<()>>,
}

impl Hook {
    /// One that runs `command`, by the shell, with the verdict as a line of JSON on its standard input.
    pub(crate) fn start(command: &str) -> Result<Self> {
        let (verdicts, waiting) = bounded(WAITING_MAX);
        let command = command.to_owned();
        let thread = Builder::new().name("on-verdict".to_owned()).spawn(move || run_all(&command, &waiting));
        Ok(Self { verdicts: Some(verdicts), thread: Some(thread.context("cannot start the thread on-verdict")?) })
    }

    pub(crate) fn run(&self, verdict: &CasingVerdict) {
        let Some(verdicts) = &self.verdicts else { return };
        match verdicts.try_send(verdict.clone()) {
            Ok(()) => {}
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {
                tracing::error!(
                    casing = verdict.casing,
                    "on_verdict is not run: {WAITING_MAX} verdicts wait for it already; the verdict is in {}",
                    verdict.file.display()
                );
            }
        }
    }
}

impl Drop for Hook {
    fn drop(&mut self) {
        drop(self.verdicts.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn run_all(command: &str, verdicts: &Receiver<CasingVerdict>) {
    for verdict in verdicts {
        if let Err(error) = run_one(command, &verdict) {
            tracing::error!(casing = verdict.casing, "on_verdict failed: {error:#}");
        }
    }
}

fn run_one(command: &str, verdict: &CasingVerdict) -> Result<()> {
    let mut child = Command::new("/bin/sh")
        .args(["-c", command])
        .env("TAPLINE_CASING", &verdict.casing)
        .env("TAPLINE_VERDICT", verdict.verdict.to_string())
        .env("TAPLINE_STATION", verdict.station.to_string())
        .env("TAPLINE_FILE", &verdict.file)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        // A Ctrl-C is for the line: what has begun is done.
        .process_group(0)
        .spawn()
        .context("cannot start the shell")?;
    if let Some(mut input) = child.stdin.take() {
        let mut text = serde_json::to_string(verdict)?;
        text.push('\n');
        // A command that does not read is none that failed.
        if let Err(error) = input.write_all(text.as_bytes()) {
            tracing::debug!(%error, "on_verdict does not read its input");
        }
    }
    let since = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            anyhow::ensure!(status.success(), "it ended with {status}");
            return Ok(());
        }
        if since.elapsed() > TAKES_MOST {
            child.kill()?;
            child.wait()?;
            anyhow::bail!("it took more than {} s and was killed", TAKES_MOST.as_secs());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
