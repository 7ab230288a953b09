//! The plant's command `on_verdict`. Its own thread runs it for each verdict, one at a time, so that nothing waits.

use std::fs::{self, Metadata};
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, OnceLock};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use crossbeam::channel::{self, RecvTimeoutError, Sender, bounded};
use rustix::process::{Pid, Signal, kill_process_group};
use tapline_store::Unreported;

use crate::shown::verdict::CasingVerdict;
use crate::wires::outbox::{Outbox, Receiver};

/// How long the command may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Exit code with which a command asks to be run again later: `EX_TEMPFAIL` of the system's `sysexits.h`.
const LATER: i32 = 75;

/// When it is run again then.
const AGAIN_AFTER: Duration = Duration::from_secs(5);

/// Runs the command. When dropped, it first reports waiting verdicts, for no longer than one may take; the others stay
/// in the outbox.
#[derive(Debug)]
pub(crate) struct VerdictCommand {
    /// When commands must have ended, once this is dropped.
    until: Arc<OnceLock<Instant>>,
    /// `None` once this is dropped.
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

/// What has become of a command.
enum Ended {
    /// It is not to be run again for this verdict.
    Told,
    /// Run it again; why.
    Later(String),
}

/// The thread's part.
struct Runner {
    command: String,
    outbox: Arc<Outbox>,
    news: channel::Receiver<()>,
    until: Arc<OnceLock<Instant>>,
}

/// Refuses a command that the shell would not find: the verdicts that it is for would be lost to it. A relative path may be there
/// where the line is started, and other words of the shell are not looked up.
pub(super) fn check(command: &str) -> Result<()> {
    let word = command.split_whitespace().next().unwrap_or_default();
    let is_plain = word.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"/._-+".contains(&byte));
    if !is_plain || (word.contains('/') && !word.starts_with('/')) {
        return Ok(());
    }
    // The shell finds a file that cannot be run too.
    let may_run = |file: Metadata| file.is_file() && file.permissions().mode() & 0o111 != 0;
    ensure!(
        !word.starts_with('/') || fs::metadata(word).is_ok_and(may_run),
        "line.on_verdict = {command:?}: {word} is not a program on this machine, or may not be run"
    );
    let found = Command::new("/bin/sh").args(["-c", "command -v \"$0\"", word]).stdout(Stdio::null()).status();
    ensure!(
        found.context("cannot run /bin/sh")?.success(),
        "line.on_verdict = {command:?}: {word} is not a command on this machine"
    );
    Ok(())
}

impl VerdictCommand {
    /// Has the shell run `command` with each verdict of `outbox` as a line of JSON on its standard input.
    pub(crate) fn start(command: &str, outbox: &Arc<Outbox>) -> Result<Self> {
        let until = Arc::<OnceLock<Instant>>::default();
        let (wake, news) = bounded(1);
        let end = wake.clone();
        // A wake-up that is pending already is enough.
        outbox.wake_by(Box::new(move || wake_up(&wake)));
        let runner =
            Runner { command: command.to_owned(), outbox: Arc::clone(outbox), news, until: Arc::clone(&until) };
        let thread = Builder::new().name("on-verdict".to_owned()).spawn(move || runner.run());
        Ok(Self { until, end: Some(end), thread: Some(thread.context("cannot start the thread on-verdict")?) })
    }
}

impl Drop for VerdictCommand {
    fn drop(&mut self) {
        self.until.get_or_init(|| Instant::now() + TIMEOUT);
        self.end.take().iter().for_each(wake_up);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

/// Wakes the thread; if it is woken already, it finds all new verdicts anyway.
fn wake_up(wake: &Sender<()>) {
    if wake.try_send(()).is_err() {
        tracing::trace!("on_verdict is woken already");
    }
}

impl Runner {
    fn run(&self) {
        let mut again_at: Option<Instant> = None;
        loop {
            let is_ending = self.until.get().is_some();
            // A command that has asked for time gets it, whatever comes meanwhile.
            if is_ending || again_at.is_none_or(|at| at <= Instant::now()) {
                again_at = self.tell_all();
            }
            if is_ending {
                return;
            }
            let patience = again_at.map_or(Duration::MAX, |at| at.saturating_duration_since(Instant::now()));
            if self.news.recv_timeout(patience) == Err(RecvTimeoutError::Disconnected) {
                return;
            }
        }
    }

    /// Runs the command for every waiting verdict; returns when to run it again, if it has asked for that.
    fn tell_all(&self) -> Option<Instant> {
        while let Some(note) = self.outbox.next(Receiver::Command, None) {
            if self.is_over() {
                tracing::warn!(
                    "on_verdict took too long: what waits for it is reported after the next start of the line"
                );
                return None;
            }
            let Some(verdict) = self.outbox.read(&note) else { continue };
            match self.run_one(&note, &verdict) {
                Ok(Ended::Told) => self.outbox.set_trouble(Receiver::Command, "failed", None),
                Ok(Ended::Later(why)) => {
                    self.outbox.set_trouble(
                        Receiver::Command,
                        "failed",
                        Some(format!("casing {}: {why}", verdict.casing)),
                    );
                    return Some(Instant::now() + AGAIN_AFTER);
                }
                // It has run: if run again, it might repeat what it has done.
                Err(error) => {
                    let file = verdict.file.display();
                    tracing::error!(casing = verdict.casing, "on_verdict failed, the verdict is in {file}: {error:#}");
                    self.outbox.alarm(format!("casing {}: on_verdict failed: {error:#}", verdict.casing));
                }
            }
            self.outbox.acknowledge(Receiver::Command, note.number);
        }
        None
    }

    fn is_over(&self) -> bool {
        self.until.get().is_some_and(|until| *until <= Instant::now())
    }

    fn run_one(&self, note: &Unreported, verdict: &CasingVerdict) -> Result<Ended> {
        let child = Command::new("/bin/sh")
            .args(["-c", &self.command])
            .env("TAPLINE_ID", note.id())
            .env("TAPLINE_CASING", &verdict.casing)
            .env("TAPLINE_VERDICT", verdict.verdict.to_string())
            .env("TAPLINE_STATION", verdict.station.to_string())
            .env("TAPLINE_FILE", &verdict.file)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // A Ctrl-C is for the line: a command that has begun is not interrupted.
            .process_group(0)
            .spawn();
        let mut child = match child {
            Ok(child) => child,
            // Out of memory, for example.
            Err(error) => return Ok(Ended::Later(format!("on_verdict cannot be run now: {error}"))),
        };
        if let Some(mut input) = child.stdin.take() {
            let text = verdict.json() + "\n";
            // A command that does not read its input has not failed.
            if let Err(error) = input.write_all(text.as_bytes()) {
                tracing::debug!(%error, "on_verdict does not read its input");
            }
        }
        self.wait_for(child)
    }

    fn wait_for(&self, mut child: Child) -> Result<Ended> {
        let since = Instant::now();
        loop {
            match child.try_wait()? {
                Some(status) if status.success() => return Ok(Ended::Told),
                Some(status) if status.code() == Some(LATER) => {
                    return Ok(Ended::Later("on_verdict asks to be run again later".to_owned()));
                }
                Some(status) => bail!("it ended with {status}"),
                None => {}
            }
            if since.elapsed() > TIMEOUT || self.is_over() {
                // Including all processes that it has started.
                if let Some(group) = Pid::from_raw(i32::try_from(child.id()).unwrap_or(0)) {
                    kill_process_group(group, Signal::KILL).context("cannot end it")?;
                }
                child.wait()?;
                bail!("it took more than {:.0} s and was killed", since.elapsed().as_secs_f64());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
