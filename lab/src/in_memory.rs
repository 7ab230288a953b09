//! Scans a simulated line within this process: every tap is rendered and read on threads of the current pool, without
//! shared memory or archive.
//!
//! The values equal those of the line's processes bit for bit, with any number of threads.

use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, Result, bail};
use tapline_acquire::{AcquireConfig, Source};
use tapline_host::progress::{Progress, Unit};
use tapline_wire::{CacheLine, Plan, Samples, TapHeader, bytes_of, cache_lines_for, i16_of_mut};

/// A tap as a source renders it.
#[derive(Debug, Clone)]
pub struct Record {
    /// What is known of it.
    pub header: TapHeader,
    buffer: Vec<CacheLine>,
}

impl Record {
    /// Renders the tap in plan row `row`, as its first attempt.
    ///
    /// # Errors
    /// The source's refusal, or a record that does not fit its header.
    pub fn render(source: &mut impl Source, row: u32) -> Result<Self> {
        let mut record = Self::empty(source);
        record.take(source, row, 0)?;
        Ok(record)
    }

    /// With room for any tap of `source`.
    fn empty(source: &impl Source) -> Self {
        let buffer = vec![CacheLine::default(); cache_lines_for(source.plan().recording.payload_bytes_max())];
        Self { header: TapHeader::default(), buffer }
    }

    fn take(&mut self, source: &mut impl Source, row: u32, attempt: u16) -> Result<()> {
        source.render(row, attempt, &mut self.header, &mut self.buffer)?;
        Samples::view(&self.header, &self.buffer).map(|_| ()).context("a record does not fit its header")
    }

    /// Renders the taps in `rows` of the plan.
    ///
    /// # Errors
    /// As [`Record::render`].
    pub fn render_all(source: &mut impl Source, rows: impl IntoIterator<Item = usize>) -> Result<Vec<Self>> {
        rows.into_iter().map(|row| Self::render(source, u32::try_from(row)?)).collect()
    }

    /// Its samples, channel by channel.
    pub fn samples(&self) -> Samples<'_> {
        Samples::view(&self.header, &self.buffer).unwrap_or(Samples::I16(&[]))
    }

    /// Its samples, if they are counts of 16 bits; none if not.
    pub fn counts(&self) -> &[i16] {
        if let Samples::I16(counts) = self.samples() { counts } else { &[] }
    }

    /// The same, to be changed; only for counts of 16 bits.
    pub(crate) fn counts_mut(&mut self) -> &mut [i16] {
        let count = self.header.payload_bytes() / 2;
        &mut i16_of_mut(&mut self.buffer)[..count]
    }

    /// The bytes of its samples.
    pub fn bytes(&self) -> &[u8] {
        &bytes_of(&self.buffer)[..self.header.payload_bytes()]
    }
}

/// Taps that a thread takes at a time: few enough that threads end together, and enough that they rarely lock.
const TAPS_AT_A_TIME: usize = 16;

/// Returns the plan of `source` and the result of `read` for the record of each row. If `read` returns `None`, a tap is
/// taken again, as often as by default; with no retake left, it must return a result. Each thread has its own `source` and
/// `reader`.
///
/// # Errors
/// Those of `source` and `reader`, or a tap for which `read` returns no result.
pub(crate) fn scanned<S: Source, R, T: Send>(
    source: impl Fn() -> Result<S> + Sync,
    reader: impl Fn() -> Result<R> + Sync,
    read: impl Fn(&mut R, &TapHeader, Samples<'_>) -> Option<T> + Sync,
) -> Result<(Plan, Vec<T>)> {
    let plan = source()?.plan().clone();
    let mut results: Vec<Option<T>> = plan.taps().iter().map(|_| None).collect();
    let progress = Progress::new(Some(plan.taps().len() as u64), Unit::Things("taps"));
    let progress = Mutex::new((progress, 0));
    let retakes = AcquireConfig::default().retakes;
    let to_do = Mutex::new((0_u32..).step_by(TAPS_AT_A_TIME).zip(results.chunks_mut(TAPS_AT_A_TIME)));
    let work = |_: rayon::BroadcastContext<'_>| -> Result<()> {
        let (mut source, mut reader) = (source()?, reader()?);
        let mut record = Record::empty(&source);
        // Takes a tap, and again while nothing is made of it and a retake is left.
        let mut take = |row: u32| -> Result<T> {
            for attempt in 0..=retakes {
                record.take(&mut source, row, attempt)?;
                record.header.retakes_left = (retakes - attempt).into();
                if let Some(made) = read(&mut reader, &record.header, record.samples()) {
                    return Ok(made);
                }
            }
            bail!("tap {row} and its retakes gave no result")
        };
        loop {
            // A separate statement, so that the lock is released before the work starts.
            let next = to_do.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some((first_row, places)) = next else { return Ok(()) };
            let count = places.len() as u64;
            for (row, place) in (first_row..).zip(places) {
                *place = Some(take(row)?);
            }
            let (progress, done) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
            *done += count;
            progress.update(*done);
        }
    };
    rayon::broadcast(work).into_iter().collect::<Result<()>>()?;
    let results: Option<Vec<_>> = results.into_iter().collect();
    Ok((plan, results.context("a tap of the scan was not taken")?))
}
