//! The plant's command `on_verdict`, which is run with each verdict.

use std::convert::Infallible;
use std::fmt::Display;
use std::fs::{self, Metadata};
use std::io::{BufRead as _, BufReader, PipeWriter, Read as _, Write as _, pipe};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread::Builder;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use rustix::process::{Pid, Signal, kill_process_group};
use tapline_host::messages::relay;
use tapline_store::Unreported;

use crate::shown::verdict::CasingVerdict;
use crate::wires::outbox::{self, Outbox};
use crate::wires::reporter::{Reported, Reporter, Until};

/// How long the command may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Longest line of its log that is passed on in one piece.
const LOG_LINE_MAX: u64 = 1 << 16;

/// How long the end of its log is waited for.
const LOGGED_WITHIN: Duration = Duration::from_millis(100);

/// Exit code with which a command asks to be run again later: `EX_TEMPFAIL` of the system's `sysexits.h`.
const LATER: i32 = 75;

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

/// Has the shell run `command` with each verdict of `outbox` as a line of JSON on its standard input.
pub(super) fn start(command: &str, outbox: &Arc<Outbox>) -> Result<Reporter> {
    let (command, alarms) = (command.to_owned(), Arc::clone(outbox));
    let log = CommandLog::start()?;
    Reporter::start(outbox::Receiver::Command, outbox, TIMEOUT, move |note, verdict, until| {
        run((&command, &log), note, verdict, until).unwrap_or_else(|error| {
            // It has run: if run again, it might repeat what it has done.
            let file = verdict.file.display();
            tracing::error!(casing = verdict.casing, "on_verdict failed, the verdict is in {file}: {error:#}");
            alarms.alarm(format!("casing {}: on_verdict failed: {error:#}", verdict.casing));
            Reported::Done
        })
    })
}

/// Runs `command` with one verdict.
fn run(
    (command, log): (&str, &CommandLog),
    note: &Unreported,
    verdict: &CasingVerdict,
    until: &Until,
) -> Result<Reported> {
    let later = |error: &dyn Display| Ok(Reported::Later(format!("on_verdict cannot be run now: {error}")));
    let log = match log.writer() {
        Ok(log) => log,
        Err(error) => return later(&error),
    };
    let child = Command::new("/bin/sh")
        .args(["-c", command])
        .env("TAPLINE_ID", note.id())
        .env("TAPLINE_CASING", &verdict.casing)
        .env("TAPLINE_VERDICT", verdict.verdict.to_string())
        .env("TAPLINE_STATION", verdict.station.to_string())
        .env("TAPLINE_FILE", &verdict.file)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(log)
        // A Ctrl-C is for the line: a command that has begun is not interrupted.
        .process_group(0)
        .spawn();
    let mut child = match child {
        Ok(child) => child,
        // Out of memory, for example.
        Err(error) => return later(&error),
    };
    if let Some(mut input) = child.stdin.take() {
        let text = verdict.json() + "\n";
        // A command that does not read its input has not failed.
        if let Err(error) = input.write_all(text.as_bytes()) {
            tracing::debug!(%error, "on_verdict does not read its input");
        }
    }
    wait_for(child, until)
}

/// A pipe for what commands write to their standard error. A thread passes it on to the log by lines, long ones in pieces: no
/// command, nor what it has started, waits until somebody reads the line's log.
struct CommandLog {
    to: Option<PipeWriter>,
    /// Disconnected when the thread ends, because nobody can write any more.
    ended: Receiver<Infallible>,
}

impl CommandLog {
    fn start() -> Result<Self> {
        let ((from, to), (works, ended)) = (pipe()?, bounded(0));
        let pass_on = move || {
            let _works: Sender<Infallible> = works;
            let (mut from, mut line) = (BufReader::new(from), Vec::new());
            while from.by_ref().take(LOG_LINE_MAX).read_until(b'\n', &mut line).is_ok_and(|count| count > 0) {
                relay(line.strip_suffix(b"\n").unwrap_or(&line));
                line.clear();
            }
        };
        let thread = Builder::new().name("on_verdict-log".to_owned()).spawn(pass_on);
        thread.context("cannot start the thread on_verdict-log")?;
        Ok(Self { to: Some(to), ended })
    }

    /// What a command writes to.
    fn writer(&self) -> Result<Stdio> {
        let to = self.to.as_ref().context("the log of commands has ended")?;
        Ok(to.try_clone()?.into())
    }
}

impl Drop for CommandLog {
    /// Waits for what the last command wrote, unless something that it started can still write.
    fn drop(&mut self) {
        drop(self.to.take());
        if self.ended.recv_timeout(LOGGED_WITHIN) == Err(RecvTimeoutError::Timeout) {
            tracing::debug!("what on_verdict has started goes on");
        }
    }
}

fn wait_for(mut child: Child, until: &Until) -> Result<Reported> {
    let since = Instant::now();
    loop {
        match child.try_wait()? {
            Some(status) if status.success() => return Ok(Reported::Done),
            Some(status) if status.code() == Some(LATER) => {
                return Ok(Reported::Later("on_verdict asks to be run again later".to_owned()));
            }
            Some(status) => bail!("it ended with {status}"),
            None => {}
        }
        let is_over = until.get().is_some_and(|until| *until <= Instant::now());
        if is_over || since.elapsed() > TIMEOUT {
            // Including all processes that it has started.
            if let Some(group) = Pid::from_raw(i32::try_from(child.id()).unwrap_or(0)) {
                kill_process_group(group, Signal::KILL).context("cannot end it")?;
            }
            child.wait()?;
            if is_over {
                return Ok(Reported::Later("on_verdict was killed, since the line has ended".to_owned()));
            }
            bail!("it took more than {:.0} s and was killed", since.elapsed().as_secs_f64());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a verdict that counts as reported although the line itself has killed its command in order to end.
    #[test]
    fn a_command_that_is_killed_since_the_line_ends_is_run_again() {
        let child = Command::new("/bin/sh").args(["-c", "sleep 60"]).process_group(0).spawn().unwrap();
        let reported = wait_for(child, &Arc::new(Instant::now().into()));
        assert!(matches!(reported, Ok(Reported::Later(_))));
    }
}
