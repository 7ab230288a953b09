//! What the stage receives: taps, discriminators and verdicts, each put into the archive of its casing.

use tapline_wire::{
    AskTopic, DiscriminatorTopic, Quality, Received, RecordKind, TapHeader, TapTopic, Topic as _, bytes_of,
    decode_taps, split_end_mark,
};

use super::StageLoop;
use super::outcome::RunError;
use crate::error::Error;
use crate::write::Writer;
use crate::write::put_taps::put_taps_of;
use crate::write::tap_state::PutOutcome;

/// Taps that are put together, packed by several threads: as many as a subscriber may hold at once.
const BATCH_TAPS: usize = TapTopic::BORROWED;

/// Batches that are put before the stage looks for other records.
const BATCHES_MAX: usize = 2;

impl StageLoop<'_> {
    /// Puts the records that have come, at most as many as the buffers hold; returns whether any had.
    pub(super) fn receive(&mut self) -> Result<bool, RunError> {
        let mut has_come = false;
        while let Some(proposal) = self.proposals.receive()? {
            has_come = true;
            self.take_proposal(&proposal)?;
        }
        for _ in 0..BATCHES_MAX {
            let mut batch = Vec::with_capacity(BATCH_TAPS);
            while batch.len() < BATCH_TAPS
                && let Some(tap) = self.taps.receive()?
            {
                batch.push(tap);
            }
            if batch.is_empty() {
                break;
            }
            has_come = true;
            // Other records keep their order among the taps.
            for part in batch.chunk_by(|a, b| a.kind() == Some(RecordKind::Data) && b.kind() == a.kind()) {
                self.take_taps(part)?;
            }
        }
        while let Some(found) = self.found.receive()? {
            has_come = true;
            self.take_found(&found)?;
        }
        while let Some(judged) = self.verdicts.receive()? {
            has_come = true;
            let header = judged.header();
            let scan = u32::try_from(header.stamp.mark).unwrap_or(u32::MAX);
            if let Some(index) = self.index_of(header.stamp.casing) {
                let outcome =
                    self.retry_until_recovered(index, |writer| writer.put_judgement(scan, judged.header(), &judged))?;
                self.note(index, outcome, "a verdict", scan);
                self.is_urgent = true;
            }
        }
        while let Some(asked) = self.asked.receive()? {
            has_come = true;
            self.take_asked(&asked)?;
        }
        Ok(has_come)
    }

    /// Adds the taps that `fuse` asks for to the plan of their casing.
    fn take_asked(&mut self, asked: &Received<AskTopic>) -> Result<(), RunError> {
        let stamp = *asked.header();
        let Some(index) = self.index_of(stamp.casing) else { return Ok(()) };
        // A request based on an earlier plan was repeated since.
        if stamp.mark != self.open[index].writer.plan().taps().len() as u64 {
            return Ok(());
        }
        let taps = decode_taps(asked).map_err(|error| error.to_string());
        let grown = match taps {
            Ok(_) if self.open[index].is_full => Err("no more taps will come".to_owned()),
            Ok(taps) => self.retry_until_recovered(index, |writer| match writer.grow(&taps) {
                Err(error @ Error::CannotGrow { .. }) => Ok(Err(error.to_string())),
                outcome => outcome.map(Ok),
            })?,
            Err(error) => Err(error),
        };
        if let Err(error) = grown {
            tracing::error!(casing = self.open[index].name, error, "it is judged with the taps that it has");
            self.open[index].is_full = true;
        }
        // `fuse` begins the casing again with the current plan.
        self.open[index].begin_anew();
        self.is_urgent = true;
        Ok(())
    }

    pub(super) fn index_of(&self, number: u64) -> Option<usize> {
        self.open.iter().position(|casing| casing.number == number)
    }

    /// Puts taps, or one record of another kind.
    fn take_taps(&mut self, part: &[Received<TapTopic>]) -> Result<(), RunError> {
        let Some(first) = part.first() else { return Ok(()) };
        let header = first.header();
        match first.kind() {
            Some(RecordKind::Data) => self.put_taps(part)?,
            Some(RecordKind::Refusal) => {
                let Some(index) = self.index_of(header.stamp.casing) else { return Ok(()) };
                let text = bytes_of(first).get(..header.text_bytes as usize).unwrap_or_default();
                let reason = String::from_utf8_lossy(text);
                tracing::warn!(tap = %header.id, %reason, "a tap was refused");
                let outcome = self.retry_until_recovered(index, |writer| {
                    writer.put_refusal(header.plan_index, &header.id, &reason)
                })?;
                self.note(index, outcome, "a refusal", header.plan_index);
            }
            Some(RecordKind::Barrier) => {
                let Some(index) = self.index_of(header.stamp.casing) else {
                    // The station will hear of a file that is being closed: it has sent its barrier again meanwhile.
                    if !self.closer.is_closing(header.stamp.casing) {
                        self.notices.unknown(&header.stamp);
                    }
                    return Ok(());
                };
                self.open[index].barriers.0 = low_byte(header.stamp.mark);
                self.open[index].is_dirty = true;
            }
            // The end that counts comes with the discriminators, after it has passed through `process`.
            _ => {}
        }
        Ok(())
    }

    /// Puts taps of any casings, packed together.
    fn put_taps(&mut self, part: &[Received<TapTopic>]) -> Result<(), RunError> {
        let mut taps: Vec<(usize, &TapHeader, &[u8])> = Vec::with_capacity(part.len());
        for tap in part {
            if let Some(index) = self.index_of(tap.header().stamp.casing) {
                taps.push((index, tap.header(), bytes_of(tap)));
            }
        }
        let mut writers: Vec<&mut Writer> = self.open.iter_mut().map(|casing| &mut casing.writer).collect();
        let outcomes = put_taps_of(&mut writers, &taps);
        for ((index, header, samples), outcome) in taps.into_iter().zip(outcomes) {
            let outcome = match outcome {
                // Put separately, as often as necessary.
                Err(error) if error.is_recoverable() => {
                    self.wait_for_recovery(index, error)?;
                    self.retry_until_recovered(index, |writer| writer.put_tap(header, samples))?
                }
                outcome => outcome?,
            };
            self.note(index, outcome, "a tap", header.plan_index);
        }
        Ok(())
    }

    fn take_found(&mut self, found: &Received<DiscriminatorTopic>) -> Result<(), RunError> {
        let stamp = *found.header();
        let Some(index) = self.index_of(stamp.casing) else { return Ok(()) };
        match found.kind() {
            Some(RecordKind::Data) => {
                // The refusal of a refused tap comes with the taps.
                for record in found.iter().filter(|r| !r.quality.contains(Quality::REFUSED)) {
                    let outcome = if record.quality.contains(Quality::RETAKE) {
                        tracing::info!(tap = %record.id, quality = %record.quality, "a tap is taken again");
                        self.retry_until_recovered(index, |w| {
                            w.put_retake(record.plan_index, &record.id, record.quality)
                        })?
                    } else {
                        self.retry_until_recovered(index, |writer| writer.put_discriminators(record))?
                    };
                    self.note(index, outcome, "discriminators", record.plan_index);
                }
            }
            Some(RecordKind::Barrier) => {
                self.open[index].barriers.1 = low_byte(stamp.mark);
                self.open[index].is_dirty = true;
                self.is_urgent = true;
            }
            Some(RecordKind::End) => {
                let (scan, tap_count) = split_end_mark(stamp.mark);
                // An end that was sent before the plan grew ends nothing: the station sends another.
                if tap_count == self.open[index].writer.plan().taps().len() {
                    let outcome = self.retry_until_recovered(index, |writer| writer.end_scan(scan))?;
                    self.note(index, outcome, "an end", scan);
                    self.is_urgent = true;
                }
            }
            _ => {}
        }
        Ok(())
    }

    pub(super) fn note(&mut self, index: usize, outcome: PutOutcome, what: &str, number: u32) {
        self.open[index].is_dirty = true;
        if outcome == PutOutcome::Conflict {
            let casing = &self.open[index].name;
            tracing::error!(casing, what, number, "came again and differs from what is archived; the first is kept");
        }
    }
}

/// Barriers count modulo 256.
fn low_byte(mark: u64) -> u8 {
    (mark & 0xff) as u8
}
