//! `process` on a line: one thread that talks to shared memory, and one worker per core that reads samples in place.

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::thread::{Builder, available_parallelism, scope};
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, bounded};
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use tapline_wire::{
    DiscriminatorTopic, Discriminators, Line, LineError, Publisher, Quality, Received, RecordKind, Samples, Stamp,
    Subscriber, TapHeader, TapTopic, Topic, Waker, monotonic_ns,
};

use crate::{Error, ProcessConfig, ProcessExtractor};

/// Most taps that the workers may have at once; fewer than a subscriber may borrow.
const IN_HAND_MAX: usize = TapTopic::BORROWED - 2;

/// So many taps, and fewer, are extracted where they are received: waking a worker takes as long as extracting a tap, so
/// workers are for taps that come faster than one thread extracts them.
const FEW: usize = 8;

/// Longest latency that is counted as such; longer ones count as this.
const LATENCY_MAX_US: u64 = 600_000_000;

/// Why `process` cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The configuration is not valid.
    #[error(transparent)]
    Config(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
    /// A worker cannot be started.
    #[error("cannot start the worker {name}")]
    Thread {
        /// Its name.
        name: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A worker has ended while there is work.
    #[error("a worker has ended while there is work for it")]
    WorkersGone,
}

/// What `process` did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Taps whose discriminators were extracted.
    pub tap_count: u64,
    /// Bytes of samples read in place.
    pub sample_bytes: u64,
    /// Records lost on the way to `process`.
    pub lost_count: u64,
    /// Median time from a tap's sending to its discriminators' sending.
    pub latency_p50_us: u64,
    /// The same for the slowest one in a hundred.
    pub latency_p99_us: u64,
    /// Worker threads.
    pub worker_count: usize,
}

/// Turns the taps on `line` into discriminators until asked to stop.
///
/// # Errors
/// [`RunError`] when the configuration is not valid or shared memory fails. Being asked to stop is no error.
pub fn run(line: &Line, config: &ProcessConfig) -> Result<Outcome, RunError> {
    let worker_count = match config.workers {
        0 => available_parallelism().map_or(1, NonZeroUsize::get),
        count => count,
    };
    let mut stage = StageLoop::open(line, config)?;
    let (work, to_do) = bounded(IN_HAND_MAX);
    let (finish, done) = bounded(IN_HAND_MAX);
    let waker = line.waker();
    let outcome = scope(|threads| {
        for k in 0..worker_count {
            let worker = Worker {
                extractor: ProcessExtractor::new(config)?,
                to_do: to_do.clone(),
                finish: finish.clone(),
                waker: waker.clone(),
            };
            let name = format!("extract-{k}");
            let spawned = Builder::new().name(name.clone()).spawn_scoped(threads, move || worker.extract_all());
            spawned.map_err(|source| RunError::Thread { name, source })?;
        }
        // Only the workers hold these ends now: the channels close when the workers or the loop end.
        drop((to_do, finish));
        let served = stage.serve(&work, &done);
        drop(work);
        served
    });
    let mut outcome = match outcome {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => stage.outcome(),
        Err(error) => return Err(error),
    };
    outcome.worker_count = worker_count;
    Ok(outcome)
}

/// The discriminators of one tap, and when the tap was sent.
struct Done {
    casing: u64,
    record: Discriminators,
    sent_ns: i64,
    sample_bytes: usize,
}

fn extract(extractor: &mut ProcessExtractor, tap: &Received<TapTopic>) -> Done {
    let header = tap.header();
    // The extractor flags a header that does not fit its payload; it then sees no samples.
    let samples = Samples::view(header, tap).unwrap_or(Samples::I16(&[]));
    let record = extractor.extract(header, samples);
    Done { casing: header.stamp.casing, record, sent_ns: header.sent_ns, sample_bytes: header.payload_bytes() }
}

/// One thread that extracts.
struct Worker {
    extractor: ProcessExtractor,
    to_do: Receiver<Received<TapTopic>>,
    finish: Sender<Option<Done>>,
    waker: Waker,
}

impl Worker {
    fn extract_all(mut self) {
        while let Ok(tap) = self.to_do.recv() {
            let done = extract(&mut self.extractor, &tap);
            drop(tap);
            if self.finish.send(Some(done)).is_err() {
                return;
            }
            self.waker.wake();
        }
    }
}

impl Drop for Worker {
    /// Reports a worker that panics; otherwise the loop would wait for its tap for ever.
    fn drop(&mut self) {
        if std::thread::panicking() && self.finish.send(None).is_ok() {
            self.waker.wake();
        }
    }
}

/// The thread that talks to shared memory.
struct StageLoop<'a> {
    line: &'a Line,
    taps: Subscriber<'a, TapTopic>,
    found: Publisher<'a, DiscriminatorTopic>,
    /// For taps of which no more than [`FEW`] wait.
    extractor: ProcessExtractor,
    in_hand: usize,
    tap_count: u64,
    sample_bytes: u64,
    latency_us: Histogram<u64>,
}

impl<'a> StageLoop<'a> {
    fn open(line: &'a Line, config: &ProcessConfig) -> Result<Self, RunError> {
        Ok(Self {
            line,
            taps: Subscriber::open(line)?,
            found: Publisher::open(line)?,
            extractor: ProcessExtractor::new(config)?,
            in_hand: 0,
            tap_count: 0,
            sample_bytes: 0,
            latency_us: latencies(),
        })
    }

    fn serve(&mut self, work: &Sender<Received<TapTopic>>, done: &Receiver<Option<Done>>) -> Result<(), RunError> {
        let mut waiting = VecDeque::with_capacity(IN_HAND_MAX);
        loop {
            let mut is_idle = true;
            while let Ok(result) = done.try_recv() {
                self.in_hand -= 1;
                self.publish(result)?;
                is_idle = false;
            }
            while self.in_hand + waiting.len() < IN_HAND_MAX {
                let Some(tap) = self.taps.receive()? else { break };
                waiting.push_back(tap);
            }
            is_idle &= waiting.is_empty();
            let are_few = waiting.len() <= FEW;
            while let Some(tap) = waiting.pop_front() {
                if tap.kind() == Some(RecordKind::Data) && (are_few || waiting.is_empty()) {
                    let done = extract(&mut self.extractor, &tap);
                    drop(tap);
                    self.publish(Some(done))?;
                } else {
                    self.handle(tap, work, done)?;
                }
            }
            if is_idle && self.in_hand == 0 && self.line.is_stopped() {
                return Ok(());
            }
            if is_idle {
                self.line.wait(Duration::MAX)?;
            }
        }
    }

    fn handle(
        &mut self,
        tap: Received<TapTopic>,
        work: &Sender<Received<TapTopic>>,
        done: &Receiver<Option<Done>>,
    ) -> Result<(), RunError> {
        match tap.kind() {
            Some(RecordKind::Data) => {
                self.in_hand += 1;
                if work.send(tap).is_ok() { Ok(()) } else { Err(RunError::WorkersGone) }
            }
            Some(RecordKind::Refusal) => self.send(RecordKind::Data, tap.header(), &[refused(tap.header())]),
            Some(kind @ (RecordKind::Barrier | RecordKind::End)) => {
                // Records before the mark must be sent before it.
                while self.in_hand > 0 {
                    self.in_hand -= 1;
                    self.publish(done.recv().unwrap_or(None))?;
                }
                self.send(kind, tap.header(), &[])
            }
            _ => Ok(()),
        }
    }

    /// Publishes the discriminators of one tap; `None` means that a worker has panicked.
    fn publish(&mut self, done: Option<Done>) -> Result<(), RunError> {
        let done = done.ok_or(RunError::WorkersGone)?;
        let stamp = Stamp { casing: done.casing, ..Stamp::default() };
        self.found.send(RecordKind::Data, stamp, &[done.record])?;
        self.tap_count += 1;
        self.sample_bytes += done.sample_bytes as u64;
        let latency_us = u64::try_from((monotonic_ns() - done.sent_ns) / 1000).unwrap_or(0);
        self.latency_us.saturating_record(latency_us);
        Ok(())
    }

    /// Sends on a mark, or a refusal, of the casing of `tap`.
    fn send(&self, kind: RecordKind, tap: &TapHeader, records: &[Discriminators]) -> Result<(), RunError> {
        let stamp = Stamp { casing: tap.stamp.casing, mark: tap.stamp.mark, ..Stamp::default() };
        Ok(self.found.send(kind, stamp, records)?)
    }

    fn outcome(&self) -> Outcome {
        Outcome {
            tap_count: self.tap_count,
            sample_bytes: self.sample_bytes,
            lost_count: self.taps.lost(),
            latency_p50_us: self.latency_us.value_at_quantile(0.5),
            latency_p99_us: self.latency_us.value_at_quantile(0.99),
            worker_count: 0,
        }
    }
}

/// An empty histogram of latencies in us, to three digits.
fn latencies() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LATENCY_MAX_US, 3).expect("these bounds are allowed")
}

fn refused(tap: &TapHeader) -> Discriminators {
    Discriminators {
        id: tap.id,
        plan_index: tap.plan_index,
        quality: Quality::REFUSED,
        velocity_measured_m_per_s: f64::NAN,
        ..Discriminators::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a histogram that limits values to a range of its own.
    #[test]
    fn latencies_are_kept_to_three_digits() {
        let mut latency_us = latencies();
        for us in [70, 80, 5_000, 2_000_000, i64::MAX as u64] {
            latency_us.saturating_record(us);
        }
        let at = |quantile| latency_us.value_at_quantile(quantile) as f64;
        assert!((at(0.4) / 80.0 - 1.0).abs() < 1e-3 && (at(0.6) / 5e3 - 1.0).abs() < 1e-3);
        assert!((at(0.8) / 2e6 - 1.0).abs() < 1e-3 && at(1.0) >= LATENCY_MAX_US as f64);
    }
}
