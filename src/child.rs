//! The stage processes of a line: started, restarted when something kills them, ended in order.

use std::io::Read as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, bail};
use rustix::process::{Pid, Signal, kill_process};

use crate::stage::StageReport;

/// A stage that is restarted this often without a single tap being settled in between will not live.
const RESTARTS_MAX: u32 = 10;

/// A stage of the line, through all its lives.
#[derive(Debug)]
pub(crate) struct Stage {
    name: String,
    arguments: Vec<String>,
    child: Option<Child>,
    fruitless_restarts: u32,
    pub(crate) restart_count: u32,
    pub(crate) report: Option<StageReport>,
}

impl Stage {
    /// Starts `tapline` with `arguments` as the stage called `name`.
    pub(crate) fn start(name: String, arguments: Vec<String>) -> Result<Self> {
        let mut stage = Self { name, arguments, child: None, fruitless_restarts: 0, restart_count: 0, report: None };
        stage.spawn()?;
        Ok(stage)
    }

    fn spawn(&mut self) -> Result<()> {
        // This very program, also when its file has been replaced meanwhile.
        let child = Command::new("/proc/self/exe")
            .arg0("tapline")
            .args(&self.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            // A Ctrl-C is for the line, which ends its stages in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("cannot start {}", self.name))?;
        self.child = Some(child);
        Ok(())
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn is_running(&self) -> bool {
        self.child.is_some()
    }

    /// Looks whether the stage has ended. If it ended before its work was done and `may_restart`, it is started again.
    ///
    /// Fails when the stage failed by itself, or ends again and again.
    pub(crate) fn tend(&mut self, may_restart: bool) -> Result<()> {
        let Some(child) = &mut self.child else { return Ok(()) };
        let status = child.try_wait().with_context(|| format!("cannot watch {}", self.name))?;
        let Some(status) = status else { return Ok(()) };
        let mut said = String::new();
        if let Some(mut stdout) = child.stdout.take() {
            stdout.read_to_string(&mut said).with_context(|| format!("cannot read what {} reports", self.name))?;
        }
        self.child = None;
        self.report = said.lines().last().and_then(|line| serde_json::from_str(line).ok());
        match (&self.report, status.signal()) {
            (Some(report), _) if report.is_complete() || !may_restart => Ok(()),
            (Some(_), _) => self.restart("was told to end by another"),
            (None, Some(signal)) if may_restart => self.restart(&format!("was killed by signal {signal}")),
            (None, Some(signal)) => {
                tracing::warn!(stage = self.name, signal, "was killed");
                Ok(())
            }
            (None, None) => bail!("{} failed ({status})", self.name),
        }
    }

    fn restart(&mut self, why: &str) -> Result<()> {
        if self.fruitless_restarts >= RESTARTS_MAX {
            bail!("{} {why}, {RESTARTS_MAX} times without a tap being archived in between", self.name);
        }
        tracing::error!(stage = self.name, "{why}; it is started again");
        self.fruitless_restarts += 1;
        self.restart_count += 1;
        self.spawn()
    }

    /// Notes that the line gets on: restarts until now were not fruitless.
    pub(crate) fn note_progress(&mut self) {
        self.fruitless_restarts = 0;
    }

    /// Asks the stage to end.
    pub(crate) fn ask_to_end(&self) {
        self.signal(Signal::TERM);
    }

    /// Ends the stage by force.
    pub(crate) fn kill(&self) {
        tracing::error!(stage = self.name, "does not end; it is killed");
        self.signal(Signal::KILL);
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
