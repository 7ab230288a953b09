//! What stations propose: a casing to open, or one to give up.

use std::path::Path;

use tapline_wire::{
    Plan, ProposalTopic, Received, RecordKind, ScanState, TapState, Topic as _, casing_number, decode_proposal,
};

use super::StageLoop;
use super::open_casing::{Due, OpenCasing};
use super::outcome::{RunError, write_failure};
use super::places::{escaped, name_of_open, stem_of};
use crate::error::{Error, Result};
use crate::read::reader::Reader;
use crate::write::Writer;

impl StageLoop<'_> {
    /// Resumes the unfinished files that an earlier `store` left; those that cannot be resumed are put aside.
    pub(super) fn reopen(&mut self) -> Result<(), RunError> {
        self.run.places.create()?;
        self.take_up_finished()?;
        for path in self.run.places.open_files()? {
            let resume = || Writer::resume(&path, self.run.lineage());
            // What cannot be read may have been a moment's trouble.
            let again = |error: Error| if error.is_unreadable_part() { resume() } else { Err(error) };
            match resume().or_else(again) {
                Ok(writer) => self.open.push(OpenCasing::new(writer)),
                Err(Error::Finished { .. }) => match Reader::open(&path) {
                    Ok(sealed) => self.take_up_sealed(&path, sealed.plan())?,
                    Err(error) if error.is_recoverable() && !error.is_unreadable_part() => {
                        return Err(write_failure(error));
                    }
                    Err(error) => {
                        self.put_aside(&path, &error)?;
                    }
                },
                // A bad sector does not go away.
                Err(error) if error.is_recoverable() && !error.is_unreadable_part() => {
                    return Err(write_failure(error));
                }
                Err(error) => {
                    // Where the whole file system has failed, the file cannot be moved either.
                    self.put_aside(&path, &error)?;
                }
            }
        }
        Ok(())
    }

    /// Puts aside the file of a casing that cannot be continued because of `error`: it gets no verdict unless it is tapped again.
    fn put_aside(&mut self, path: &Path, error: &Error) -> Result<(), RunError> {
        let left = self.run.places.leave(path).map_err(write_failure)?;
        let stem = stem_of(path);
        let name = name_of_open(&stem);
        let text =
            format!("casing {name} must be tapped again: {error}; its taps so far are put aside as {}", left.display());
        tracing::error!("{text}");
        self.notices.put_aside(casing_number(&stem), &text);
        Ok(())
    }

    pub(super) fn take_proposal(&mut self, proposal: &Received<ProposalTopic>) -> Result<(), RunError> {
        let stamp = *proposal.header();
        let acquire = u16::try_from(stamp.source).unwrap_or(u16::MAX);
        match proposal.kind() {
            Some(RecordKind::Plan) => match decode_proposal(proposal) {
                Ok((name, plan, room)) => self.propose(acquire, &name, &plan, room),
                Err(error) => {
                    tracing::error!(%error, topic = ProposalTopic::NAME, "a proposal cannot be read");
                    Ok(())
                }
            },
            Some(RecordKind::Refusal) => match self.index_of(stamp.casing) {
                Some(index) => self.give_up(index, &String::from_utf8_lossy(proposal)),
                None => Ok(()),
            },
            _ => Ok(()),
        }
    }

    fn propose(&mut self, acquire: u16, name: &str, plan: &Plan, room: u32) -> Result<(), RunError> {
        let station = plan.scans().first().map_or(0, |scan| scan.station);
        let header = OpenCasing::header_of(0, plan);
        if let Some(open) = self.open.iter_mut().find(|casing| casing.escaped_name == escaped(name)) {
            if (open.station, open.writer.plan().begun_digest()) == (station, plan.digest()) {
                // It is open already: an earlier notice did not reach the station.
                open.acquire = Due::ALL;
                return Ok(());
            }
            let cure = match self.line.limits().acquire_of(open.station) {
                Some(_) => "is its serial wrong? If not, it may come again when that is done",
                None => {
                    "that station is not in the configuration: put it back, or move the file out of the folder `open`"
                }
            };
            let reason = format!("casing {name} is already open at station {}: {cure}", open.station);
            self.notices.answer(acquire, RecordKind::Refusal, header, &reason);
            return Ok(());
        }
        if let Some(path) = self.finished_before(name, plan)? {
            tracing::info!(casing = name, "is already finished: {}", path.display());
            self.notices.answer(acquire, RecordKind::Closed, header, &path.display().to_string());
            return Ok(());
        }
        let (path, run) = (self.run.places.begin(name), self.run);
        let taps_max = plan.taps().len() + room as usize;
        let writer = self.retry_new_until_recovered(|| {
            match Writer::create(&path, plan, taps_max, run.lineage()) {
                // An earlier attempt may have created it and failed to open it.
                Err(Error::Exists { .. }) => Writer::resume(&path, run.lineage()),
                made => made,
            }
        });
        match writer {
            Ok(writer) => self.open.push(OpenCasing::new(writer)),
            Err(RunError::Archive(error)) => {
                self.notices.answer(acquire, RecordKind::Refusal, header, &error.to_string());
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// The finished file of a casing that need not be tapped: of the same run, or of the same recordings. One that lacks some of
    /// them does not count: they may be there now.
    fn finished_before(&self, name: &str, plan: &Plan) -> Result<Option<std::path::PathBuf>> {
        if self.run.skips_finished {
            return Ok(self.run.places.finished(name));
        }
        if plan.source_digest() == 0 {
            return Ok(None);
        }
        let is_same = |path: &std::path::PathBuf| {
            Reader::open(path).is_ok_and(|file| {
                let count = |state| file.ledger().count(state);
                file.plan().begun_digest() == plan.digest() && count(TapState::Refused) + count(TapState::Missing) == 0
            })
        };
        Ok(self.run.places.all_finished(name).into_iter().find(is_same))
    }

    /// Refuses every missing tap of a casing, and ends its scans.
    fn give_up(&mut self, index: usize, reason: &str) -> Result<(), RunError> {
        // Nobody can be asked for more of its taps: `fuse` begins it again, and judges what there is.
        if !std::mem::replace(&mut self.open[index].is_full, true) {
            self.open[index].begin_anew();
        }
        let writer = &self.open[index].writer;
        let missing: Vec<_> = (0..)
            .zip(writer.plan().taps().iter().zip(writer.ledger().taps()))
            .filter(|&(_, (_, &state))| state == TapState::Missing)
            .map(|(row, (tap, _))| {
                let mut id = tap.id;
                id.attempt = writer.ledger().attempt(row as usize);
                (row as u32, id)
            })
            .collect();
        let open: Vec<u32> =
            (0..).zip(writer.ledger().scans()).filter(|&(_, &s)| s == ScanState::Open).map(|(scan, _)| scan).collect();
        let casing = &self.open[index].name;
        tracing::warn!(casing, reason, taps = missing.len(), "taps of a casing will not come");
        for (row, id) in missing {
            self.retry_until_recovered(index, |writer| writer.put_refusal(row, &id, reason))?;
        }
        for scan in open {
            self.retry_until_recovered(index, |writer| writer.end_scan(scan))?;
        }
        self.open[index].is_dirty = true;
        self.is_urgent = true;
        Ok(())
    }
}
