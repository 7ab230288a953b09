//! `store` while an archive cannot be written: it notifies the other stages, which wait, and continues when the cause is gone.

use std::time::{Duration, Instant};

use tapline_wire::{LineError, TapTopic, Topic as _};

use super::StageLoop;
use super::outcome::{RunError, write_failure};
use crate::error::{Error, Result};
use crate::write::Writer;

/// Time between two attempts.
const TRY_EVERY: Duration = Duration::from_millis(500);

/// Time after which an unchanged cause is logged again.
const LOG_EVERY: Duration = Duration::from_secs(10);

/// Time between two checks of the files.
const LOOK_EVERY: Duration = Duration::from_millis(200);

impl StageLoop<'_> {
    /// Calls `act` with the writer of the casing at `index`; as long as its file cannot be written, waits and calls it again.
    ///
    /// Meanwhile records that have come are kept and no more are received: the buffers fill, and the sources wait.
    pub(super) fn retry_until_recovered<T>(
        &mut self,
        index: usize,
        mut act: impl FnMut(&mut Writer) -> Result<T>,
    ) -> Result<T, RunError> {
        let mut has_failed = false;
        loop {
            match act(&mut self.open[index].writer) {
                Err(error) if error.is_file_system_failure() => return Err(write_failure(error)),
                Err(error) if error.is_recoverable() => {
                    // If reopening the file did not help, pause before the next attempt.
                    if std::mem::replace(&mut has_failed, true) {
                        self.pause()?;
                    }
                    self.wait_for_recovery(index, error)?;
                }
                outcome => return Ok(outcome?),
            }
        }
    }

    /// Checks from time to time that the open files are still at their paths.
    pub(super) fn check_files(&mut self) -> Result<(), RunError> {
        if self.looked_at.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.looked_at = Instant::now();
        for index in 0..self.open.len() {
            self.retry_until_recovered(index, Writer::check_file)?;
        }
        Ok(())
    }

    /// After `error`, waits until the file of the casing at `index` can be written again.
    pub(super) fn wait_for_recovery(&mut self, index: usize, mut error: Error) -> Result<(), RunError> {
        // Another tap of the same batch has failed, which was logged; often that is over.
        if matches!(error, Error::Abandoned { .. }) && self.open[index].writer.recover().is_ok() {
            return Ok(());
        }
        let since = Instant::now();
        let mut logged_at = since;
        self.hold(&error)?;
        if error.is_file_system_failure() {
            return Err(write_failure(error));
        }
        while let Err(next) = self.open[index].writer.recover() {
            if next.is_file_system_failure() {
                return Err(write_failure(next));
            }
            if next.to_string() != error.to_string() || logged_at.elapsed() >= LOG_EVERY {
                self.hold(&next)?;
                logged_at = Instant::now();
            }
            error = next;
            self.pause()?;
        }
        tracing::warn!("the archive is written again after {:.1} s; nothing is lost", since.elapsed().as_secs_f64());
        self.release()
    }

    /// Calls `act`, which creates a file, until the disk permits it.
    pub(super) fn retry_new_until_recovered<T>(&mut self, act: impl Fn() -> Result<T>) -> Result<T, RunError> {
        let mut logged_at = None;
        loop {
            match act() {
                Err(error) if error.is_file_system_failure() => return Err(write_failure(error)),
                Err(error) if error.is_recoverable() => {
                    if logged_at.is_none_or(|at: Instant| at.elapsed() >= LOG_EVERY) {
                        self.hold(&error)?;
                        logged_at = Some(Instant::now());
                    }
                    self.pause()?;
                }
                outcome => {
                    if logged_at.is_some() {
                        self.release()?;
                    }
                    return Ok(outcome?);
                }
            }
        }
    }

    /// Logs why the archive cannot be written, and notifies the other stages.
    fn hold(&mut self, error: &Error) -> Result<(), RunError> {
        let why = format!("{error}; the line waits and nothing is lost: {}", error.remedy());
        tracing::error!("{why}");
        self.notices.outage(&why);
        self.notify(true)
    }

    /// Notifies the other stages that the archive can be written again.
    fn release(&mut self) -> Result<(), RunError> {
        self.notices.outage("");
        self.notify(false)
    }

    fn notify(&mut self, is_held: bool) -> Result<(), RunError> {
        self.is_held = is_held;
        for casing in &mut self.open {
            (casing.acquire.ledger, casing.supervisor.ledger) = (true, true);
            casing.supervisor_sent_at = None;
        }
        self.send_notices()
    }

    /// Waits until it is time to try again, or the line is to stop.
    fn pause(&mut self) -> Result<(), RunError> {
        let tried = Instant::now();
        while tried.elapsed() < TRY_EVERY {
            self.send_notices()?;
            if self.line.is_stopped() {
                return Err(LineError::Stopped { topic: TapTopic::NAME }.into());
            }
            self.line.wait(Duration::from_millis(100))?;
        }
        Ok(())
    }
}

/// Settles and suspends an archive when the line ends before its casing does. If its disk fails, records since the last flush are
/// left out.
pub(super) fn settle_at_end(mut writer: Writer) -> Result<(), RunError> {
    let outcome = match writer.settle() {
        Err(error) if error.is_recoverable() => writer.recover().and_then(|()| writer.settle()),
        outcome => outcome,
    };
    match outcome {
        // Synced too, so that it survives a power cut.
        Ok(()) => Ok(writer.suspend()?),
        Err(error) if error.is_recoverable() && writer.is_in_place() => {
            tracing::error!(
                "{error}; what was archived until then is safe, what came later is not in it: {}, then run again",
                error.remedy()
            );
            Ok(())
        }
        Err(error) => Err(write_failure(error)),
    }
}
