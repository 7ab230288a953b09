//! A casing being tapped: which taps are due, what was sent, and whether its scans have ended.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use tapline_wire::{Ledger, LineError, PlannedTap, RecordKind, ScanState, TapState, end_mark};

use crate::stage::outlet::Outlet;
use crate::stage::pace::{Next, Pace, SEND_AGAIN};
use crate::stage::unusable::Answer;
use crate::{Casing, Readiness};

/// How often the archive is asked during a scan what it made of the taps: at the end of a scan of minutes, people would hear too late
/// that none can be used.
const ASK_EVERY: Duration = Duration::from_secs(1);

/// When it is asked again, although it has not answered: an answer may be lost.
const ASK_AGAIN: Duration = Duration::from_secs(10);

/// A casing that is being tapped.
#[derive(Debug)]
pub(crate) struct Tapping {
    pub(crate) number: u64,
    pub(crate) casing: Casing,
    ledger: Ledger,
    phase: Phase,
    /// Scan that is tapped.
    scan: usize,
    barrier: u8,
    /// For each planned tap the attempt that was sent last.
    sent: Vec<Option<u16>>,
    /// Rows and attempts that were sent, may be taken again, and are not answered yet, in their order.
    unanswered: VecDeque<(u32, u16)>,
    /// When the archive was last asked about them.
    asked_at: Instant,
    /// Why no more taps will come, and whether the archive knows.
    gone: Option<String>,
    is_given_up: bool,
    /// The barrier sent after the last tap, once the process was asked to end.
    drain_barrier: Option<u8>,
}

#[derive(Debug)]
enum Phase {
    /// These rows of the plan are to be taken, the last one first.
    Tapping(Vec<u32>),
    /// A barrier was sent at this time; when it has passed, everything before it is settled or lost.
    Barrier(Instant),
    /// The ends of the scans were sent at this time; the archive is to confirm them.
    Ending(Instant),
}

impl Tapping {
    pub(crate) fn new(number: u64, casing: Casing, ledger: Ledger) -> Self {
        let sent = vec![None; casing.taps.plan().taps().len()];
        let barrier = ledger.barrier;
        let mut tapping = Self {
            number,
            casing,
            ledger,
            phase: Phase::Tapping(Vec::new()),
            scan: 0,
            barrier,
            sent,
            unanswered: VecDeque::new(),
            asked_at: Instant::now(),
            gone: None,
            is_given_up: false,
            drain_barrier: None,
        };
        tapping.phase = Phase::Tapping(tapping.missing());
        tapping
    }

    /// Whether a tap of it is settled.
    pub(crate) fn has_taps(&self) -> bool {
        self.ledger.taps().iter().any(|state| state.is_settled())
    }

    /// Takes no more taps, because of `why`.
    pub(crate) fn give_up(&mut self, why: String) {
        self.gone = Some(why);
        self.phase = Phase::Tapping(Vec::new());
    }

    /// Plan - ledger of the current scan, the last row first.
    fn missing(&self) -> Vec<u32> {
        let states = self.ledger.taps();
        let Some(scan) = self.casing.taps.plan().scans().get(self.scan) else { return Vec::new() };
        let is_missing = |&row: &u32| states.get(row as usize) == Some(&TapState::Missing);
        scan.taps.iter().rev().copied().filter(is_missing).collect()
    }

    /// Whether nothing is left to do for the casing: the archive has confirmed the ends of all scans and, if more taps may be
    /// requested, their verdicts.
    pub(crate) fn is_ended(&self) -> bool {
        let last =
            if self.casing.taps.about().room > 0 && self.gone.is_none() { ScanState::Judged } else { ScanState::Ended };
        // An archive that does not know that it is gone would wait for more of its taps.
        self.has_reached(last) && self.gone.is_some() == self.is_given_up
    }

    /// Whether all is tapped, but more taps may be requested until the verdict.
    pub(crate) fn is_awaiting_verdict(&self) -> bool {
        self.has_reached(ScanState::Ended)
    }

    fn has_reached(&self, last: ScanState) -> bool {
        let scans = self.ledger.scans();
        !scans.is_empty() && scans.iter().all(|&state| state >= last)
    }

    /// Notes that taps were added to the plan; the ledger that follows has room for them.
    pub(crate) fn grow(&mut self, added: &[PlannedTap]) {
        grow(&mut self.casing, added);
        self.sent.resize(self.casing.taps.plan().taps().len(), None);
    }

    /// Whether taps are being taken, not just awaited in the archive.
    pub(crate) fn is_taking(&self) -> bool {
        matches!(self.phase, Phase::Tapping(_))
    }

    /// Takes in a new ledger. If a scan that was done lacks taps in it, because some were added or a disk has failed, goes back
    /// to the first such scan.
    pub(crate) fn set_ledger(&mut self, ledger: Ledger) {
        let planned_before = self.ledger.taps().len();
        self.ledger = ledger;
        let states = self.ledger.taps();
        let is_missing = |&row: &u32| states.get(row as usize) == Some(&TapState::Missing);
        let before = &self.casing.taps.plan().scans()[..self.scan];
        if self.gone.is_none()
            && let Some(scan) = before.iter().position(|scan| scan.taps.iter().any(is_missing))
        {
            if self.ledger.taps().len() == planned_before {
                tracing::warn!(casing = self.casing.name, "taps that were archived are lost; they are taken again");
            }
            self.scan = scan;
            self.phase = Phase::Tapping(self.missing());
        }
    }

    /// What the archive made of the next tap, as its ledger has it.
    pub(crate) fn next_answer(&mut self) -> Option<Answer> {
        while let Some(&(row, attempt)) = self.unanswered.front() {
            let answer = match self.ledger.taps().get(row as usize)? {
                TapState::Archived => Some(Answer::Kept),
                TapState::Refused => None,
                TapState::Missing if self.ledger.attempt(row as usize) <= attempt => return None,
                TapState::Missing if attempt == 0 => Some(Answer::FirstAgain),
                TapState::Missing => Some(Answer::StillAgain),
            };
            self.unanswered.pop_front();
            if answer.is_some() {
                return answer;
            }
        }
        None
    }

    /// Asks for the ledger in the middle of a scan, if answers are due: by a barrier, for which nothing waits.
    fn ask(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        let barrier = self.barrier.wrapping_add(1);
        if self.must_ask() && outlet.try_mark(self.number, RecordKind::Barrier, barrier.into())? {
            (self.barrier, self.asked_at) = (barrier, Instant::now());
        }
        Ok(())
    }

    fn must_ask(&self) -> bool {
        let is_answered = self.ledger.barrier == self.barrier;
        let pause = if is_answered { ASK_EVERY } else { ASK_AGAIN };
        self.is_taking() && !self.unanswered.is_empty() && self.asked_at.elapsed() >= pause
    }

    /// Does what can be done now: one tap at most. Sets `is_source_awaited` if the source is not ready.
    pub(crate) fn step(
        &mut self,
        outlet: &mut Outlet<'_>,
        pace: &mut Pace,
        look_every: Duration,
        is_source_awaited: &mut bool,
    ) -> Result<Next, LineError> {
        self.ask(outlet)?;
        match &mut self.phase {
            Phase::Tapping(rows) => {
                let Some(&row) = rows.last() else { return self.send_barrier(outlet) };
                if let Some(left) = pace.time_left() {
                    return Ok(Next::Within(left));
                }
                let attempt = self.ledger.attempt(row as usize);
                let source = self.casing.taps.as_mut();
                match source.poll(row, attempt) {
                    Readiness::NotYet => {
                        *is_source_awaited = true;
                        return Ok(Next::Within(look_every));
                    }
                    Readiness::Gone(reason) => {
                        tracing::warn!(casing = self.casing.name, reason, "no more taps of a casing will come");
                        self.gone = Some(reason);
                        rows.clear();
                        return Ok(Next::Now);
                    }
                    Readiness::Ready => {
                        outlet.take(self.number, source, row, attempt)?;
                        // A last attempt is kept whatever its record is: it says nothing.
                        if outlet.retakes_left(source, attempt) > 0 {
                            self.unanswered.push_back((row, attempt));
                        }
                    }
                    Readiness::Refused(refusal) => {
                        outlet.refuse_row(self.number, source, row, attempt, &refusal)?;
                    }
                }
                rows.pop();
                pace.taken();
                let last = self.sent[row as usize].replace(attempt);
                outlet.outcome.resent_count += u64::from(last == Some(attempt));
                outlet.outcome.retake_count += u64::from(attempt > 0 && last != Some(attempt));
                Ok(Next::Now)
            }
            Phase::Barrier(_) if self.ledger.barrier == self.barrier => self.barrier_passed(outlet),
            Phase::Barrier(sent_at) => match SEND_AGAIN.checked_sub(sent_at.elapsed()) {
                Some(left) => Ok(Next::Within(left)),
                None => self.send_barrier(outlet),
            },
            Phase::Ending(sent_at) => match SEND_AGAIN.checked_sub(sent_at.elapsed()) {
                Some(left) => Ok(Next::Within(left)),
                None => self.send_ends(outlet),
            },
        }
    }

    /// Sends a barrier after the taps: once it has passed, they are settled or lost.
    fn send_barrier(&mut self, outlet: &Outlet<'_>) -> Result<Next, LineError> {
        self.barrier = self.barrier.wrapping_add(1);
        outlet.mark(self.number, RecordKind::Barrier, self.barrier.into())?;
        self.phase = Phase::Barrier(Instant::now());
        Ok(Next::Within(SEND_AGAIN))
    }

    /// Continues after the barrier: missing taps again, the end of the scan, or the next scan.
    fn barrier_passed(&mut self, outlet: &Outlet<'_>) -> Result<Next, LineError> {
        // What has no answer yet was lost on its way, and is sent again.
        self.unanswered.clear();
        if let Some(reason) = &self.gone {
            outlet.give_up(self.number, reason)?;
            self.is_given_up = true;
            self.phase = Phase::Ending(Instant::now());
            return Ok(Next::Within(SEND_AGAIN));
        }
        let missing = self.missing();
        if !missing.is_empty() {
            self.phase = Phase::Tapping(missing);
            return Ok(Next::Now);
        }
        if self.ledger.scans().get(self.scan).is_some_and(|&state| state < ScanState::Ended) {
            self.end(outlet, self.scan as u32)?;
        }
        self.scan += 1;
        if self.scan >= self.casing.taps.plan().scans().len() {
            self.phase = Phase::Ending(Instant::now());
            return Ok(Next::Within(SEND_AGAIN));
        }
        let missing = self.missing();
        self.phase = Phase::Tapping(missing);
        Ok(Next::Now)
    }

    /// Sends the end of scan number `scan` for the plan as grown so far.
    fn end(&self, outlet: &Outlet<'_>, scan: u32) -> Result<(), LineError> {
        let tap_count = self.casing.taps.plan().taps().len();
        outlet.mark(self.number, RecordKind::End, end_mark(scan, tap_count))
    }

    /// Sends the ends of the scans again that the archive has not confirmed.
    fn send_ends(&mut self, outlet: &Outlet<'_>) -> Result<Next, LineError> {
        if let Some(reason) = &self.gone {
            outlet.give_up(self.number, reason)?;
        } else {
            let open = (0..).zip(self.ledger.scans()).filter(|&(_, &state)| state < ScanState::Ended);
            let open: Vec<u32> = open.map(|(scan, _)| scan).collect();
            open.iter().try_for_each(|&scan| self.end(outlet, scan))?;
            if open.is_empty() {
                // A `store` that has lost the file answers that it does not know the casing.
                outlet.mark(self.number, RecordKind::Barrier, self.barrier.into())?;
            }
        }
        self.phase = Phase::Ending(Instant::now());
        Ok(Next::Within(SEND_AGAIN))
    }

    /// After being asked to end: whether everything that was sent is settled, or cannot be for now.
    pub(crate) fn drain(&mut self, outlet: &Outlet<'_>) -> Result<bool, LineError> {
        if self.ledger.is_stalled || self.sent.iter().all(Option::is_none) {
            return Ok(true);
        }
        let barrier = match self.drain_barrier {
            Some(barrier) => barrier,
            None => {
                let barrier = self.barrier.wrapping_add(1);
                if !outlet.try_mark(self.number, RecordKind::Barrier, barrier.into())? {
                    return Ok(false);
                }
                *self.drain_barrier.insert(barrier)
            }
        };
        Ok(self.ledger.barrier == barrier)
    }
}

/// Adds the taps `added` to the plan of the source of `casing`.
pub(crate) fn grow(casing: &mut Casing, added: &[PlannedTap]) {
    if casing.taps.plan().added() == added {
        return;
    }
    match casing.taps.plan().begun().grown(added) {
        Ok(plan) => casing.taps.grow(plan),
        Err(error) => tracing::error!(casing = casing.name, %error, "additional taps could not be planned"),
    }
}

#[cfg(test)]
mod tests {
    use tapline_model::SimulationConfig;

    use super::*;
    use crate::{ScanConfig, SimulatedLine, Source as _};

    /// Catches an answer that is taken from a tap still on its way, that is counted twice or in another order than that of the taps, and
    /// a refused tap that counts as one with an unusable record.
    #[test]
    fn each_tap_is_answered_once_and_in_its_order() {
        let taps = SimulatedLine::new(&ScanConfig::default(), &SimulationConfig::default()).unwrap();
        let mut ledger = Ledger::empty(taps.plan().taps().len(), taps.plan().scans().len());
        let mut tapping = Tapping::new(7, Casing { name: "A".to_owned(), taps: Box::new(taps) }, ledger.clone());
        tapping.unanswered.extend([(0, 0), (1, 0), (2, 0), (3, 0)]);
        let answers = |tapping: &mut Tapping, ledger: &Ledger| -> Vec<Answer> {
            tapping.set_ledger(ledger.clone());
            std::iter::from_fn(|| tapping.next_answer()).collect()
        };
        assert_eq!(answers(&mut tapping, &ledger), []);
        ledger.set_tap(0, TapState::Missing, 1);
        ledger.set_tap(1, TapState::Refused, 0);
        ledger.set_tap(3, TapState::Archived, 0);
        assert_eq!(answers(&mut tapping, &ledger), [Answer::FirstAgain]);
        assert_eq!(answers(&mut tapping, &ledger), [], "the third is on its way");
        ledger.set_tap(2, TapState::Missing, 1);
        assert_eq!(answers(&mut tapping, &ledger), [Answer::FirstAgain, Answer::Kept]);
        tapping.unanswered.push_back((0, 1));
        assert_eq!(answers(&mut tapping, &ledger), []);
        ledger.set_tap(0, TapState::Missing, 2);
        assert_eq!(answers(&mut tapping, &ledger), [Answer::StillAgain]);
    }

    /// Catches a question at every step, one where nothing is unanswered, and one whose answer was lost and that is never asked again.
    #[test]
    fn the_archive_is_asked_now_and_then() {
        let taps = SimulatedLine::new(&ScanConfig::default(), &SimulationConfig::default()).unwrap();
        let ledger = Ledger::empty(taps.plan().taps().len(), taps.plan().scans().len());
        let mut tapping = Tapping::new(7, Casing { name: "A".to_owned(), taps: Box::new(taps) }, ledger);
        let must_ask_after = |tapping: &mut Tapping, pause: Duration| {
            tapping.asked_at = Instant::now().checked_sub(pause).unwrap();
            tapping.must_ask()
        };
        assert!(!must_ask_after(&mut tapping, ASK_AGAIN), "nothing was sent");
        tapping.unanswered.push_back((0, 0));
        assert!(!must_ask_after(&mut tapping, Duration::ZERO));
        assert!(must_ask_after(&mut tapping, ASK_EVERY));
        tapping.barrier = tapping.barrier.wrapping_add(1);
        assert!(!must_ask_after(&mut tapping, ASK_EVERY), "the answer is on its way");
        assert!(must_ask_after(&mut tapping, ASK_AGAIN));
    }
}
