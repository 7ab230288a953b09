//! An open casing: its writer, and the notices that are due.

use std::collections::VecDeque;
use std::ops::Range;
use std::time::Instant;

use tapline_wire::{CasingHeader, Ledger, Plan, ScanState, Stamp, TapState, casing_number};

use super::places::{name_of_open, stem_of};
use crate::write::Writer;

/// The notices that are due to one receiver.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Due {
    /// That the casing is open, with its plan.
    pub plan: bool,
    /// Its ledger.
    pub ledger: bool,
}

impl Due {
    pub(super) const ALL: Self = Self { plan: true, ledger: true };
}

#[derive(Debug)]
pub(super) struct OpenCasing {
    pub(super) number: u64,
    pub(super) name: String,
    pub(super) escaped_name: String,
    pub(super) station: u16,
    pub(super) writer: Writer,
    /// The last barrier among the taps, and among the discriminators.
    pub(super) barriers: (u8, u8),
    /// The last barrier before the last flush.
    passed: u8,
    /// The states of the scans as of the last flush.
    scans: Vec<ScanState>,
    pub(super) is_dirty: bool,
    /// Rows of the plan whose discriminators are to be sent to `fuse`.
    pub(super) replays: VecDeque<Range<u32>>,
    pub(super) acquire: Due,
    pub(super) fuse: Due,
    pub(super) supervisor: Due,
    pub(super) supervisor_sent_at: Option<Instant>,
    /// Whether no taps can be added any more.
    pub(super) is_full: bool,
    /// Taps that were settled when it was opened.
    settled_before_count: u32,
}

impl OpenCasing {
    pub(super) fn new(writer: Writer) -> Self {
        let stem = stem_of(writer.path());
        let name = name_of_open(&stem);
        let station = writer.plan().scans().first().map_or(0, |scan| scan.station);
        let scans = writer.ledger().scans().to_vec();
        let settled = writer.ledger().count(TapState::Archived) + writer.ledger().count(TapState::Refused);
        let mut casing = Self {
            number: casing_number(&stem),
            name,
            escaped_name: stem.rsplit_once('.').map_or(stem.as_str(), |(name, _)| name).to_owned(),
            station,
            writer,
            barriers: (0, 0),
            passed: 0,
            scans,
            is_dirty: false,
            replays: VecDeque::new(),
            acquire: Due::ALL,
            fuse: Due::ALL,
            supervisor: Due::ALL,
            supervisor_sent_at: None,
            is_full: false,
            settled_before_count: u32::try_from(settled).unwrap_or(u32::MAX),
        };
        casing.replay_ended();
        casing
    }

    /// Notes that all records put until now are flushed.
    pub(super) fn flushed(&mut self) {
        self.is_dirty = false;
        self.supervisor.ledger = true;
        if self.barriers.0 == self.barriers.1 && self.passed != self.barriers.0 {
            self.passed = self.barriers.0;
            self.acquire.ledger = true;
        }
        let now = self.writer.ledger().scans().to_vec();
        if now != self.scans {
            let is_new =
                |scan: &usize| self.scans.get(*scan) == Some(&ScanState::Open) && now[*scan] != ScanState::Open;
            let ended: Vec<usize> = (0..now.len()).filter(is_new).collect();
            ended.into_iter().for_each(|scan| self.replay_scan(scan));
            self.scans = now;
            (self.acquire.ledger, self.fuse.ledger) = (true, true);
            self.supervisor_sent_at = None;
        }
    }

    /// Has the stages notified of the casing as if it had just been opened: its plan has grown, which flushes it.
    pub(super) fn begin_anew(&mut self) {
        self.scans = self.writer.ledger().scans().to_vec();
        (self.acquire, self.fuse, self.supervisor) = (Due::ALL, Due::ALL, Due::ALL);
        self.supervisor_sent_at = None;
        self.replay_ended();
    }

    /// Queues the flushed records of every ended scan for a `fuse` that has none of them.
    pub(super) fn replay_ended(&mut self) {
        self.replays.clear();
        let ended = |scan: &usize| self.scans[*scan] != ScanState::Open;
        let scans: Vec<usize> = (0..self.scans.len()).filter(ended).collect();
        scans.into_iter().for_each(|scan| self.replay_scan(scan));
    }

    fn replay_scan(&mut self, scan: usize) {
        let taps = &self.writer.plan().scans()[scan].taps;
        if let (Some(&first), Some(&last)) = (taps.first(), taps.last()) {
            self.replays.push_back(first..last + 1);
        }
    }

    pub(super) fn is_judged(&self) -> bool {
        self.scans.iter().all(|&state| state == ScanState::Judged)
    }

    /// Header and ledger, as of the last flush.
    pub(super) fn ledger(&self, lost_count: u64, is_held: bool) -> (CasingHeader, Ledger) {
        let mut ledger = self.writer.ledger().clone();
        (ledger.barrier, ledger.lost_count, ledger.is_stalled) = (self.passed, lost_count, is_held);
        (self.header(), ledger)
    }

    /// The header of notices about the casing.
    pub(super) fn header(&self) -> CasingHeader {
        let room = if self.is_full { 0 } else { self.writer.room() };
        let room = u32::try_from(room).unwrap_or(u32::MAX);
        let (settled_before_count, tapped_ns) = (self.settled_before_count, self.writer.last_tap_ns());
        CasingHeader { room, settled_before_count, tapped_ns, ..Self::header_of(self.number, self.writer.plan()) }
    }

    /// The header of notices about a casing with this number and plan.
    pub(super) fn header_of(number: u64, plan: &Plan) -> CasingHeader {
        CasingHeader {
            stamp: Stamp { casing: number, ..Stamp::default() },
            plan_digest: plan.begun_digest(),
            station: plan.scans().first().map_or(0, |scan| scan.station.into()),
            tap_count: u32::try_from(plan.taps().len()).unwrap_or(u32::MAX),
            ..CasingHeader::default()
        }
    }

    /// The stamp of records that are sent to `fuse`.
    pub(super) fn settled_stamp(&self) -> Stamp {
        Stamp { casing: self.number, mark: self.writer.plan().taps().len() as u64, ..Stamp::default() }
    }
}
