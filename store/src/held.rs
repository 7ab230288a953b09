//! `store` while its archive cannot be written: it says so, makes everyone wait, and goes on when the cause is gone.

use std::time::{Duration, Instant};

use tapline_wire::{LineError, TapTopic, Topic as _};

use crate::run::{Desk, RunError};
use crate::{Error, Result, RunWriter};

/// How often it is tried again.
const TRY_EVERY: Duration = Duration::from_millis(500);

/// How often an unchanged cause is said again.
const SAY_EVERY: Duration = Duration::from_secs(10);

/// How often it is looked whether the file is still there.
const LOOK_EVERY: Duration = Duration::from_millis(200);

impl Desk<'_> {
    /// Does `act` on the archive; while that cannot be written, waits, and then does it again.
    ///
    /// What has come is kept meanwhile, and no more is taken: the buffers fill, and the sources wait.
    pub(crate) fn insist<T>(&mut self, mut act: impl FnMut(&mut RunWriter) -> Result<T>) -> Result<T, RunError> {
        let mut has_failed = false;
        loop {
            match act(&mut self.writer) {
                Err(error) if error.is_of_the_disk() => {
                    // What is not mended by opening the file anew is not tried without a pause.
                    if std::mem::replace(&mut has_failed, true) {
                        self.pause()?;
                    }
                    self.wait_out(error)?;
                }
                outcome => return Ok(outcome?),
            }
        }
    }

    /// Looks, from time to time, whether the file that is written is still the one at its path.
    pub(crate) fn look_after_place(&mut self) -> Result<(), RunError> {
        if self.looked_at.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.looked_at = Instant::now();
        self.insist(RunWriter::check_place)
    }

    fn wait_out(&mut self, mut error: Error) -> Result<(), RunError> {
        let since = Instant::now();
        let mut said = since;
        say(&error);
        self.is_held = true;
        while let Err(next) = self.writer.recover() {
            if next.to_string() != error.to_string() || said.elapsed() >= SAY_EVERY {
                say(&next);
                said = Instant::now();
            }
            error = next;
            self.pause()?;
        }
        self.is_held = false;
        tracing::warn!("the archive is written again after {:.1} s; nothing is lost", since.elapsed().as_secs_f64());
        self.tell()
    }

    /// Waits until it is time to try again, or the line is to stop.
    fn pause(&mut self) -> Result<(), RunError> {
        let tried = Instant::now();
        while tried.elapsed() < TRY_EVERY {
            self.tell()?;
            if self.line.is_stopped() {
                return Err(LineError::Stopped { topic: TapTopic::NAME }.into());
            }
            self.line.wait(Duration::from_millis(100))?;
        }
        Ok(())
    }

    /// Whether the archive, after a run that is over, has all that was told to be in it; what came since may be left out.
    ///
    /// # Errors
    /// [`RunError::Archive`] where what was told to be safe is not at the archive's path.
    pub(crate) fn is_closed_in_order(&mut self) -> Result<bool, RunError> {
        let outcome = match self.writer.settle() {
            Err(error) if error.is_of_the_disk() => self.writer.recover().and_then(|()| self.writer.settle()),
            outcome => outcome,
        };
        match outcome {
            Ok(()) => Ok(true),
            Err(error) if error.is_of_the_disk() && self.writer.is_in_place() => {
                tracing::error!(
                    "{error}; what was archived until then is safe, what came since is not in it: {}, then run again",
                    error.remedy()
                );
                Ok(false)
            }
            Err(error) => Err(error.into()),
        }
    }
}

fn say(error: &Error) {
    tracing::error!("{error}; the line waits and nothing is lost: {}", error.remedy());
}
