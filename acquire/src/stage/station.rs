//! One station: gets its next casing, proposes it to `store`, has it tapped, and takes the next while it is closed.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use tapline_wire::{CasingHeader, Ledger, LineError, PlannedTap, RecordKind, now_ns};

use crate::stage::outlet::Outlet;
use crate::stage::pace::{Next, Pace, SEND_AGAIN};
use crate::stage::tapping::{Tapping, grow};
use crate::stage::unusable::Unusable;
use crate::{Arrival, Arrivals, Casing, CasingEnd, RunError, Source};

/// How soon to check for the answer to a proposal without being notified.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// Shortest time between two reports of what a station waits for.
const REPORT_EVERY: Duration = Duration::from_millis(500);

/// Most alarms that wait to be sent.
const ALARMS_MAX: usize = 16;

/// One station.
#[derive(Debug)]
pub(crate) struct Station {
    arrivals: Box<dyn Arrivals>,
    work: Work,
    /// Casings whose scans have ended and whose files are not closed yet: two at most.
    closing: Vec<(u64, String)>,
    /// Casings of this station that are open in the archive and that its source has not brought back, by number and name.
    left_over: Vec<(u64, String)>,
    /// Since when there are some while the source has no casing.
    left_over_since: Option<Instant>,
    pace: Pace,
    /// Alarms not yet sent to the supervisor.
    alarms: VecDeque<(RecordKind, String)>,
    /// Its taps that must be taken again.
    unusable: Unusable,
    /// Whether the source is not ready.
    is_source_awaited: bool,
    /// What it waits for as last reported, and when.
    reported: Option<(String, Instant)>,
    /// The fault of its source, and why its rig is stopped, as last reported, empty for none; `None` before the first report.
    reported_fault: Option<String>,
    reported_stop: Option<String>,
}

/// The state of a station.
#[derive(Debug)]
enum Work {
    /// It has no casing.
    Idle,
    /// It has one, which is proposed to `store`; `opened` is its number once `store` has opened it, and when its last tap was made.
    Proposed { casing: Casing, sent_at: Option<Instant>, opened: Option<(u64, i64)> },
    /// It taps one, which is open.
    Tapping(Box<Tapping>),
    /// No casing will come any more.
    Ended,
}

impl Station {
    pub(crate) fn new(arrivals: Box<dyn Arrivals>, period: Option<Duration>) -> Self {
        Self {
            arrivals,
            work: Work::Idle,
            closing: Vec::new(),
            left_over: Vec::new(),
            left_over_since: None,
            alarms: VecDeque::new(),
            unusable: Unusable::default(),
            pace: Pace { period, next_due: Instant::now() },
            is_source_awaited: false,
            reported: None,
            reported_fault: None,
            reported_stop: None,
        }
    }

    pub(crate) fn number(&self) -> u16 {
        self.arrivals.station()
    }

    /// Notes that a casing of this station is open in the archive, and that taps were `added` to its plan.
    pub(crate) fn opened(&mut self, header: &CasingHeader, name: &str, added: &[PlannedTap]) {
        let number = header.stamp.casing;
        match &mut self.work {
            // A casing of the same name may be proposed while this one is judged.
            _ if self.closing.iter().any(|&(closing, _)| closing == number) => {}
            Work::Proposed { casing, opened, .. } if is_of_plan(header, casing.taps.as_ref()) => {
                *opened = Some((number, header.tapped_ns));
                grow(casing, added);
            }
            Work::Tapping(tapping) if tapping.number == number => tapping.grow(added),
            _ if self.left_over.iter().any(|&(known, _)| known == number) => {}
            _ => self.left_over.push((number, name.to_owned())),
        }
    }

    /// Notes the ledger of a casing.
    pub(crate) fn note_ledger(&mut self, number: u64, ledger: Ledger) {
        match std::mem::replace(&mut self.work, Work::Idle) {
            Work::Proposed { casing, opened: Some((opened, tapped_ns)), .. } if opened == number => {
                self.left_over.retain(|&(left_over, _)| left_over != number);
                let mut tapping = Tapping::new(number, casing, ledger);
                if let Some(why) = self.interruption(&tapping, tapped_ns) {
                    let text = format!("casing {}: {why}; it is judged on the taps that came", tapping.casing.name);
                    tracing::warn!("{text}");
                    self.alarms.push_back((RecordKind::Alarm, text));
                    tapping.give_up(why);
                }
                self.work = Work::Tapping(Box::new(tapping));
            }
            Work::Tapping(mut tapping) if tapping.number == number => {
                tapping.set_ledger(ledger);
                while let Some(answer) = tapping.next_answer() {
                    if let Some(alarm) = self.unusable.note(answer) {
                        tracing::warn!(station = self.number(), casing = tapping.casing.name, "{alarm}");
                        self.alarms.push_back((RecordKind::Alarm, alarm));
                    }
                }
                self.work = Work::Tapping(tapping);
            }
            work => self.work = work,
        }
    }

    /// Why a casing that was half tapped, for the last time at `tapped_ns`, is not continued: nobody saw whether it was lifted and put
    /// back turned, which would hide a crack.
    fn interruption(&self, tapping: &Tapping, tapped_ns: i64) -> Option<String> {
        let patience = self.arrivals.patience().filter(|_| tapping.has_taps())?;
        // A clock that was set back says nothing.
        let away = u64::try_from(now_ns().saturating_sub(tapped_ns)).ok().map(Duration::from_nanos);
        let how_long = match away {
            Some(away) if away <= patience => return None,
            Some(away) => format!("for {} s", away.as_secs()),
            None => "for an unknown time".to_owned(),
        };
        Some(format!("its scan was interrupted {how_long}: it may have been turned meanwhile"))
    }

    /// Notes that a casing's file is closed, now or before it was proposed.
    pub(crate) fn closed(&mut self, header: &CasingHeader, file: &str) {
        let number = header.stamp.casing;
        self.left_over.retain(|&(left_over, _)| left_over != number);
        // A casing that is only proposed, and was never open, was finished before.
        let was_there = matches!(self.work, Work::Proposed { opened: None, .. });
        let end = |was_there| CasingEnd::Closed { file: file.into(), was_there };
        if let Some(place) = self.closing.iter().position(|&(closing, _)| closing == number) {
            let (_, name) = self.closing.remove(place);
            self.arrivals.ended(&name, &end(false));
            return;
        }
        let is_ours = match &self.work {
            Work::Proposed { casing, .. } => is_of_plan(header, casing.taps.as_ref()),
            Work::Tapping(tapping) => tapping.number == number,
            Work::Idle | Work::Ended => false,
        };
        if is_ours {
            self.end(&end(was_there));
        }
    }

    /// Notes that a proposal is refused; or that a casing being tapped is no longer open, because a restarted
    /// `store` has found its file damaged: then it is tapped again.
    pub(crate) fn refused(&mut self, header: &CasingHeader, reason: &str) {
        self.work = match std::mem::replace(&mut self.work, Work::Idle) {
            Work::Tapping(tapping) if tapping.number == header.stamp.casing => {
                tracing::warn!(station = self.number(), casing = tapping.casing.name, "{reason}; it is tapped again");
                Work::Proposed { casing: tapping.casing, sent_at: None, opened: None }
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

    /// Sends the alarms of its source, as far as possible without blocking.
    fn send_alarms(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        self.alarms.extend(self.arrivals.take_messages());
        self.alarms.truncate(ALARMS_MAX);
        while let Some((kind, text)) = self.alarms.front() {
            if !outlet.report(self.number(), *kind, text)? {
                return Ok(());
            }
            self.alarms.pop_front();
        }
        Ok(())
    }

    /// Reports what it waits for, for people, if that has changed and the last report is not too recent; and the fault of its source.
    pub(crate) fn report_wait(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        self.send_alarms(outlet)?;
        let number = self.number();
        for (kind, now, reported) in [
            (RecordKind::Fault, self.arrivals.fault(), &mut self.reported_fault),
            (RecordKind::Stopped, self.arrivals.stopped(), &mut self.reported_stop),
        ] {
            let now = now.unwrap_or_default();
            if reported.as_ref() != Some(&now) && outlet.report(number, kind, &now)? {
                *reported = Some(now);
            }
        }
        if self.reported.as_ref().is_some_and(|(_, at)| at.elapsed() < REPORT_EVERY) {
            return Ok(());
        }
        let what = match &self.work {
            _ if self.is_source_awaited => self.arrivals.waits_for(),
            Work::Idle => "the verdicts on earlier casings".to_owned(),
            Work::Ended => "nothing: its list is done".to_owned(),
            Work::Proposed { .. } => "its file to be started".to_owned(),
            Work::Tapping(tapping) if tapping.is_taking() => String::new(),
            Work::Tapping(tapping) if tapping.is_awaiting_verdict() => "the verdict".to_owned(),
            Work::Tapping(_) => "its taps to be archived".to_owned(),
        };
        let is_news = self.reported.as_ref().is_none_or(|(reported, _)| *reported != what);
        if is_news && outlet.report(self.number(), RecordKind::Data, &what)? {
            self.reported = Some((what, Instant::now()));
        }
        Ok(())
    }

    fn end(&mut self, end: &CasingEnd) {
        match std::mem::replace(&mut self.work, Work::Idle) {
            Work::Proposed { casing, .. } => self.arrivals.ended(&casing.name, end),
            Work::Tapping(tapping) => self.arrivals.ended(&tapping.casing.name, end),
            Work::Idle | Work::Ended => {}
        }
    }

    /// Does what can be done now: one tap at most.
    pub(crate) fn step(&mut self, outlet: &mut Outlet<'_>) -> Result<Next, RunError> {
        self.is_source_awaited = false;
        if let Work::Idle = self.work {
            // One casing may be tapped while another is closed.
            if self.closing.len() > 1 {
                return Ok(Next::Within(SEND_AGAIN));
            }
            match self.arrivals.next()? {
                Arrival::Casing(casing) => self.arrived(casing, outlet),
                Arrival::NotYet => {
                    self.give_up_overdue(outlet)?;
                    self.is_source_awaited = true;
                    return Ok(Next::Within(self.arrivals.look_every()));
                }
                Arrival::Ended => self.work = Work::Ended,
            }
            return Ok(Next::Now);
        }
        // A casing that is open under another name than the proposed one was left by an earlier run of the line.
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
            // A casing of the same name must be closed first, so that the two are not confused.
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
            Work::Tapping(tapping) => tapping.step(outlet, &mut self.pace, look_every, &mut self.is_source_awaited)?,
        };
        if let Work::Tapping(tapping) = &self.work
            && tapping.is_ended()
        {
            let closing = (tapping.number, tapping.casing.name.clone());
            self.closing.push(closing);
            self.work = Work::Idle;
            return Ok(Next::Now);
        }
        Ok(next)
    }

    /// Gives up the casings that have been away for too long.
    fn give_up_overdue(&mut self, outlet: &Outlet<'_>) -> Result<(), LineError> {
        if self.left_over.is_empty() || self.arrivals.is_blind() {
            self.left_over_since = None;
            return Ok(());
        }
        let since = *self.left_over_since.get_or_insert_with(Instant::now);
        match self.arrivals.patience() {
            Some(patience) if since.elapsed() < patience => Ok(()),
            _ => self.give_up_left_over(outlet, None),
        }
    }

    /// Gives up the casings that will not come back, except the one called `but`: they are judged by the taps they have.
    fn give_up_left_over(&mut self, outlet: &Outlet<'_>, but: Option<&str>) -> Result<(), LineError> {
        let is_gone = |(_, name): &mut (u64, String)| Some(name.as_str()) != but;
        for (number, name) in self.left_over.extract_if(.., is_gone) {
            let text =
                format!("casing {name} was half tapped when the line stopped; it is judged on the taps that came");
            tracing::warn!("{text}");
            self.alarms.push_back((RecordKind::Alarm, text));
            outlet.give_up(
                number,
                "the line was stopped before the scan was complete, and the casing did not come back",
            )?;
        }
        Ok(())
    }

    fn arrived(&mut self, casing: Casing, outlet: &Outlet<'_>) {
        match outlet.exceeded_by(casing.taps.as_ref()) {
            Some(reason) => {
                tracing::error!(station = self.number(), casing = casing.name, reason, "a casing is refused");
                self.alarms.push_back((RecordKind::Refusal, format!("casing {} is refused: {reason}", casing.name)));
                self.arrivals.ended(&casing.name, &CasingEnd::Refused { reason });
            }
            None => self.work = Work::Proposed { casing, sent_at: None, opened: None },
        }
    }

    /// After being asked to end: whether everything that was sent is settled.
    pub(crate) fn drain(&mut self, outlet: &Outlet<'_>) -> Result<bool, LineError> {
        match &mut self.work {
            Work::Tapping(tapping) => tapping.drain(outlet),
            _ => Ok(true),
        }
    }
}

/// Whether the casing of `header` has the plan of `source`.
fn is_of_plan(header: &CasingHeader, source: &dyn Source) -> bool {
    header.plan_digest == source.plan().begun_digest()
}
