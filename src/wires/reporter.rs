//! The thread of a receiver on this machine: it passes on waiting verdicts, one at a time, so that nothing else waits.

use std::convert::Infallible;
use std::sync::{Arc, OnceLock};
use std::thread::Builder;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use crossbeam::channel::{self, RecvTimeoutError, Sender, bounded};
use tapline_store::Unreported;

use crate::shown::verdict::CasingVerdict;
use crate::wires::outbox::{Outbox, READ_AGAIN_AFTER, Receiver};

/// When a verdict that could not be reported is reported again.
const AGAIN_AFTER: Duration = Duration::from_secs(5);

/// How long after its time a thread is waited for.
const GRACE: Duration = Duration::from_secs(1);

/// What has become of a report.
pub(super) enum Reported {
    /// It is not to be made again.
    Done,
    /// It is to be made again later; why.
    Later(String),
}

/// When the last report must have been made; empty while the line works.
pub(super) type Until = Arc<OnceLock<Instant>>;

/// Reports verdicts to a receiver. When dropped, it first reports waiting ones, for a while; the others stay in the outbox.
#[derive(Debug)]
pub(super) struct Reporter {
    receiver: Receiver,
    patience: Duration,
    until: Until,
    wake: Sender<()>,
    /// Disconnected when the thread ends.
    ended: channel::Receiver<Infallible>,
}

impl Reporter {
    /// Starts a thread that calls `report` with each verdict of `outbox` that waits for `receiver`. Once it is asked to end, it has
    /// `patience` for the remaining ones.
    pub(super) fn start(
        receiver: Receiver,
        outbox: &Arc<Outbox>,
        patience: Duration,
        report: impl FnMut(&Unreported, &CasingVerdict, &Until) -> Reported + Send + 'static,
    ) -> Result<Self> {
        let until = Until::default();
        let (wake, news) = bounded(1);
        let (works, ended) = bounded(0);
        let waker = wake.clone();
        outbox.wake_by(Box::new(move || wake_up(&waker)));
        let thread = Thread { receiver, outbox: Arc::clone(outbox), news, until: Arc::clone(&until), report };
        let work = move || {
            let _works: Sender<Infallible> = works;
            thread.run();
        };
        let name = receiver.name();
        Builder::new().name(name.to_owned()).spawn(work).with_context(|| format!("cannot start the thread {name}"))?;
        Ok(Self { receiver, patience, until, wake, ended })
    }
}

impl Drop for Reporter {
    fn drop(&mut self) {
        self.until.get_or_init(|| Instant::now() + self.patience);
        wake_up(&self.wake);
        if self.ended.recv_timeout(self.patience + GRACE) == Err(RecvTimeoutError::Timeout) {
            // It cannot be ended: the system does not return from what it does. It ends with this process.
            tracing::warn!("{} is held up: what waits for it is reported after the next start", self.receiver.name());
        }
    }
}

/// Wakes the thread; a wake-up that is pending already is enough, because the thread looks for all new verdicts.
fn wake_up(wake: &Sender<()>) {
    if wake.try_send(()).is_err() {
        tracing::trace!("a reporter is woken already");
    }
}

/// The thread's part.
struct Thread<F> {
    receiver: Receiver,
    outbox: Arc<Outbox>,
    news: channel::Receiver<()>,
    until: Until,
    report: F,
}

impl<F: FnMut(&Unreported, &CasingVerdict, &Until) -> Reported> Thread<F> {
    fn run(mut self) {
        let mut again_at: Option<Instant> = None;
        loop {
            let is_ending = self.until.get().is_some();
            // A receiver that has asked for time gets it, whatever comes meanwhile.
            if is_ending || again_at.is_none_or(|at| at <= Instant::now()) {
                again_at = self.report_all();
            }
            if is_ending {
                return;
            }
            // A verdict that could not be read, by any receiver, may be read again by then.
            let patience = again_at.map_or(READ_AGAIN_AFTER, |at| at.saturating_duration_since(Instant::now()));
            if self.news.recv_timeout(patience) == Err(RecvTimeoutError::Disconnected) {
                return;
            }
        }
    }

    /// Reports every waiting verdict; returns when to go on, if one is to be reported again.
    fn report_all(&mut self) -> Option<Instant> {
        while let Some(note) = self.outbox.next(self.receiver, None) {
            if self.until.get().is_some_and(|until| *until <= Instant::now()) {
                let name = self.receiver.name();
                tracing::warn!("{name} took too long: what waits for it is reported after the next start of the line");
                return None;
            }
            let Some(verdict) = self.outbox.read(&note) else { continue };
            let later = match (self.report)(&note, &verdict, &self.until) {
                Reported::Done => None,
                Reported::Later(why) => Some(format!("casing {}: {why}", verdict.casing)),
            };
            let is_done = later.is_none();
            self.outbox.set_trouble(self.receiver, "failed", later);
            if !is_done {
                return Some(Instant::now() + AGAIN_AFTER);
            }
            self.outbox.acknowledge(self.receiver, note.number);
        }
        None
    }
}
