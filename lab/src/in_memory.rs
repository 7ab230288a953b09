//! A simulated line scanned within this process: every tap rendered and its discriminators extracted, on as many
//! threads as asked, without shared memory or archive.
//!
//! Values are those that the line's processes give, bit for bit, whatever the number of threads.

use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, available_parallelism, scope};

use anyhow::{Context as _, Result, bail};
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_host::progress::{Progress, Unit};
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{CacheLine, Discriminators, Plan, Quality, Samples, TapHeader, cache_lines_for};

/// Taps that a thread takes at a time: few enough for threads to end together, and many to one lock.
const TAPS_AT_A_TIME: usize = 16;

/// What is scanned, and how its taps are read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InMemoryScan<'a> {
    /// The tyres and their taps.
    pub scan: &'a ScanConfig,
    /// The rig and its imperfections.
    pub simulation: &'a SimulationConfig,
    /// The discriminators.
    pub process: &'a ProcessConfig,
    /// How often an unusable tap is taken again, as in [`tapline_acquire::AcquireConfig::retakes`].
    pub retakes: u16,
    /// Threads; 0 is one for every core.
    pub thread_count: usize,
}

impl InMemoryScan<'_> {
    /// The plan, and of each of its rows the discriminators beside what `look` makes of the record they are from.
    ///
    /// # Errors
    /// As [`InMemoryScan::read`].
    pub(crate) fn taps<T: Send>(
        &self,
        look: impl Fn(&TapHeader, Samples<'_>) -> T + Sync,
    ) -> Result<(Plan, Vec<(Discriminators, T)>)> {
        let read = |extractor: &mut ProcessExtractor, header: &TapHeader, samples: Samples<'_>| {
            let found = extractor.extract(header, samples);
            (!found.quality.contains(Quality::RETAKE)).then(|| (found, look(header, samples)))
        };
        self.read(|| Ok(ProcessExtractor::new(self.process)?), read)
    }

    /// The plan, and what `read` makes of the record of each of its rows. A tap of which it makes nothing is taken again; of one
    /// that has no retake left it must make something. Each thread has a `reader` of its own.
    ///
    /// # Errors
    /// For a value of the configuration that is out of its bounds, when a thread cannot be started, those of `reader`, and for a tap
    /// of which nothing was made.
    pub(crate) fn read<R, T: Send>(
        &self,
        reader: impl Fn() -> Result<R> + Sync,
        read: impl Fn(&mut R, &TapHeader, Samples<'_>) -> Option<T> + Sync,
    ) -> Result<(Plan, Vec<T>)> {
        let plan = SimulatedLine::new(self.scan, self.simulation)?.plan().clone();
        let mut results: Vec<Option<T>> = plan.taps().iter().map(|_| None).collect();
        let thread_count = match self.thread_count {
            0 => available_parallelism().map_or(1, NonZeroUsize::get),
            count => count,
        };
        let progress = Progress::new(Some(plan.taps().len() as u64), Unit::Things("taps"));
        let progress = Mutex::new((progress, 0));
        let to_do = Mutex::new((0_u32..).step_by(TAPS_AT_A_TIME).zip(results.chunks_mut(TAPS_AT_A_TIME)));
        scope(|threads| {
            let work = || -> Result<()> {
                let mut maker = TapMaker::new(self)?;
                let mut reader = reader()?;
                loop {
                    // In a statement of its own, so that the lock is released before the work is done.
                    let next = to_do.lock().unwrap_or_else(PoisonError::into_inner).next();
                    let Some((first_row, places)) = next else { return Ok(()) };
                    let count = places.len() as u64;
                    for (row, place) in (first_row..).zip(places) {
                        *place = Some(maker.take(row, |header, samples| read(&mut reader, header, samples))?);
                    }
                    let (progress, done) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
                    *done += count;
                    progress.update(*done);
                }
            };
            let start = |k| Builder::new().name(format!("scan-{k}")).spawn_scoped(threads, work);
            let started: Vec<_> = (0..thread_count).map(start).collect();
            started.into_iter().try_for_each(|thread| {
                let ended = thread.context("cannot start a thread of the scan")?.join();
                ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
        })?;
        let results: Option<Vec<_>> = results.into_iter().collect();
        Ok((plan, results.context("a tap of the scan was not taken")?))
    }
}

/// One thread's rig.
struct TapMaker {
    line: SimulatedLine,
    header: TapHeader,
    buffer: Vec<CacheLine>,
    retakes: u16,
}

impl TapMaker {
    fn new(scan: &InMemoryScan<'_>) -> Result<Self> {
        let line = SimulatedLine::new(scan.scan, scan.simulation)?;
        let buffer = vec![CacheLine::default(); cache_lines_for(line.plan().recording.payload_bytes_max())];
        Ok(Self { line, header: TapHeader::default(), buffer, retakes: scan.retakes })
    }

    /// Takes the tap in plan row `row`, and again while `read` makes nothing of it and a retake is left.
    fn take<T>(&mut self, row: u32, mut read: impl FnMut(&TapHeader, Samples<'_>) -> Option<T>) -> Result<T> {
        for attempt in 0..=self.retakes {
            self.line.render(row, attempt, &mut self.header, &mut self.buffer)?;
            self.header.retakes_left = (self.retakes - attempt).into();
            let samples = Samples::view(&self.header, &self.buffer).context("a record does not fit its header")?;
            if let Some(made) = read(&self.header, samples) {
                return Ok(made);
            }
        }
        bail!("nothing was made of tap {row} and its retakes")
    }
}
