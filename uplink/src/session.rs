//! Tries again after any trouble, and logs each once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Error, Result};
use tapline_host::messages::with_causes;

/// Time until the next attempt after a trouble: at first, and at most.
const AGAIN_AFTER: (Duration, Duration) = (Duration::from_millis(500), Duration::from_secs(10));

/// How long a single run tries without progress.
const ONCE_WITHIN: Duration = Duration::from_secs(60);

/// How often to check whether to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// When to end.
#[derive(Debug, Clone)]
pub struct Until {
    /// Ends when this is set.
    pub stop: Arc<AtomicBool>,
    /// Also ends when there is nothing left to do, and fails after a minute without progress.
    pub is_once: bool,
}

impl Until {
    pub(crate) fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Waits for `time`, or until it is over.
    pub(crate) async fn wait(&self, time: Duration) {
        drop(tokio::time::timeout(time, self.over()).await);
    }

    /// Waits until it is over.
    pub(crate) async fn over(&self) {
        while !self.is_over() {
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }
}

/// The trouble that lasts, so that each is logged once, and its end.
#[derive(Debug, Default)]
pub(crate) struct Trouble(Option<(String, Instant)>);

impl Trouble {
    pub(crate) fn begins(&mut self, error: &Error) {
        let text = with_causes(error.as_ref());
        let since = self.0.as_ref().map_or_else(Instant::now, |(_, since)| *since);
        match self.0.as_ref().is_some_and(|(before, _)| *before == text) {
            true => tracing::debug!("{text}"),
            false => tracing::warn!("{text}; trying again"),
        }
        self.0 = Some((text, since));
    }

    /// Restarts its time, as something went well meanwhile; that does not end it.
    pub(crate) fn starts_over(&mut self) {
        if let Some((_, since)) = &mut self.0 {
            *since = Instant::now();
        }
    }

    /// How long it has lasted since something went well.
    fn lasts(&self) -> Duration {
        self.0.as_ref().map_or(Duration::ZERO, |(_, since)| since.elapsed())
    }

    pub(crate) fn ends(&mut self) {
        if let Some((text, _)) = self.0.take() {
            tracing::warn!("over: {text}");
        }
    }
}

/// Runs `work`, one attempt after the other, each with a connection of its own, until one is done or it is over. An attempt calls
/// [`Trouble::ends`] when it has made progress, and checks whether it is over wherever it may loop without waiting.
pub(crate) fn run(until: &Until, work: impl AsyncFnMut(&mut Trouble) -> Result<()>) -> Result<()> {
    run_within(until, ONCE_WITHIN, work)
}

/// As [`run`]; a single run fails when a trouble has lasted for `once_within`.
fn run_within(
    until: &Until,
    once_within: Duration,
    mut work: impl AsyncFnMut(&mut Trouble) -> Result<()>,
) -> Result<()> {
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start a runtime")?;
    runtime.block_on(async {
        let mut trouble = Trouble::default();
        let mut again_after = AGAIN_AFTER.0;
        loop {
            let attempt = tokio::select! {
                attempt = work(&mut trouble) => attempt,
                () = until.over() => return Ok(()),
            };
            let Err(error) = attempt else { return Ok(()) };
            if until.is_once && trouble.lasts() >= once_within {
                return Err(error);
            }
            let is_new = trouble.0.is_none();
            again_after = if is_new { AGAIN_AFTER.0 } else { (again_after * 2).min(AGAIN_AFTER.1) };
            trouble.begins(&error);
            until.wait(again_after).await;
        }
    })
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    /// Catches a job that hangs for ever because there is no server, and one that fails on trouble that was soon over.
    #[test]
    fn who_works_once_does_not_try_for_ever() {
        let until = Until { stop: Arc::default(), is_once: true };
        let mut attempts = 0;
        let failed = run_within(&until, Duration::from_secs(1), async |_| {
            attempts += 1;
            Err(anyhow!("no server"))
        });
        assert_eq!((failed.unwrap_err().to_string(), attempts), ("no server".to_owned(), 3));
        let mut attempts = 0;
        let done = run_within(&until, Duration::from_millis(100), async |trouble| {
            attempts += 1;
            trouble.ends();
            if attempts < 3 { Err(anyhow!("no server")) } else { Ok(()) }
        });
        assert!(done.is_ok() && attempts == 3);
    }
}
