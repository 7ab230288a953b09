//! The thread of a wire, and what it works on.

use std::future::Future;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, Result};
use tokio::sync::watch;

use crate::wires::now::Now;
use crate::wires::outbox::{Outbox, Receiver};

/// How often a wire checks for something new, if it is not woken earlier.
pub(super) const LOOK_EVERY: Duration = Duration::from_millis(200);

/// How long what a wire has begun may take when it ends.
pub(super) const END_WITHIN: Duration = Duration::from_millis(300);

/// What a wire reports on.
#[derive(Clone)]
pub(super) struct Plant {
    pub outbox: Arc<Outbox>,
    pub now: Arc<Now>,
    pub stations: Arc<[u16]>,
}

/// How a wire learns of news, and of its end.
#[derive(Debug, Clone)]
pub(super) struct News {
    count: watch::Receiver<u64>,
    end: watch::Receiver<()>,
}

impl News {
    /// Waits for something new, or for the time to look for it; whether the wire is to go on.
    pub(super) async fn next(&mut self) -> bool {
        tokio::select! {
            biased;
            () = ended(&mut self.end) => false,
            _ = self.count.changed() => true,
            () = tokio::time::sleep(LOOK_EVERY) => true,
        }
    }

    /// Waits until the wire is to end.
    pub(super) async fn ended(&mut self) {
        ended(&mut self.end).await;
    }
}

async fn ended(end: &mut watch::Receiver<()>) {
    while end.changed().await.is_ok() {}
}

/// A wire, which ends when this is dropped.
#[derive(Debug)]
pub(super) struct Wire {
    end: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Wire {
    /// Starts a thread that does the work for `receiver` that `prepare` returns.
    pub(super) fn start<W, F>(receiver: Receiver, plant: &Plant, prepare: impl FnOnce() -> Result<W>) -> Result<Self>
    where
        W: FnOnce(News) -> F + Send + 'static,
        F: Future<Output = Result<()>>,
    {
        let name = receiver.name();
        let (wake, count) = watch::channel(0);
        plant.outbox.wake_by(Box::new(move || wake.send_modify(|count| *count += 1)));
        let (end, ending) = watch::channel(());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.with_context(|| format!("cannot start {name}"))?;
        let work = {
            let _inside = runtime.enter();
            prepare()?
        };
        let (news, outbox) = (News { count, end: ending }, Arc::clone(&plant.outbox));
        let work = move || {
            // A wire ends by itself only where it cannot go on.
            if let Err(error) = runtime.block_on(work(news)) {
                let text = format!("{name}: verdicts are no longer reported: {error:#}");
                tracing::error!("{text}");
                outbox.set_trouble(receiver, "ended", Some(text));
            }
            runtime.shutdown_timeout(END_WITHIN);
        };
        let thread = Builder::new().name(name.to_owned()).spawn(work);
        let thread = thread.with_context(|| format!("cannot start the thread {name}"))?;
        Ok(Self { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}
