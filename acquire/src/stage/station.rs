//! One station: asks for its next casing, has it opened, takes the taps that its ledger lacks, ends its scans, goes on.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use tapline_wire::{CasingHeader, Ledger, LineError, RecordKind, ScanState, TapState};

use crate::stage::outlet::Outlet;
use crate::{Arrival, Arrivals, Casing, CasingEnd, Readiness, RunError, Source};

/// How long a proposal, a barrier or an end may go unanswered before it is sent again: whoever had it may have died.
const SEND_AGAIN: Duration = Duration::from_secs(1);

/// How soon the answer to a proposal is looked for unasked: `store` may have notified this process before it listened.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// How often it is said at most what a station waits for.
const SAY_EVERY: Duration = Duration::from_millis(500);

/// Most alarms that wait to be sent.
const ALARMS_MAX: usize = 16;

/// When a station is to be asked again, when nothing wakes the process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Next {
    /// At once: it got on.
    Now,
    /// After this time at most.
    Within(Duration),
}

/// One station.
#[derive(Debug)]
pub(crate) struct Station {
    arrivals: Box<dyn Arrivals>,
    work: Work,
    /// Casings whose scans have ended and whose files are not closed yet; one, but for a `store` that was restarted.
    closing: Vec<(u64, String)>,
    /// Casings of this station that are open in the archive, and that it does not have.
    left_over: Vec<(u64, String)>,
    /// Since when there are some, and no casing.
    left_over_since: Option<Instant>,
    period: Option<Duration>,
    next_due: Instant,
    /// What people should know and the supervisor has not been sent yet.
    alarms: VecDeque<String>,
    /// Whether the source has said that it is not ready.
    is_source_awaited: bool,
    /// What it was last said to wait for, and when.
    said: Option<(String, Instant)>,
}

/// What a station is at.
#[derive(Debug)]
enum Work {
    /// It has no casing.
    Idle,
    /// It has one whose file is not begun, or not known to be.
    Proposed { casing: Casing, sent_at: Option<Instant>, opened: Option<u64> },
    /// It taps one.
    Open(Box<Open>),
    /// It will have none any more.
    Ended,
}

/// A casing that is being tapped.
#[derive(Debug)]
struct Open {
    number: u64,
    casing: Casing,
    ledger: Ledger,
    phase: Phase,
    /// Scan that is tapped.
    scan: usize,
    barrier: u8,
    /// For each planned tap the attempt that was sent last.
    sent: Vec<Option<u16>>,
    /// Why no more taps will come.
    gone: Option<String>,
    /// Whether a barrier was sent behind the last tap, after the process was told to end.
    is_drained: Option<u8>,
}

#[derive(Debug)]
enum Phase {
    /// These rows of the plan are to be taken, the last first.
    Tapping(Vec<u32>),
    /// Everything that was sent is to be settled, or lost, when a barrier sent at this time has passed.
    Barrier(Instant),
    /// All scans are to be known to have ended; last asked for at this time.
    Ending(Instant),
}

impl Station {
    pub(crate) fn new(arrivals: Box<dyn Arrivals>, period: Option<Duration>) -> Self {
        let (closing, left_over) = (Vec::new(), Vec::new());
        let next_due = Instant::now();
        Self {
            arrivals,
            work: Work::Idle,
            closing,
            left_over,
            left_over_since: None,
            alarms: VecDeque::new(),
            period,
            next_due,
            is_source_awaited: false,
            said: None,
        }
    }

    pub(crate) fn number(&self) -> u16 {
        self.arrivals.station()
    }

    /// Takes in that a casing of this station is open in the archive.
    pub(crate) fn opened(&mut self, header: &CasingHeader, name: &str) {
        let number = header.stamp.casing;
        match &mut self.work {
            // One of the same name may be proposed while this is judged.
            _ if self.closing.iter().any(|&(closing, _)| closing == number) => {}
            Work::Proposed { casing, opened, .. } if is_of_plan(header, casing.taps.as_ref()) => *opened = Some(number),
            Work::Open(open) if open.number == number => {}
            _ if self.left_over.iter().any(|&(known, _)| known == number) => {}
            _ => self.left_over.push((number, name.to_owned())),
        }
    }

    /// Takes in the ledger of a casing.
    pub(crate) fn note_ledger(&mut self, number: u64, ledger: Ledger) {
        match std::mem::replace(&mut self.work, Work::Idle) {
            Work::Proposed { casing, opened: Some(opened), .. } if opened == number => {
                self.left_over.retain(|&(left_over, _)| left_over != number);
                self.work = Work::Open(Box::new(Open::new(number, casing, ledger)));
            }
            Work::Open(mut open) if open.number == number => {
                open.ledger = ledger;
                open.go_back();
                self.work = Work::Open(open);
            }
            work => self.work = work,
        }
    }

    /// Takes in that a casing's file is closed, now or before it was proposed.
    pub(crate) fn closed(&mut self, header: &CasingHeader, file: &str) {
        let number = header.stamp.casing;
        self.left_over.retain(|&(left_over, _)| left_over != number);
        let end = CasingEnd::Closed { file: file.into() };
        if let Some(place) = self.closing.iter().position(|&(closing, _)| closing == number) {
            let (_, name) = self.closing.remove(place);
            self.arrivals.ended(&name, &end);
            return;
        }
        let is_ours = match &self.work {
            Work::Proposed { casing, .. } => is_of_plan(header, casing.taps.as_ref()),
            Work::Open(open) => open.number == number,
            Work::Idle | Work::Ended => false,
        };
        if is_ours {
            self.end(&end);
        }
    }

    /// Takes in that a proposal is refused; or that a casing which is tapped is not open any more, as what a restarted `store`
    /// found of it was damaged: it is tapped anew.
    pub(crate) fn refused(&mut self, header: &CasingHeader, reason: &str) {
        self.work = match std::mem::replace(&mut self.work, Work::Idle) {
            Work::Open(open) if open.number == header.stamp.casing => {
                tracing::warn!(station = self.number(), casing = open.casing.name, "{reason}; it is tapped anew");
                Work::Proposed { casing: open.casing, sent_at: None, opened: None }
            }
            work => work,
        };
        if let Work::Proposed { casing, .. } = &self.work
            && is_of_plan(header, casing.taps.as_ref())
        {
            tracing::error!(station = self.number(), casing = casing.name, reason, "a casing is refused");
            self.end(&CasingEnd::Refused { reason: reason.to_owned() });
        }
    }

    /// Raises the alarms that its source has.
    fn raise_alarms(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        self.alarms.extend(self.arrivals.take_alarms());
        self.alarms.truncate(ALARMS_MAX);
        while let Some(text) = self.alarms.front() {
            if !outlet.alarm(self.number(), text)? {
                return Ok(());
            }
            self.alarms.pop_front();
        }
        Ok(())
    }

    /// Says what it waits for, for people, when that has changed and was not said just now.
    pub(crate) fn say_what_it_waits_for(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        self.raise_alarms(outlet)?;
        if self.said.as_ref().is_some_and(|(_, at)| at.elapsed() < SAY_EVERY) {
            return Ok(());
        }
        let what = match &self.work {
            _ if self.is_source_awaited => self.arrivals.waits_for(),
            Work::Idle => "the verdicts on the casings before".to_owned(),
            Work::Ended => "nothing: its list is done".to_owned(),
            Work::Proposed { .. } => "its file to be begun".to_owned(),
            Work::Open(open) => match open.phase {
                Phase::Tapping(_) => String::new(),
                Phase::Barrier(_) | Phase::Ending(_) => "what was tapped to be archived".to_owned(),
            },
        };
        let is_news = self.said.as_ref().is_none_or(|(said, _)| *said != what);
        if is_news && outlet.say_wait(self.number(), &what)? {
            self.said = Some((what, Instant::now()));
        }
        Ok(())
    }

    fn end(&mut self, end: &CasingEnd) {
        match std::mem::replace(&mut self.work, Work::Idle) {
            Work::Proposed { casing, .. } => self.arrivals.ended(&casing.name, end),
            Work::Open(open) => self.arrivals.ended(&open.casing.name, end),
            Work::Idle | Work::Ended => {}
        }
    }

    /// Does what can be done now: a tap at most.
    pub(crate) fn step(&mut self, outlet: &mut Outlet<'_>) -> Result<Next, RunError> {
        self.is_source_awaited = false;
        if let Work::Idle = self.work {
            // One casing may be tapped while one is closed.
            if self.closing.len() > 1 {
                return Ok(Next::Within(SEND_AGAIN));
            }
            match self.arrivals.next()? {
                Arrival::Casing(casing) => self.arrived(casing, outlet),
                Arrival::NotYet => {
                    self.give_up_what_stays_away(outlet)?;
                    self.is_source_awaited = true;
                    return Ok(Next::Within(self.arrivals.look_every()));
                }
                Arrival::Ended => self.work = Work::Ended,
            }
            return Ok(Next::Now);
        }
        // What was opened under another name while a casing is proposed was left by an earlier life of the line.
        match &self.work {
            Work::Ended => self.give_up_left_over(outlet, None)?,
            Work::Proposed { casing, .. } if self.arrivals.patience().is_some() => {
                let name = casing.name.clone();
                self.give_up_left_over(outlet, Some(&name))?;
            }
            _ => {}
        }
        let look_every = self.arrivals.look_every();
        let next = match &mut self.work {
            Work::Idle | Work::Ended => Next::Within(SEND_AGAIN),
            // The one before it of the same name must be closed first, to be told from it.
            Work::Proposed { casing, .. } if self.closing.iter().any(|(_, closing)| *closing == casing.name) => {
                Next::Within(SEND_AGAIN)
            }
            Work::Proposed { casing, sent_at, .. } => match sent_at.map(|at| at.elapsed()) {
                Some(waited) if waited < SEND_AGAIN => Next::Within(LOOK_AGAIN),
                _ => {
                    outlet.propose(self.arrivals.station(), &casing.name, casing.taps.as_ref())?;
                    *sent_at = Some(Instant::now());
                    Next::Within(LOOK_AGAIN)
                }
            },
            Work::Open(open) => {
                let mut pace = Pace { period: self.period, next_due: &mut self.next_due };
                open.step(outlet, &mut pace, look_every, &mut self.is_source_awaited)?
            }
        };
        if let Work::Open(open) = &mut self.work
            && open.is_ended()
        {
            outlet.outcome.casing_count += 1;
            let closing = (open.number, open.casing.name.clone());
            self.closing.push(closing);
            self.work = Work::Idle;
            return Ok(Next::Now);
        }
        Ok(next)
    }

    /// Has casings that will not come any more judged by what there is of them, when they have been away for too long.
    fn give_up_what_stays_away(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        if self.left_over.is_empty() {
            self.left_over_since = None;
            return Ok(());
        }
        let since = *self.left_over_since.get_or_insert_with(Instant::now);
        match self.arrivals.patience() {
            Some(patience) if since.elapsed() < patience => Ok(()),
            _ => self.give_up_left_over(outlet, None),
        }
    }

    /// Has casings that will not come any more judged by what there is of them, all but the one that is called `but`.
    fn give_up_left_over(&mut self, outlet: &Outlet<'_>, but: Option<&str>) -> Result<(), LineError> {
        let is_gone = |(_, name): &mut (u64, String)| Some(name.as_str()) != but;
        for (number, name) in self.left_over.extract_if(.., is_gone) {
            tracing::warn!(casing = name, "was left half tapped; it is judged by the taps that came");
            outlet.give_up(number, "the casing was taken away before its scan was complete")?;
        }
        Ok(())
    }

    fn arrived(&mut self, casing: Casing, outlet: &Outlet<'_>) {
        match outlet.exceeded_by(casing.taps.as_ref()) {
            Some(reason) => {
                tracing::error!(station = self.number(), casing = casing.name, reason, "a casing is refused");
                self.alarms.push_back(format!("casing {} is refused: {reason}", casing.name));
                self.arrivals.ended(&casing.name, &CasingEnd::Refused { reason });
            }
            None => self.work = Work::Proposed { casing, sent_at: None, opened: None },
        }
    }

    /// After being asked to end: whether nothing that was sent waits to be settled.
    pub(crate) fn drain(&mut self, outlet: &Outlet<'_>) -> Result<bool, LineError> {
        let Work::Open(open) = &mut self.work else { return Ok(true) };
        if open.ledger.is_held || open.sent.iter().all(Option::is_none) {
            return Ok(true);
        }
        let barrier = match open.is_drained {
            Some(barrier) => barrier,
            None => {
                let barrier = open.barrier.wrapping_add(1);
                if !outlet.try_mark(open.number, RecordKind::Barrier, barrier.into())? {
                    return Ok(false);
                }
                *open.is_drained.insert(barrier)
            }
        };
        Ok(open.ledger.barrier == barrier)
    }
}

/// When the next tap of a station is due.
struct Pace<'a> {
    period: Option<Duration>,
    next_due: &'a mut Instant,
}

impl Pace<'_> {
    /// How long it is until the next tap is due; `None` where it is.
    fn early(&self) -> Option<Duration> {
        self.period?;
        self.next_due.checked_duration_since(Instant::now()).filter(|early| !early.is_zero())
    }

    /// Notes that a tap was taken. A rig that was held up takes its next tap a period from now, not a burst of those it missed.
    fn taken(&mut self) {
        let Some(period) = self.period else { return };
        let now = Instant::now();
        *self.next_due = if *self.next_due + period > now { *self.next_due } else { now } + period;
    }
}

impl Open {
    fn new(number: u64, casing: Casing, ledger: Ledger) -> Self {
        let sent = vec![None; casing.taps.plan().taps().len()];
        let barrier = ledger.barrier;
        let mut open = Self {
            number,
            casing,
            ledger,
            phase: Phase::Tapping(Vec::new()),
            scan: 0,
            barrier,
            sent,
            gone: None,
            is_drained: None,
        };
        open.phase = Phase::Tapping(open.missing());
        open
    }

    /// Plan - ledger, for the scan that is tapped; the last first.
    fn missing(&self) -> Vec<u32> {
        let states = self.ledger.taps();
        let Some(scan) = self.casing.taps.plan().scans().get(self.scan) else { return Vec::new() };
        let is_missing = |&row: &u32| states.get(row as usize) == Some(&TapState::Missing);
        scan.taps.iter().rev().copied().filter(is_missing).collect()
    }

    /// Goes back to the first scan that lacks a tap which was archived before: a disk that failed has lost it.
    fn go_back(&mut self) {
        let states = self.ledger.taps();
        let is_missing = |&row: &u32| states.get(row as usize) == Some(&TapState::Missing);
        let before = &self.casing.taps.plan().scans()[..self.scan];
        if self.gone.is_none()
            && let Some(scan) = before.iter().position(|scan| scan.taps.iter().any(is_missing))
        {
            tracing::warn!(casing = self.casing.name, "taps that were archived are lost; they are taken again");
            self.scan = scan;
            self.phase = Phase::Tapping(self.missing());
        }
    }

    fn is_ended(&self) -> bool {
        let scans = self.ledger.scans();
        !scans.is_empty() && scans.iter().all(|&state| state >= ScanState::Ended)
    }

    fn step(
        &mut self,
        outlet: &mut Outlet<'_>,
        pace: &mut Pace<'_>,
        look_every: Duration,
        is_source_awaited: &mut bool,
    ) -> Result<Next, LineError> {
        match &mut self.phase {
            Phase::Tapping(rows) => {
                let Some(&row) = rows.last() else { return self.send_barrier(outlet) };
                if let Some(early) = pace.early() {
                    return Ok(Next::Within(early));
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
                    Readiness::Ready => outlet.take(self.number, source, row, attempt)?,
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
            Phase::Barrier(_) if self.ledger.barrier == self.barrier => self.passed(outlet),
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

    /// Sends a barrier behind what was sent: when it has passed, all that is settled, or lost.
    fn send_barrier(&mut self, outlet: &Outlet<'_>) -> Result<Next, LineError> {
        self.barrier = self.barrier.wrapping_add(1);
        outlet.mark(self.number, RecordKind::Barrier, self.barrier.into())?;
        self.phase = Phase::Barrier(Instant::now());
        Ok(Next::Within(SEND_AGAIN))
    }

    /// All that was sent is settled, or lost.
    fn passed(&mut self, outlet: &Outlet<'_>) -> Result<Next, LineError> {
        if let Some(reason) = &self.gone {
            outlet.give_up(self.number, reason)?;
            self.phase = Phase::Ending(Instant::now());
            return Ok(Next::Within(SEND_AGAIN));
        }
        let missing = self.missing();
        if !missing.is_empty() {
            self.phase = Phase::Tapping(missing);
            return Ok(Next::Now);
        }
        if self.ledger.scans().get(self.scan).is_some_and(|&state| state < ScanState::Ended) {
            outlet.mark(self.number, RecordKind::End, self.scan as u64)?;
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

    /// Sends again that the scans have ended, those of which the archive does not know it.
    fn send_ends(&mut self, outlet: &Outlet<'_>) -> Result<Next, LineError> {
        if let Some(reason) = &self.gone {
            outlet.give_up(self.number, reason)?;
        } else {
            let open = (0..).zip(self.ledger.scans()).filter(|&(_, &state)| state < ScanState::Ended);
            open.map(|(scan, _)| scan).try_for_each(|scan| outlet.mark(self.number, RecordKind::End, scan))?;
        }
        self.phase = Phase::Ending(Instant::now());
        Ok(Next::Within(SEND_AGAIN))
    }
}

/// Whether what `header` tells of has the plan of `source`.
fn is_of_plan(header: &CasingHeader, source: &dyn Source) -> bool {
    header.plan_digest == source.plan().digest()
}
