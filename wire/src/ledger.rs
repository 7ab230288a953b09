//! What has become of every planned tap: plan - ledger is the work left to do.

use iceoryx2::prelude::ZeroCopySend;

use crate::Stamp;

/// State of one planned tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TapState {
    /// Not there yet: work to do.
    Missing,
    /// Samples and discriminators are in the archive.
    Archived,
    /// Refused for a stated reason; it will not come.
    Refused,
}

impl TapState {
    const ALL: [Self; 3] = [Self::Missing, Self::Archived, Self::Refused];

    /// Number that stands for the state on the wire and in archives.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The state that `code` stands for.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.code() == code)
    }

    /// The state's name in tables.
    pub fn name(self) -> &'static str {
        ["missing", "archived", "refused"][self as usize]
    }

    /// Whether nothing is left to do for the tap.
    pub fn is_settled(self) -> bool {
        self != Self::Missing
    }
}

/// State of one scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ScanState {
    /// Taps are still to come.
    Open,
    /// Its end has come, in band.
    Ended,
    /// Its verdict is in the archive.
    Judged,
}

impl ScanState {
    const ALL: [Self; 3] = [Self::Open, Self::Ended, Self::Judged];

    /// Number that stands for the state on the wire and in archives.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The state that `code` stands for.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.code() == code)
    }
}

/// Most often that a tap may be taken again: what a snapshot has room for.
pub const RETAKES_MAX: u16 = 63;

/// Bits of a tap's byte in a snapshot that hold its state; the others hold its attempt.
const STATE_BITS: u32 = 2;

/// Those bits.
const STATE_MASK: u8 = (1 << STATE_BITS) - 1;

/// Header of a ledger snapshot; a byte each follows for the state and attempt of every tap, for the state of every scan,
/// and for the barrier that every station has passed.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("tapline.LedgerHeader.v2")]
pub struct LedgerHeader {
    /// Which snapshot this is.
    pub stamp: Stamp,
    /// Planned taps.
    pub tap_count: u32,
    /// Planned scans.
    pub scan_count: u32,
    /// Stations, each with the last barrier that passed.
    pub station_count: u32,
    /// Taps in the archive.
    pub archived_count: u32,
    /// Taps refused.
    pub refused_count: u32,
    /// 1 while the archive cannot be written, else 0.
    pub is_held: u32,
    /// Records lost in transit so far, as their sequence numbers tell.
    pub lost_count: u64,
}

/// A copy of the ledger as the archive had it at one moment.
///
/// It is whole, not a difference: a snapshot that is missed costs nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger {
    taps: Vec<TapState>,
    /// For each tap the attempt that settled it or, while it is missing, the one to be made next.
    attempts: Vec<u16>,
    scans: Vec<ScanState>,
    /// For each station, ascending: the last barrier that has passed through every stage.
    barriers: Vec<u8>,
    /// Records lost in transit so far.
    pub lost_count: u64,
    /// Whether the archive cannot be written at the moment: nothing will be settled before that is over.
    pub is_held: bool,
}

impl Ledger {
    /// A ledger in which nothing has happened.
    pub fn empty(tap_count: usize, scan_count: usize, station_count: usize) -> Self {
        Self {
            taps: vec![TapState::Missing; tap_count],
            attempts: vec![0; tap_count],
            scans: vec![ScanState::Open; scan_count],
            barriers: vec![0; station_count],
            lost_count: 0,
            is_held: false,
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

    /// The last barrier of the station with number `station` in ascending order that has passed.
    pub fn barrier(&self, station: usize) -> u8 {
        self.barriers[station]
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

    /// Records that `barrier` of `station` has passed.
    pub fn set_barrier(&mut self, station: usize, barrier: u8) {
        self.barriers[station] = barrier;
    }

    /// How many taps are in `state`.
    pub fn count(&self, state: TapState) -> usize {
        self.taps.iter().filter(|&&s| s == state).count()
    }

    /// Whether every scan has its verdict.
    pub fn is_judged(&self) -> bool {
        self.scans.iter().all(|&s| s == ScanState::Judged)
    }

    /// Bytes of a snapshot for so many taps, scans and stations.
    pub fn encoded_bytes(tap_count: usize, scan_count: usize, station_count: usize) -> usize {
        tap_count + scan_count + station_count
    }

    /// Writes the snapshot into `bytes`, which must be [`Ledger::encoded_bytes`] long, and returns its header.
    ///
    /// # Panics
    /// If `bytes` has another length.
    pub fn encode(&self, bytes: &mut [u8]) -> LedgerHeader {
        assert_eq!(
            bytes.len(),
            self.taps.len() + self.scans.len() + self.barriers.len(),
            "length of a ledger snapshot"
        );
        let (taps, rest) = bytes.split_at_mut(self.taps.len());
        let (scans, barriers) = rest.split_at_mut(self.scans.len());
        for (byte, (state, &attempt)) in taps.iter_mut().zip(self.taps.iter().zip(&self.attempts)) {
            let attempt = if attempt > RETAKES_MAX { RETAKES_MAX } else { attempt };
            *byte = state.code() | u8::try_from(attempt << STATE_BITS).unwrap_or(u8::MAX);
        }
        for (byte, state) in scans.iter_mut().zip(&self.scans) {
            *byte = state.code();
        }
        barriers.copy_from_slice(&self.barriers);
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        LedgerHeader {
            tap_count: count(self.taps.len()),
            scan_count: count(self.scans.len()),
            station_count: count(self.barriers.len()),
            archived_count: count(self.count(TapState::Archived)),
            refused_count: count(self.count(TapState::Refused)),
            lost_count: self.lost_count,
            is_held: self.is_held.into(),
            ..LedgerHeader::default()
        }
    }

    /// The ledger that `header` and `bytes` carry, `None` when they do not fit each other.
    pub fn decode(header: &LedgerHeader, bytes: &[u8]) -> Option<Self> {
        let (taps, rest) = bytes.split_at_checked(header.tap_count as usize)?;
        let (scans, barriers) = rest.split_at_checked(header.scan_count as usize)?;
        Some(Self {
            taps: taps.iter().map(|&b| TapState::from_code(b & STATE_MASK)).collect::<Option<_>>()?,
            attempts: taps.iter().map(|&b| u16::from(b >> STATE_BITS)).collect(),
            scans: scans.iter().map(|&b| ScanState::from_code(b)).collect::<Option<_>>()?,
            barriers: (barriers.len() == header.station_count as usize).then(|| barriers.to_vec())?,
            lost_count: header.lost_count,
            is_held: header.is_held != 0,
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
            proptest::collection::vec(any::<u8>(), 0..4),
            any::<u64>(),
            any::<bool>(),
        );
        states.prop_map(|(taps, scans, barriers, lost_count, is_held)| {
            let mut ledger = Ledger::empty(taps.len(), scans.len(), barriers.len());
            for (row, (code, attempt)) in taps.into_iter().enumerate() {
                ledger.set_tap(row, TapState::from_code(code).unwrap(), attempt);
            }
            for (number, code) in scans.into_iter().enumerate() {
                ledger.set_scan(number, ScanState::from_code(code).unwrap());
            }
            for (station, barrier) in barriers.into_iter().enumerate() {
                ledger.set_barrier(station, barrier);
            }
            (ledger.lost_count, ledger.is_held) = (lost_count, is_held);
            ledger
        })
    }

    proptest! {
        #[test]
        fn a_snapshot_is_the_ledger(ledger in ledgers()) {
            let mut bytes = vec![0; Ledger::encoded_bytes(ledger.taps.len(), ledger.scans.len(), ledger.barriers.len())];
            let header = ledger.encode(&mut bytes);
            prop_assert_eq!(header.archived_count as usize, ledger.count(TapState::Archived));
            prop_assert_eq!(Ledger::decode(&header, &bytes), Some(ledger));
        }

        #[test]
        fn bytes_that_are_no_snapshot_are_refused(ledger in ledgers(), extra in 1..4_usize) {
            let mut bytes = vec![0; Ledger::encoded_bytes(ledger.taps.len(), ledger.scans.len(), ledger.barriers.len())];
            let header = ledger.encode(&mut bytes);
            let long = [&bytes[..], &vec![0; extra]].concat();
            prop_assert_eq!(Ledger::decode(&header, &long), None);
            if let Some(state) = bytes.first_mut().filter(|_| !ledger.taps.is_empty()) {
                *state = 3;
                prop_assert_eq!(Ledger::decode(&header, &bytes), None);
            }
        }
    }
}
