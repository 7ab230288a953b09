//! The state of each planned tap in a writer, which decides the outcome of every record.

use tapline_wire::TapState;

use crate::format::layout::LedgerRow;
use crate::format::lost::Lost;

/// The outcome of putting a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PutOutcome {
    /// It is accepted.
    Stored,
    /// The same record was put before; nothing is changed.
    AlreadyThere,
    /// The tap or scan is settled with another record; nothing is changed.
    Conflict,
}

/// Counts of the records put, by outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PutCounts {
    /// Accepted.
    pub stored: u64,
    /// Ignored, because they were put before.
    pub already_there: u64,
    /// Ignored, because their tap or scan is settled with another record.
    pub conflicts: u64,
}

/// One version of a record of a tap: its attempt, and a fingerprint of its contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Version {
    pub attempt: u16,
    pub fingerprint: u64,
}

/// The two halves of a tap, which arrive separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Half {
    Samples,
    Discriminators,
}

/// The state of one planned tap.
///
/// Until both halves of one attempt are there, a later version replaces an earlier one: a half whose other half was lost must
/// give way to the next attempt, regardless of its number. Then the tap is settled and nothing changes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Track {
    /// What is there, by [`Half`].
    halves: [Option<Version>; 2],
    state: TapState,
    attempt: u16,
    retaken_count: u32,
    /// Flags of the last unusable attempt.
    retaken_quality: u32,
}

impl Track {
    /// A missing tap whose next attempt is `attempt`.
    pub(crate) fn missing(attempt: u16) -> Self {
        Self { halves: [None; 2], state: TapState::Missing, attempt, retaken_count: 0, retaken_quality: 0 }
    }

    /// A tap whose samples are archived, and whose discriminators are to come.
    pub(crate) fn recorded(samples: Version) -> Self {
        Self { halves: [Some(samples), None], ..Self::missing(samples.attempt) }
    }

    /// A tap that an earlier writer archived.
    pub(crate) fn archived(samples: Version, discriminators: Version) -> Self {
        let (state, missing) = (TapState::Archived, Self::missing(samples.attempt));
        Self { halves: [Some(samples), Some(discriminators)], state, ..missing }
    }

    /// A tap that an earlier writer refused.
    pub(crate) fn refused(attempt: u16) -> Self {
        Self { state: TapState::Refused, ..Self::missing(attempt) }
    }

    /// The same tap after `count` unusable attempts, the last because of the flags `quality`.
    pub(crate) fn retaken_before(self, count: u32, quality: u32) -> Self {
        Self { retaken_count: count, retaken_quality: quality, ..self }
    }

    /// The row of the ledger; if `is_over`, with where a missing tap was lost.
    pub(crate) fn to_row(self, is_over: bool) -> LedgerRow {
        let lost_at = match self.halves {
            _ if !is_over || self.state.is_settled() => Lost::Unknown,
            [Some(_), _] => Lost::Process,
            [None, Some(_)] => Lost::Store,
            [None, None] => Lost::Acquire,
        };
        LedgerRow {
            retaken_count: self.retaken_count,
            retaken_quality: self.retaken_quality,
            lost_at: lost_at.code(),
            ..LedgerRow::new(self.state, self.attempt)
        }
    }

    /// The tap's state, and the attempt that settled it or, of a missing tap, the next.
    pub(crate) fn state(&self) -> (TapState, u16) {
        (self.state, self.attempt)
    }

    /// Whether discriminators of any attempt are there.
    pub(crate) fn has_discriminators(&self) -> bool {
        self.halves[Half::Discriminators as usize].is_some()
    }

    /// The outcome of putting `version` of `half`.
    pub(crate) fn outcome(&self, half: Half, version: Version) -> PutOutcome {
        if self.halves[half as usize] == Some(version) {
            PutOutcome::AlreadyThere
        } else if self.state.is_settled() {
            PutOutcome::Conflict
        } else {
            PutOutcome::Stored
        }
    }

    /// Records `version` of `half`; the tap is archived once both halves are of one attempt.
    pub(crate) fn record(&mut self, half: Half, version: Version) {
        self.halves[half as usize] = Some(version);
        if let [Some(samples), Some(discriminators)] = self.halves
            && samples.attempt == discriminators.attempt
        {
            (self.state, self.attempt) = (TapState::Archived, samples.attempt);
        }
    }

    /// The outcome of putting a refusal at `attempt`.
    pub(crate) fn refusal_outcome(&self, attempt: u16) -> PutOutcome {
        match self.state {
            TapState::Missing => PutOutcome::Stored,
            TapState::Refused if self.attempt == attempt => PutOutcome::AlreadyThere,
            TapState::Refused | TapState::Archived => PutOutcome::Conflict,
        }
    }

    /// The outcome of noting that `attempt` was unusable.
    pub(crate) fn retake_outcome(&self, attempt: u16) -> PutOutcome {
        let is_news = self.state == TapState::Missing && attempt >= self.attempt;
        if is_news { PutOutcome::Stored } else { PutOutcome::AlreadyThere }
    }

    /// Notes that `attempt` was unusable because of the flags `quality`, and that the next is to be made.
    pub(crate) fn retake(&mut self, attempt: u16, quality: u32) {
        *self = Self::missing(attempt.saturating_add(1)).retaken_before(self.retaken_count.saturating_add(1), quality);
    }

    /// Settles the tap as refused at `attempt`.
    pub(crate) fn refuse(&mut self, attempt: u16) {
        *self = Self::refused(attempt).retaken_before(self.retaken_count, self.retaken_quality);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn halves() -> impl Strategy<Value = (Half, Version)> {
        let half = prop_oneof![Just(Half::Samples), Just(Half::Discriminators)];
        (half, 0..3u16, 0..2u64).prop_map(|(half, attempt, fingerprint)| (half, Version { attempt, fingerprint }))
    }

    proptest! {
        /// Catches a settled tap that changes, halves of two attempts that are joined, and a tap that can no longer settle:
        /// after any history, one more version of both halves settles it.
        #[test]
        fn settles_once_and_for_all(history in prop::collection::vec(halves(), 0..12)) {
            let mut track = Track::missing(0);
            for (half, version) in history.into_iter().chain([
                (Half::Samples, Version { attempt: 7, fingerprint: 7 }),
                (Half::Discriminators, Version { attempt: 7, fingerprint: 8 }),
            ]) {
                let before = track;
                let outcome = track.outcome(half, version);
                if outcome == PutOutcome::Stored {
                    prop_assert_eq!(before.state, TapState::Missing);
                    track.record(half, version);
                }
                if track.state == TapState::Archived {
                    let [samples, discriminators] = track.halves.map(|half| half.unwrap().attempt);
                    prop_assert_eq!(samples, discriminators);
                }
                prop_assert!(outcome == PutOutcome::Conflict || track.outcome(half, version) == PutOutcome::AlreadyThere);
            }
            prop_assert_eq!(track.state, TapState::Archived);
        }
    }
}
