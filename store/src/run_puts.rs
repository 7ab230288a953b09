//! What is put into a run: each record goes to the file that has its scan, under that file's own numbers.

use tapline_wire::{DamageCell, Discriminators, Judgement, Quality, ScanState, TapHeader, TapId};

use crate::archive::{Access, Archive};
use crate::check::check_scan;
use crate::context::Context as _;
use crate::replay::REPLAY_ROWS_MAX;
use crate::{PutOutcome, Result, RunWriter, Writer};

impl RunWriter {
    /// Takes in taps: see [`Writer::put_taps`].
    ///
    /// # Errors
    /// As [`Writer::put_taps`], or that a new file cannot be begun; after [`RunWriter::recover`] the same call may be made again.
    pub fn put_taps(&mut self, taps: &[(&TapHeader, &[u8])]) -> Result<Vec<PutOutcome>> {
        let mut placed = Vec::with_capacity(taps.len());
        for &(header, samples) in taps {
            let (part, plan_index) = self.part_of_tap(header.plan_index, &header.id)?;
            let mut there = TapHeader { plan_index, ..*header };
            if there.stamp.plan_digest == self.plan.digest() {
                there.stamp.plan_digest = self.writers[part].plan().digest();
            }
            placed.push((part, there, samples));
        }
        let mut outcomes = Vec::with_capacity(taps.len());
        for of_one in placed.chunk_by(|a, b| a.0 == b.0) {
            let taps: Vec<(&TapHeader, &[u8])> = of_one.iter().map(|(_, header, samples)| (header, *samples)).collect();
            outcomes.extend(self.writers[of_one[0].0].put_taps(&taps)?);
        }
        Ok(outcomes)
    }

    /// Takes in what was found in a tap: see [`Writer::put_discriminators`].
    ///
    /// # Errors
    /// As [`RunWriter::put_taps`].
    pub fn put_discriminators(&mut self, found: &Discriminators) -> Result<PutOutcome> {
        let (part, plan_index) = self.part_of_tap(found.plan_index, &found.id)?;
        self.writers[part].put_discriminators(&Discriminators { plan_index, ..*found })
    }

    /// Takes in that a tap will not come: see [`Writer::put_refusal`].
    ///
    /// # Errors
    /// As [`RunWriter::put_taps`].
    pub fn put_refusal(&mut self, plan_index: u32, id: &TapId, reason: &str) -> Result<PutOutcome> {
        let (part, plan_index) = self.part_of_tap(plan_index, id)?;
        self.writers[part].put_refusal(plan_index, id, reason)
    }

    /// Takes in that a tap is to be taken again: see [`Writer::put_retake`].
    ///
    /// # Errors
    /// As [`RunWriter::put_taps`].
    pub fn put_retake(&mut self, plan_index: u32, id: &TapId, quality: Quality) -> Result<PutOutcome> {
        let (part, plan_index) = self.part_of_tap(plan_index, id)?;
        self.writers[part].put_retake(plan_index, id, quality)
    }

    /// Takes in that scan `scan` has ended: see [`Writer::end_scan`].
    ///
    /// # Errors
    /// As [`RunWriter::put_taps`].
    pub fn end_scan(&mut self, scan: u32) -> Result<PutOutcome> {
        check_scan(&self.plan, scan)?;
        let (part, scan) = self.part_of_scan(scan)?;
        self.writers[part].end_scan(scan)
    }

    /// Takes in the verdict on scan `scan`: see [`Writer::put_judgement`].
    ///
    /// # Errors
    /// As [`RunWriter::put_taps`].
    pub fn put_judgement(&mut self, scan: u32, judgement: &Judgement, cells: &[DamageCell]) -> Result<PutOutcome> {
        check_scan(&self.plan, scan)?;
        let (part, scan) = self.part_of_scan(scan)?;
        self.writers[part].put_judgement(scan, judgement, cells)
    }

    /// Some of the taps that are settled, from plan row `from` on: see [`Writer::settled_from`].
    ///
    /// # Errors
    /// What the system says.
    pub fn settled_from(&mut self, from: u32, most: usize) -> Result<(Vec<Discriminators>, Option<u32>)> {
        let tap_count = u32::try_from(self.plan.taps().len()).unwrap_or(u32::MAX);
        if from >= tap_count {
            return Ok((Vec::new(), None));
        }
        let (part, first) = self.map.tap(from);
        // As far as rows follow one another in one file.
        let is_next = |&k: &u32| self.map.tap(from + k) == (part, first + k);
        let most = most.min(REPLAY_ROWS_MAX);
        let count = (0..tap_count - from).take(most).take_while(is_next).count();
        let writer = &self.writers[part];
        if writer.is_shut() && self.told_again.as_ref().is_none_or(|(told, _)| *told != part) {
            self.told_again = Some((part, Archive::open(&writer.path, Access::Read)?));
        }
        let shut = self.told_again.as_ref().filter(|_| writer.is_shut()).map(|(_, archive)| archive);
        let (mut records, _) = writer.settled_in(shut.map_or_else(|| writer.open(), Ok)?, first, count)?;
        records.iter_mut().for_each(|record| record.plan_index = record.plan_index - first + from);
        let next = from.saturating_add(u32::try_from(count).unwrap_or(u32::MAX));
        let next = Some(next).filter(|&next| next < tap_count);
        if next.is_none() {
            self.told_again = None;
        }
        Ok((records, next))
    }

    /// Writes what waits: see [`Writer::flush`]. A file that takes no new scan, and whose scans are all judged, is closed.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn flush(&mut self) -> Result<()> {
        let flushed = self.open().try_for_each(Writer::flush);
        self.note_states();
        flushed?;
        let last = self.writers.len() - 1;
        let done = self.writers[..last].iter_mut().filter(|writer| !writer.is_shut() && writer.is_judged());
        done.into_iter().try_for_each(Writer::shut)
    }

    /// Does what [`Writer::settle`] does.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn settle(&mut self) -> Result<()> {
        let settled = self.open().try_for_each(Writer::settle);
        self.note_states();
        settled
    }

    /// Does what [`RunWriter::settle`] does, and what [`Writer::finish`] does then.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish(mut self) -> Result<()> {
        self.settle()?;
        self.close()
    }

    /// The rest of [`RunWriter::finish`].
    pub(crate) fn close(self) -> Result<()> {
        let failed = self.writers.iter().try_for_each(|writer| writer.failures.last().context("sync", &writer.path));
        let closed = self.writers.into_iter().filter(|writer| !writer.is_shut()).try_for_each(Writer::close);
        failed.and(closed)
    }

    /// Checks that the files are in their places: see [`Writer::check_place`].
    ///
    /// # Errors
    /// As [`Writer::check_place`].
    pub fn check_place(&mut self) -> Result<()> {
        self.open().try_for_each(Writer::check_place)
    }

    /// After an error for which [`crate::Error::is_of_the_disk`]: see [`Writer::recover`]. Begins a file that could not be begun.
    ///
    /// # Errors
    /// As [`Writer::recover`].
    pub fn recover(&mut self) -> Result<()> {
        let recovered = self.open().try_for_each(Writer::recover);
        self.note_states();
        recovered?;
        self.waits_for_file.map_or(Ok(()), |scan| self.rotate(scan))
    }

    /// Whether the files are in their places: see [`Writer::is_in_place`].
    pub fn is_in_place(&self) -> bool {
        self.writers.iter().all(|writer| writer.is_shut() || writer.is_in_place())
    }

    /// Whether every tap is settled and every scan judged that is not left to a later file, as of the last flush.
    pub fn is_whole(&self) -> bool {
        let is_alone = !self.path.is_dir();
        (0..).zip(self.plan.scans()).all(|(scan, planned)| {
            let is_settled = |&row: &u32| self.ledger.taps()[row as usize].is_settled();
            let is_done =
                self.ledger.scans()[scan as usize] == ScanState::Judged && planned.taps.iter().all(is_settled);
            let (part, there) = self.map.scan(scan);
            // In the run's folder there is no other place for it.
            is_done || (is_alone && self.writers[part].is_later(there))
        })
    }

    /// The files that are not closed.
    fn open(&mut self) -> impl Iterator<Item = &mut Writer> {
        self.writers.iter_mut().filter(|writer| !writer.is_shut())
    }
}
