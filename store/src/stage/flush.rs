//! What the stage makes durable, replays to `fuse` and closes.

use std::time::Instant;

use tapline_wire::RecordKind;

use super::open_casing::OpenCasing;
use super::outcome::RunError;
use super::{FLUSH_EVERY, StageLoop};
use crate::write::Writer;

impl StageLoop<'_> {
    /// Flushes if another stage waits and no more records have come, and after [`FLUSH_EVERY`].
    pub(super) fn flush_if_due(&mut self, is_idle: bool) -> Result<(), RunError> {
        if !(is_idle && self.is_urgent) && self.flushed_at.elapsed() < FLUSH_EVERY {
            return Ok(());
        }
        for index in 0..self.open.len() {
            if self.open[index].is_dirty {
                self.retry_until_recovered(index, Writer::flush)?;
                self.open[index].flushed();
            }
        }
        self.is_urgent = false;
        self.flushed_at = Instant::now();
        Ok(())
    }

    /// Sends `fuse` the flushed records of ended scans. It must never wait, because `fuse` may be waiting for this stage.
    pub(super) fn replay(&mut self) -> Result<(), RunError> {
        if !self.settled.poll_ready()? {
            return Ok(());
        }
        let generation = self.settled.generation();
        if std::mem::replace(&mut self.fuse_generation, generation) != generation {
            self.open.iter_mut().for_each(OpenCasing::replay_ended);
        }
        for index in 0..self.open.len() {
            while let Some(rows) = self.open[index].replays.front().cloned() {
                if self.open[index].fuse.plan {
                    break; // the plan comes first
                }
                let most = tapline_wire::SETTLED_RECORDS_MAX.min(rows.len());
                let (records, next) =
                    self.retry_until_recovered(index, |writer| writer.settled_from(rows.start, most))?;
                let stamp = self.open[index].settled_stamp();
                if !records.is_empty() && !self.settled.try_send(RecordKind::Data, stamp, &records)? {
                    return Ok(());
                }
                let remaining = next.unwrap_or(rows.end)..rows.end;
                match self.open[index].replays.front_mut() {
                    Some(front) if !remaining.is_empty() => *front = remaining,
                    _ => drop(self.open[index].replays.pop_front()),
                }
            }
        }
        Ok(())
    }

    /// Closes the archives whose every scan is judged.
    pub(super) fn close_judged(&mut self) -> Result<(), RunError> {
        let mut index = 0;
        while index < self.open.len() {
            if !self.open[index].is_judged() {
                index += 1;
                continue;
            }
            self.retry_until_recovered(index, Writer::settle)?;
            let casing = self.open.swap_remove(index);
            self.outcome.conflict_count += casing.writer.counts().conflicts;
            self.closer.close(casing);
        }
        while let Some(closed) = self.closer.take_closed() {
            self.note_closed(closed.map_err(|error| match error.is_recoverable() {
                // A finished file that is not in its place yet is handled when this stage runs next.
                true => RunError::FileSystem { error },
                false => error.into(),
            })?);
        }
        Ok(())
    }
}
