//! `store` while an archive cannot be written: it says so, makes everyone wait, and goes on when the cause is gone.

use std::time::{Duration, Instant};

use tapline_wire::{LineError, TapTopic, Topic as _};

use super::StageLoop;
use super::outcome::{RunError, write_failure};
use crate::error::{Error, Result};
use crate::write::Writer;

/// How often it is tried again.
const TRY_EVERY: Duration = Duration::from_millis(500);

/// How often an unchanged cause is logged again.
const LOG_EVERY: Duration = Duration::from_secs(10);

/// How often it is looked whether the files are still there.
const LOOK_EVERY: Duration = Duration::from_millis(200);

impl StageLoop<'_> {
    /// Does `act` on the file of the casing at `index`; while that cannot be written, waits, and then does it again.
    ///
    /// What has come is kept meanwhile, and no more is taken: the buffers fill, and the sources wait.
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
                    // What is not mended by opening the file anew is not tried without a pause.
                    if std::mem::replace(&mut has_failed, true) {
                        self.pause()?;
                    }
                    self.wait_for_recovery(index, error)?;
                }
                outcome => return Ok(outcome?),
            }
        }
    }

    /// Looks, from time to time, whether the files that are written are still those at their paths.
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

    /// Waits until the file of the casing at `index` can be written again, after `error`.
    pub(super) fn wait_for_recovery(&mut self, index: usize, mut error: Error) -> Result<(), RunError> {
        let since = Instant::now();
        let mut logged_at = since;
        log(&error);
        self.hold(true)?;
        if error.is_file_system_failure() {
            return Err(write_failure(error));
        }
        while let Err(next) = self.open[index].writer.recover() {
            if next.is_file_system_failure() {
                return Err(write_failure(next));
            }
            if next.to_string() != error.to_string() || logged_at.elapsed() >= LOG_EVERY {
                log(&next);
                logged_at = Instant::now();
            }
            error = next;
            self.pause()?;
        }
        tracing::warn!("the archive is written again after {:.1} s; nothing is lost", since.elapsed().as_secs_f64());
        self.hold(false)
    }

    /// Does `act`, which makes a new file, until the disk lets it.
    pub(super) fn retry_new_until_recovered<T>(&mut self, act: impl Fn() -> Result<T>) -> Result<T, RunError> {
        let mut logged_at = None;
        loop {
            match act() {
                Err(error) if error.is_file_system_failure() => return Err(write_failure(error)),
                Err(error) if error.is_recoverable() => {
                    if logged_at.is_none_or(|at: Instant| at.elapsed() >= LOG_EVERY) {
                        log(&error);
                        logged_at = Some(Instant::now());
                        self.hold(true)?;
                    }
                    self.pause()?;
                }
                outcome => {
                    if logged_at.is_some() {
                        self.hold(false)?;
                    }
                    return Ok(outcome?);
                }
            }
        }
    }

    /// Tells everyone whether the archive can be written.
    fn hold(&mut self, is_held: bool) -> Result<(), RunError> {
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

/// Makes safe what a writer has, when the line ends before its casing does; what came since the last flush may be left out.
pub(super) fn settle_at_end(mut writer: Writer) -> Result<(), RunError> {
    let outcome = match writer.settle() {
        Err(error) if error.is_recoverable() => writer.recover().and_then(|()| writer.settle()),
        outcome => outcome,
    };
    match outcome {
        // On the disk too, where a power cut cannot take it back.
        Ok(()) => Ok(writer.suspend()?),
        Err(error) if error.is_recoverable() && writer.is_in_place() => {
            tracing::error!(
                "{error}; what was archived until then is safe, what came since is not in it: {}, then run again",
                error.remedy()
            );
            Ok(())
        }
        Err(error) => Err(write_failure(error)),
    }
}

fn log(error: &Error) {
    tracing::error!("{error}; the line waits and nothing is lost: {}", error.remedy());
}
