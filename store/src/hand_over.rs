//! A file of a run that takes several, and leaves what was not begun in it to a later one.

use tapline_wire::ScanState;

use crate::{Result, Writer};

impl Writer {
    /// Whether anything of scan `scan` has come.
    pub(crate) fn is_begun(&self, scan: u32) -> bool {
        let is_open = self.scans[scan as usize].state() == Some(ScanState::Open);
        let mut taps = self.plan.scans()[scan as usize].taps.iter();
        !is_open || taps.any(|&row| self.tracks[row as usize].is_begun())
    }

    /// Leaves scan `scan`, of which nothing has come, to a later file; that is written at the next flush.
    pub(crate) fn hand_over(&mut self, scan: u32) {
        for &row in &self.plan.scans()[scan as usize].taps {
            let track = &mut self.tracks[row as usize];
            if !track.is_later() {
                track.hand_over();
                self.pending.taps.insert(row, track.to_row(false));
            }
        }
    }

    /// Whether scan `scan` is left to a later file.
    pub(crate) fn is_later(&self, scan: u32) -> bool {
        self.plan.scans()[scan as usize].taps.iter().all(|&row| self.tracks[row as usize].is_later())
    }

    /// Whether every scan that is not left to a later file is judged, as of the last flush.
    pub(crate) fn is_judged(&self) -> bool {
        (0..).zip(self.ledger.scans()).all(|(scan, &state)| state == ScanState::Judged || self.is_later(scan))
    }

    /// Does what [`Writer::finish`] does, and still tells a record that comes again from one that contradicts it.
    pub(crate) fn shut(&mut self) -> Result<()> {
        self.settle()?;
        drop(self.archive.take());
        self.place.sync()?;
        self.rest();
        Ok(())
    }

    /// The file is closed: what it takes to write it is given back.
    pub(crate) fn rest(&mut self) {
        drop(self.archive.take());
        self.place.rest();
        self.packer.rest();
        self.pending.rest();
        self.is_closed = true;
    }

    /// Whether the file is closed, and nothing is left to do to it.
    pub(crate) fn is_shut(&self) -> bool {
        self.is_closed && self.pending.is_empty()
    }
}
