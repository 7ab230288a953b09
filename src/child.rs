//! The stage processes of a line: started, restarted when something kills them, ended in order.

use std::io::Read as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use rustix::process::{Pid, Signal, kill_process};

use crate::stage::StageReport;

/// A stage that dies this soon after its start, this often in a row, will not live.
const SHORT_LIFE: Duration = Duration::from_secs(2);
const SHORT_LIVES_MAX: u32 = 5;

/// How long a stage may take to end after it was told to.
const END_WITHIN: Duration = Duration::from_secs(20);

/// A stage of the line, through all its lives.
#[derive(Debug)]
pub(crate) struct Stage {
    name: String,
    arguments: Vec<String>,
    child: Option<Child>,
    started_at: Instant,
    short_lives: u32,
    pub(crate) restart_count: u32,
    pub(crate) report: Option<StageReport>,
}

impl Stage {
    /// Starts `tapline` with `arguments` as the stage called `name`.
    pub(crate) fn start(name: String, arguments: Vec<String>) -> Result<Self> {
        let mut stage = Self {
            name,
            arguments,
            child: None,
            started_at: Instant::now(),
            short_lives: 0,
            restart_count: 0,
            report: None,
        };
        stage.spawn()?;
        Ok(stage)
    }

    fn spawn(&mut self) -> Result<()> {
        let program = std::env::current_exe().context("cannot find this program")?;
        let child = Command::new(program)
            .args(&self.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            // A Ctrl-C is for the line, which ends its stages in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("cannot start {}", self.name))?;
        self.child = Some(child);
        self.started_at = Instant::now();
        Ok(())
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn is_running(&self) -> bool {
        self.child.is_some()
    }

    /// Looks whether the stage has ended: its report is kept if it ended well, it is restarted if it was killed.
    ///
    /// Fails when the stage failed by itself, or is killed again and again.
    pub(crate) fn tend(&mut self, may_restart: bool) -> Result<()> {
        let Some(child) = &mut self.child else { return Ok(()) };
        let status = child.try_wait().with_context(|| format!("cannot watch {}", self.name))?;
        let Some(status) = status else { return Ok(()) };
        let mut said = String::new();
        if let Some(mut stdout) = child.stdout.take() {
            stdout.read_to_string(&mut said).with_context(|| format!("cannot read what {} reports", self.name))?;
        }
        self.child = None;
        if let Some(signal) = status.signal() {
            if !may_restart {
                tracing::warn!(stage = self.name, signal, "was killed");
                return Ok(());
            }
            return self.restart(signal);
        }
        self.report = said.lines().last().and_then(|line| serde_json::from_str(line).ok());
        if self.report.is_none() {
            bail!("{} failed ({status})", self.name);
        }
        Ok(())
    }

    fn restart(&mut self, signal: i32) -> Result<()> {
        self.short_lives = if self.started_at.elapsed() < SHORT_LIFE { self.short_lives + 1 } else { 0 };
        if self.short_lives >= SHORT_LIVES_MAX {
            bail!("{} was killed by signal {signal} {SHORT_LIVES_MAX} times within seconds of its start", self.name);
        }
        tracing::error!(stage = self.name, signal, "was killed; it is started again");
        self.restart_count += 1;
        self.spawn()
    }

    /// Asks the stage to end.
    pub(crate) fn ask_to_end(&self) {
        self.signal(Signal::TERM);
    }

    /// Waits until the stage has ended, and ends it by force when it takes too long.
    pub(crate) fn wait_for_end(&mut self) -> Result<()> {
        let since = Instant::now();
        while self.is_running() {
            self.tend(false)?;
            if since.elapsed() > END_WITHIN {
                tracing::error!(stage = self.name, "does not end; it is killed");
                self.signal(Signal::KILL);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
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

impl Drop for Stage {
    /// No stage outlives its line, however that ends.
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let ended = child.kill().and_then(|()| child.wait());
            if let Err(error) = ended {
                tracing::debug!(stage = self.name, %error, "cannot be ended");
            }
        }
    }
}
