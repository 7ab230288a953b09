//! `process` on a line: one thread, which reads samples in place. More threads would be slower: waking one takes as long as
//! extracting a tap of 50 ms.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use tapline_wire::{
    DiscriminatorTopic, Discriminators, Line, LineError, Publisher, Received, RecordKind, Samples, Stamp, Subscriber,
    TapTopic, monotonic_ns,
};

use crate::{Error, ProcessConfig, ProcessExtractor};

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
    /// The time that 99 of 100 taps do not exceed.
    pub latency_p99_us: u64,
}

/// Turns the taps on `line` into discriminators until asked to stop.
///
/// # Errors
/// [`RunError`] if the configuration is not valid or shared memory fails. Being asked to stop is not an error.
pub fn run(line: &Line, config: &ProcessConfig) -> Result<Outcome, RunError> {
    let mut stage = StageLoop::open(line, config)?;
    match stage.serve() {
        Ok(()) | Err(LineError::Stopped { .. }) => Ok(stage.outcome()),
        Err(error) => Err(error.into()),
    }
}

struct StageLoop<'a> {
    line: &'a Line,
    taps: Subscriber<'a, TapTopic>,
    found: Publisher<'a, DiscriminatorTopic>,
    extractor: ProcessExtractor,
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
            tap_count: 0,
            sample_bytes: 0,
            latency_us: latencies(),
        })
    }

    fn serve(&mut self) -> Result<(), LineError> {
        loop {
            let mut is_idle = true;
            while let Some(tap) = self.taps.receive()? {
                self.handle(&tap)?;
                is_idle = false;
            }
            if is_idle && self.line.is_stopped() {
                return Ok(());
            }
            if is_idle {
                self.line.wait(Duration::MAX)?;
            }
        }
    }

    fn handle(&mut self, tap: &Received<TapTopic>) -> Result<(), LineError> {
        let header = tap.header();
        let stamp = Stamp { casing: header.stamp.casing, mark: header.stamp.mark, ..Stamp::default() };
        match tap.kind() {
            Some(RecordKind::Data) => {
                // The extractor flags a header that does not fit its payload; it then sees no samples.
                let samples = Samples::view(header, tap).unwrap_or(Samples::I16(&[]));
                let record = self.extractor.extract(header, samples);
                self.found.send(RecordKind::Data, Stamp { mark: 0, ..stamp }, &[record])?;
                self.tap_count += 1;
                self.sample_bytes += header.payload_bytes() as u64;
                let latency_us = u64::try_from((monotonic_ns() - header.sent_ns) / 1000).unwrap_or(0);
                self.latency_us.saturating_record(latency_us);
                Ok(())
            }
            Some(RecordKind::Refusal) => {
                self.found.send(RecordKind::Data, stamp, &[Discriminators::refused(header.id, header.plan_index)])
            }
            Some(kind @ (RecordKind::Barrier | RecordKind::End)) => self.found.send(kind, stamp, &[]),
            _ => Ok(()),
        }
    }

    fn outcome(&self) -> Outcome {
        Outcome {
            tap_count: self.tap_count,
            sample_bytes: self.sample_bytes,
            lost_count: self.taps.lost(),
            latency_p50_us: self.latency_us.value_at_quantile(0.5),
            latency_p99_us: self.latency_us.value_at_quantile(0.99),
        }
    }
}

/// An empty histogram of latencies in us, to three digits.
fn latencies() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LATENCY_MAX_US, 3).expect("these bounds are allowed")
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
