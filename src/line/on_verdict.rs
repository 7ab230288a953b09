//! The command `on_verdict` of a plant: a thread of its own runs it at each verdict, one at a time, so that it delays nothing.

use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};
use std::sync::{Arc, OnceLock};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};
use rustix::process::{Pid, Signal, kill_process_group};

use crate::shown::verdict::CasingVerdict;

/// Verdicts that may wait for the command.
const WAITING_MAX: usize = 256;

/// How long the command may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Runs the command. When it is dropped, the verdicts that wait are run first, for no longer than one may take.
#[derive(Debug)]
pub(crate) struct VerdictCommand {
    /// When commands must have ended, once this is dropped.
    until: Arc<OnceLock<Instant>>,
    /// `None` once this is dropped.
    verdicts: Option<Sender<CasingVerdict>>,
    failures: Receiver<String>,
    thread: Option<JoinHandle<()>>,
}

impl VerdictCommand {
    /// Has the shell run `command` with each verdict as a line of JSON on its standard input.
    pub(crate) fn start(command: &str) -> Result<Self> {
        let (verdicts, waiting) = bounded(WAITING_MAX);
        let (command, until) = (command.to_owned(), Arc::<OnceLock<Instant>>::default());
        let (of_thread, (fail, failures)) = (Arc::clone(&until), bounded(WAITING_MAX));
        let thread = Builder::new().name("on-verdict".to_owned());
        let thread = thread.spawn(move || run_all(&command, &waiting, &fail, &of_thread));
        let thread = Some(thread.context("cannot start the thread on-verdict")?);
        Ok(Self { until, verdicts: Some(verdicts), failures, thread })
    }

    /// Why a command failed, once.
    pub(crate) fn take_failure(&self) -> Option<String> {
        self.failures.try_recv().ok()
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

impl Drop for VerdictCommand {
    fn drop(&mut self) {
        self.until.get_or_init(|| Instant::now() + TIMEOUT);
        drop(self.verdicts.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn run_all(command: &str, verdicts: &Receiver<CasingVerdict>, failures: &Sender<String>, until: &OnceLock<Instant>) {
    for verdict in verdicts {
        if let Err(error) = run_one(command, &verdict, until) {
            let file = verdict.file.display();
            tracing::error!(casing = verdict.casing, "on_verdict failed, the verdict is in {file}: {error:#}");
            // If the queue is full, the log has it.
            drop(failures.try_send(format!("casing {}: on_verdict failed: {error:#}", verdict.casing)));
        }
    }
}

fn run_one(command: &str, verdict: &CasingVerdict, until: &OnceLock<Instant>) -> Result<()> {
    let is_over = || until.get().is_some_and(|until| *until <= Instant::now());
    ensure!(!is_over(), "the line ends, and the commands before it took too long");
    let mut child = Command::new("/bin/sh")
        .args(["-c", command])
        .env("TAPLINE_CASING", &verdict.casing)
        .env("TAPLINE_VERDICT", verdict.verdict.to_string())
        .env("TAPLINE_STATION", verdict.station.to_string())
        .env("TAPLINE_FILE", &verdict.file)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        // A Ctrl-C is for the line: a command that has begun is not interrupted.
        .process_group(0)
        .spawn()
        .context("cannot start the shell")?;
    if let Some(mut input) = child.stdin.take() {
        let mut text = serde_json::to_string(verdict)?;
        text.push('\n');
        // A command that does not read its input has not failed.
        if let Err(error) = input.write_all(text.as_bytes()) {
            tracing::debug!(%error, "on_verdict does not read its input");
        }
    }
    let since = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            ensure!(status.success(), "it ended with {status}");
            return Ok(());
        }
        if since.elapsed() > TIMEOUT || is_over() {
            // With all processes that it has started.
            if let Some(group) = Pid::from_raw(i32::try_from(child.id()).unwrap_or(0)) {
                kill_process_group(group, Signal::KILL).context("cannot end it")?;
            }
            child.wait()?;
            bail!("it took more than {:.0} s and was killed", since.elapsed().as_secs_f64());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
