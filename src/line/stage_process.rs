//! The stage processes of a line: started, restarted when something kills them, ended in order.

use std::collections::VecDeque;
use std::io::Read as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use rustix::process::{Pid, Signal, kill_process};

use tapline_wire::{OVER, Role};

use crate::line::process_name::stage_name;
use crate::line::stage::{DISK_FAILED, StageReport};

/// A stage that is restarted this often without any settled tap in between has failed.
const RESTARTS_MAX: u32 = 10;

/// A stage that is restarted this often within this time is in trouble.
const UNSTEADY: (usize, Duration) = (3, Duration::from_secs(60));

/// A stage that has not looked for work for so long is held up: each does at least once a second.
const SILENT_AFTER: Duration = Duration::from_secs(5);

/// The same limit for its start, when it reads the reference, opens files and finds the other stages.
const STARTS_WITHIN: Duration = Duration::from_secs(60);

/// A stage of the line, across restarts.
#[derive(Debug)]
pub(crate) struct StageProcess {
    role: Role,
    name: String,
    arguments: Vec<String>,
    child: Option<Child>,
    is_asked_to_end: bool,
    is_killed: bool,
    /// Whether it ended because the disk of the archive has failed.
    pub(crate) awaits_disk: bool,
    /// How often it has looked for work, and when this number last changed; at first, when it was started.
    heard: (u32, Instant),
    /// Whether it has looked for work since it was started.
    has_begun: bool,
    is_silent: bool,
    fruitless_restarts: u32,
    /// When it was last restarted, as often as [`UNSTEADY`] counts.
    restarted_at: VecDeque<Instant>,
    pub(crate) restart_count: u32,
    pub(crate) report: Option<StageReport>,
}

impl StageProcess {
    /// Starts `tapline` with `arguments` as the stage of this role.
    pub(crate) fn start(role: Role, arguments: Vec<String>) -> Result<Self> {
        let mut stage = Self {
            role,
            name: role.name(),
            arguments,
            child: None,
            is_asked_to_end: false,
            is_killed: false,
            awaits_disk: false,
            heard: (0, Instant::now()),
            has_begun: false,
            is_silent: false,
            fruitless_restarts: 0,
            restarted_at: VecDeque::new(),
            restart_count: 0,
            report: None,
        };
        stage.spawn()?;
        Ok(stage)
    }

    fn spawn(&mut self) -> Result<()> {
        // This same program, even if its file has been replaced meanwhile.
        let child = Command::new("/proc/self/exe")
            .arg0(stage_name(&self.name))
            .args(&self.arguments)
            // Its working folder must not keep a disk busy; all paths that it gets are absolute.
            .current_dir("/")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            // Ctrl-C is meant for the line, which ends its stages in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("cannot start {}", self.name))?;
        self.child = Some(child);
        self.is_killed = false;
        self.heard.1 = Instant::now();
        // One that was silent counts as silent until it answers.
        self.has_begun = false;
        Ok(())
    }

    pub(crate) fn role(&self) -> Role {
        self.role
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn is_running(&self) -> bool {
        self.child.is_some()
    }

    /// Number of its process, while it runs.
    pub(crate) fn pid(&self) -> Option<u32> {
        self.child.as_ref().map(Child::id)
    }

    /// How its process has ended, until [`StageProcess::handle_end`]; `None` while it runs.
    pub(crate) fn ended(&mut self) -> Result<Option<ExitStatus>> {
        let Some(child) = &mut self.child else { return Ok(None) };
        child.try_wait().with_context(|| format!("cannot watch {}", self.name))
    }

    /// Handles the end of the process with this `status`: starts it again, if it `may_restart`, unless it was asked to end.
    ///
    /// Fails if the stage failed by itself, or ends again and again.
    pub(crate) fn handle_end(&mut self, status: ExitStatus, may_restart: bool) -> Result<()> {
        let Some(mut child) = self.child.take() else { return Ok(()) };
        let mut printed = String::new();
        if let Some(mut stdout) = child.stdout.take() {
            stdout.read_to_string(&mut printed).with_context(|| format!("cannot read what {} reports", self.name))?;
        }
        self.report = printed.lines().last().and_then(|line| serde_json::from_str(line).ok());
        match (&self.report, status.signal()) {
            (Some(_), _) if self.is_asked_to_end || !may_restart => Ok(()),
            (Some(_), _) => self.restart("was asked to end by another process"),
            (None, Some(signal)) if may_restart => self.restart(&format!("was killed by signal {signal}")),
            (None, Some(signal)) => {
                tracing::warn!(stage = self.name, "a stage was killed by signal {signal}");
                Ok(())
            }
            (None, None) if status.code() == Some(DISK_FAILED.into()) => {
                self.awaits_disk = true;
                Ok(())
            }
            (None, None) => bail!("{} failed ({status})", self.name),
        }
    }

    fn restart(&mut self, why: &str) -> Result<()> {
        if self.fruitless_restarts >= RESTARTS_MAX {
            bail!("{} {why}, {RESTARTS_MAX} times without a tap being archived in between", self.name);
        }
        tracing::error!(stage = self.name, "a stage {why}; it is started again");
        self.fruitless_restarts += 1;
        self.restart_count += 1;
        self.restarted_at.truncate(UNSTEADY.0 - 1);
        self.restarted_at.push_front(Instant::now());
        self.spawn()
    }

    /// Notes how often it has looked for work so far; returns an alarm when its silence begins, and when that is over.
    pub(crate) fn hear(&mut self, beats: u32) -> Option<String> {
        let (before, heard_at) = self.heard;
        if beats != before {
            self.heard = (beats, Instant::now());
            self.has_begun = true;
            if std::mem::take(&mut self.is_silent) {
                tracing::warn!("{} answers again, after {:.1} s", self.name, heard_at.elapsed().as_secs_f64());
                return Some(format!("{OVER}{}", self.silence()));
            }
            return None;
        }
        let patience = if self.has_begun { SILENT_AFTER } else { STARTS_WITHIN };
        let is_silent = self.is_running() && heard_at.elapsed() > patience;
        if !is_silent || self.is_silent {
            return None;
        }
        self.is_silent = true;
        tracing::error!("{}; the line waits", self.silence());
        Some(self.silence())
    }

    fn silence(&self) -> String {
        let disk = if self.role == Role::Store { "its disk is slow or hangs, or " } else { "" };
        format!("the process {} does not answer: {disk}it is held up", self.name)
    }

    /// What is wrong with it at this moment.
    pub(crate) fn trouble(&self) -> Option<String> {
        let (count, within) = UNSTEADY;
        if self.child.is_none() && !self.is_asked_to_end {
            return Some(format!("the process {} does not run", self.name));
        }
        if self.is_silent {
            return Some(self.silence());
        }
        let is_unsteady =
            self.restarted_at.len() == count && self.restarted_at.back().is_some_and(|at| at.elapsed() < within);
        is_unsteady.then(|| format!("{} was started again {count} times within {} s", self.name, within.as_secs()))
    }

    /// Starts it again after its disk was repaired.
    pub(crate) fn disk_is_back(&mut self) -> Result<()> {
        self.awaits_disk = false;
        self.restart_count += 1;
        self.spawn()
    }

    /// Notes progress: restarts until now were not fruitless.
    pub(crate) fn note_progress(&mut self) {
        self.fruitless_restarts = 0;
    }

    /// Asks the stage to end.
    pub(crate) fn ask_to_end(&mut self) {
        self.is_asked_to_end = true;
        self.signal(Signal::TERM);
    }

    pub(crate) fn is_asked_to_end(&self) -> bool {
        self.is_asked_to_end
    }

    /// Ends the stage by force.
    pub(crate) fn kill(&mut self) {
        if !std::mem::replace(&mut self.is_killed, true) {
            tracing::error!(stage = self.name, "does not end; it is killed");
            self.signal(Signal::KILL);
        }
    }

    fn signal(&self, signal: Signal) {
        let pid = self.child.as_ref().and_then(|child| Pid::from_raw(i32::try_from(child.id()).unwrap_or(0)));
        if let Some(pid) = pid
            && let Err(error) = kill_process(pid, signal)
        {
            tracing::debug!(stage = self.name, %error, "cannot be signalled");
        }
    }
}

impl Drop for StageProcess {
    /// No stage outlives its line, however the line ends.
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let ended = child.kill().and_then(|()| child.wait());
            if let Err(error) = ended {
                tracing::debug!(stage = self.name, %error, "cannot be ended");
            }
        }
    }
}
