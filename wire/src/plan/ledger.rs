//! The state of every planned tap: plan - ledger is the work left to do.

use crate::CasingHeader;

/// State of one planned tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TapState {
    /// Not taken yet: work to do.
    Missing,
    /// Samples and discriminators are in the archive.
    Archived,
    /// Refused for a stated reason; it will not come.
    Refused,
}

coded!(TapState: u8, Missing = 0, Archived = 1, Refused = 2);
named!(TapState, Missing = "missing", Archived = "archived", Refused = "refused");

impl TapState {
    /// Whether nothing is left to do for the tap.
    pub fn is_settled(self) -> bool {
        self != Self::Missing
    }
}

/// State of one scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ScanState {
    /// More taps are to come.
    Open,
    /// Its end mark has arrived, in band.
    Ended,
    /// Its verdict is in the archive.
    Judged,
}

coded!(ScanState: u8, Open = 0, Ended = 1, Judged = 2);

/// The end mark of scan number `scan` of a casing with `tap_count` planned taps: an end mark that is older than the last taps of
/// a plan has no effect.
pub fn end_mark(scan: u32, tap_count: usize) -> u64 {
    (tap_count as u64) << 32 | u64::from(scan)
}

/// The scan and the number of planned taps of an [`end_mark`].
pub fn split_end_mark(mark: u64) -> (u32, usize) {
    ((mark & u64::from(u32::MAX)) as u32, (mark >> 32) as usize)
}

/// Most times that a tap may be taken again: a snapshot has room for no more.
pub const RETAKES_MAX: u16 = 63;

/// Bits of a tap's byte in a snapshot that hold its state; the others hold its attempt.
const STATE_BITS: u32 = 2;

/// Those bits.
const STATE_MASK: u8 = (1 << STATE_BITS) - 1;

/// The state of the archive at one moment.
///
/// It is complete, not a difference: a missed snapshot does no harm.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger {
    taps: Vec<TapState>,
    /// For each tap the attempt that settled it or, while it is missing, the one to be made next.
    attempts: Vec<u16>,
    scans: Vec<ScanState>,
    /// The last barrier that has passed through every stage.
    pub barrier: u8,
    /// Records lost in transit so far.
    pub lost_count: u64,
    /// Whether the archive cannot be written at the moment: nothing is settled until it can.
    pub is_stalled: bool,
}

impl Ledger {
    /// A ledger in which nothing has happened.
    pub fn empty(tap_count: usize, scan_count: usize) -> Self {
        Self {
            taps: vec![TapState::Missing; tap_count],
            attempts: vec![0; tap_count],
            scans: vec![ScanState::Open; scan_count],
            barrier: 0,
            lost_count: 0,
            is_stalled: false,
        }
    }

    /// States of the planned taps, by plan row.
    pub fn taps(&self) -> &[TapState] {
        &self.taps
    }

    /// States of the scans, by scan number.
    pub fn scans(&self) -> &[ScanState] {
        &self.scans
    }

    /// The attempt that settled the tap in plan row `row` or, while it is missing, the one to be made next.
    pub fn attempt(&self, row: usize) -> u16 {
        self.attempts[row]
    }

    /// Sets the state of the tap in plan row `row`, and the attempt as [`Ledger::attempt`] has it.
    pub fn set_tap(&mut self, row: usize, state: TapState, attempt: u16) {
        self.taps[row] = state;
        self.attempts[row] = attempt;
    }

    /// Sets the state of scan `number`.
    pub fn set_scan(&mut self, number: usize, state: ScanState) {
        self.scans[number] = state;
    }

    /// Makes room for a plan that has grown to `tap_count` taps and `scan_count` scans.
    pub fn grow(&mut self, tap_count: usize, scan_count: usize) {
        self.taps.resize(tap_count.max(self.taps.len()), TapState::Missing);
        self.attempts.resize(self.taps.len(), 0);
        self.scans.resize(scan_count.max(self.scans.len()), ScanState::Open);
    }

    /// How many taps are in `state`.
    pub fn count(&self, state: TapState) -> usize {
        self.taps.iter().filter(|&&s| s == state).count()
    }

    /// Whether every scan has its verdict.
    pub fn is_judged(&self) -> bool {
        self.scans.iter().all(|&s| s == ScanState::Judged)
    }

    /// Bytes of a snapshot: a byte for the state and attempt of every tap, where `has_taps`, and one for the state of every
    /// scan, where `has_scans`.
    pub fn encoded_bytes(&self, has_taps: bool, has_scans: bool) -> usize {
        let count = |is: bool, count: usize| if is { count } else { 0 };
        count(has_taps, self.taps.len()) + count(has_scans, self.scans.len())
    }

    /// Writes the snapshot into `bytes`, which must be [`Ledger::encoded_bytes`] long, and what it counts into `header`.
    ///
    /// # Panics
    /// If `bytes` has another length.
    pub fn encode(&self, header: &mut CasingHeader, has_taps: bool, has_scans: bool, bytes: &mut [u8]) {
        assert_eq!(bytes.len(), self.encoded_bytes(has_taps, has_scans), "length of a ledger snapshot");
        let (taps, scans) = bytes.split_at_mut(if has_taps { self.taps.len() } else { 0 });
        for (byte, (state, &attempt)) in taps.iter_mut().zip(self.taps.iter().zip(&self.attempts)) {
            *byte = state.code() | u8::try_from(attempt.min(RETAKES_MAX) << STATE_BITS).unwrap_or(u8::MAX);
        }
        for (byte, state) in scans.iter_mut().zip(&self.scans) {
            *byte = state.code();
        }
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        header.tap_count = count(self.taps.len());
        (header.tap_bytes, header.scan_bytes) = (count(taps.len()), count(scans.len()));
        header.barrier = self.barrier.into();
        header.archived_count = count(self.count(TapState::Archived));
        header.refused_count = count(self.count(TapState::Refused));
        (header.is_stalled, header.lost_count) = (self.is_stalled.into(), self.lost_count);
    }

    /// The ledger that `header` and `bytes` carry, `None` when they do not fit each other.
    pub fn decode(header: &CasingHeader, bytes: &[u8]) -> Option<Self> {
        let (taps, scans) = bytes.split_at_checked(header.tap_bytes as usize)?;
        Some(Self {
            taps: taps.iter().map(|&b| TapState::from_code(b & STATE_MASK)).collect::<Option<_>>()?,
            attempts: taps.iter().map(|&b| u16::from(b >> STATE_BITS)).collect(),
            scans: (scans.len() == header.scan_bytes as usize)
                .then(|| scans.iter().map(|&b| ScanState::from_code(b)).collect::<Option<_>>())??,
            barrier: u8::try_from(header.barrier).ok()?,
            lost_count: header.lost_count,
            is_stalled: header.is_stalled != 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ledgers() -> impl Strategy<Value = Ledger> {
        let states = (
            proptest::collection::vec((0..3_u8, 0..=RETAKES_MAX), 0..50),
            proptest::collection::vec(0..3_u8, 0..6),
            any::<u8>(),
            any::<u64>(),
            any::<bool>(),
        );
        states.prop_map(|(taps, scans, barrier, lost_count, is_stalled)| {
            let mut ledger = Ledger::empty(taps.len(), scans.len());
            for (row, (code, attempt)) in taps.into_iter().enumerate() {
                ledger.set_tap(row, TapState::from_code(code).unwrap(), attempt);
            }
            for (number, code) in scans.into_iter().enumerate() {
                ledger.set_scan(number, ScanState::from_code(code).unwrap());
            }
            (ledger.barrier, ledger.lost_count, ledger.is_stalled) = (barrier, lost_count, is_stalled);
            ledger
        })
    }

    fn encoded(ledger: &Ledger, has_taps: bool, has_scans: bool) -> (CasingHeader, Vec<u8>) {
        let mut bytes = vec![0; ledger.encoded_bytes(has_taps, has_scans)];
        let mut header = CasingHeader::default();
        ledger.encode(&mut header, has_taps, has_scans, &mut bytes);
        (header, bytes)
    }

    proptest! {
        #[test]
        fn a_snapshot_is_the_ledger(ledger in ledgers()) {
            let (header, bytes) = encoded(&ledger, true, true);
            prop_assert_eq!(header.archived_count as usize, ledger.count(TapState::Archived));
            prop_assert_eq!(Ledger::decode(&header, &bytes), Some(ledger.clone()));
            // Whoever needs no taps gets only the scans, and the number of taps.
            let (header, bytes) = encoded(&ledger, false, true);
            prop_assert_eq!(header.tap_count as usize, ledger.taps().len());
            prop_assert_eq!(Ledger::decode(&header, &bytes).map(|l| l.scans().to_vec()), Some(ledger.scans().to_vec()));
        }

        #[test]
        fn bytes_that_are_no_snapshot_are_refused(ledger in ledgers(), extra in 1..4_usize) {
            let (header, mut bytes) = encoded(&ledger, true, true);
            let long = [&bytes[..], &vec![0; extra]].concat();
            prop_assert_eq!(Ledger::decode(&header, &long), None);
            if let Some(state) = bytes.first_mut().filter(|_| !ledger.taps().is_empty()) {
                *state = 3;
                prop_assert_eq!(Ledger::decode(&header, &bytes), None);
            }
        }
    }
}
