//! One station on a line: asks its source for what the ledger lacks, until nothing is lacking.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tapline_wire::{
    Ledger, LedgerTopic, Line, LineError, Loan, Plan, Publisher, REASON_BYTES_MAX, RecordKind, ScanState, Stamp,
    Subscriber, TapHeader, TapState, TapTopic, bytes_of_mut, lanes_for, monotonic_ns,
};

use crate::{AcquireConfig, Refusal, Source};

/// How long a barrier or an end may go unanswered before it is sent again: whoever had it may have died.
const MARK_AGAIN: Duration = Duration::from_secs(1);

/// How long a station that is asked to end waits for what it has sent to be archived.
const DRAIN: Duration = Duration::from_secs(10);

/// How far a wait for the bell may overshoot.
const COARSE: Duration = Duration::from_millis(12);

/// What one station did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The station.
    pub station: u16,
    /// Taps sent, those sent again among them.
    pub sent_count: u64,
    /// Taps refused.
    pub refused_count: u64,
    /// Taps sent again because they were lost after they had been sent.
    pub resent_count: u64,
    /// Taps struck again because their record was of no use.
    pub retake_count: u64,
    /// Bytes of samples sent.
    pub sample_bytes: u64,
    /// Time from the first tap to the last.
    pub elapsed_s: f64,
    /// Whether every planned tap is settled and every scan ended.
    pub is_complete: bool,
}

/// Takes the taps of `station` that the ledger lacks, sends them on `line`, and ends when every scan of it has ended.
///
/// The work is plan - ledger, asked for again until it is nothing: that one loop is the start, the resumption of an
/// interrupted run, and the healing after a stage has died.
///
/// # Errors
/// [`LineError`] when shared memory fails. Being asked to stop is no error: the outcome is then incomplete.
pub fn run(line: &Line, source: &mut dyn Source, config: &AcquireConfig, station: u16) -> Result<Outcome, LineError> {
    let plan = source.plan().clone();
    let mut rig = Station::open(line, &plan, config, station)?;
    let taken = rig.take_all(source);
    match taken {
        Ok(()) => rig.outcome.is_complete = true,
        Err(LineError::Stopped { .. }) => rig.drain()?,
        Err(error) => return Err(error),
    }
    rig.outcome.elapsed_s = rig.span.map_or(0.0, |(first, last)| (last - first).as_secs_f64());
    Ok(rig.outcome)
}

struct Station<'a> {
    line: &'a Line,
    plan: &'a Plan,
    taps: Publisher<'a, TapTopic>,
    snapshots: Subscriber<'a, LedgerTopic>,
    ledger: Option<Ledger>,
    /// Place of the station among all stations, ascending.
    number: usize,
    barrier: u8,
    /// For each planned tap the attempt that was sent last.
    sent: Vec<Option<u16>>,
    retakes: u16,
    period: Option<Duration>,
    next_due: Instant,
    span: Option<(Instant, Instant)>,
    outcome: Outcome,
}

impl<'a> Station<'a> {
    fn open(line: &'a Line, plan: &'a Plan, config: &AcquireConfig, station: u16) -> Result<Self, LineError> {
        let stations = plan.stations();
        let number = stations.iter().position(|&s| s == station).unwrap_or(0);
        let outcome = Outcome {
            station,
            sent_count: 0,
            refused_count: 0,
            resent_count: 0,
            retake_count: 0,
            sample_bytes: 0,
            elapsed_s: 0.0,
            is_complete: false,
        };
        Ok(Self {
            line,
            plan,
            snapshots: Subscriber::open(line, plan)?,
            taps: Publisher::open(line, plan)?,
            ledger: None,
            number,
            barrier: 0,
            sent: vec![None; plan.taps().len()],
            retakes: config.retakes,
            period: config.taps_per_s.and_then(|rate| Duration::try_from_secs_f64(1.0 / rate).ok()),
            next_due: Instant::now(),
            span: None,
            outcome,
        })
    }

    /// Scans of this station, by number.
    fn scans(&self) -> Vec<usize> {
        let station = self.outcome.station;
        let is_ours = |&number: &usize| self.plan.scans()[number].station == station;
        (0..self.plan.scans().len()).filter(is_ours).collect()
    }

    fn take_all(&mut self, source: &mut dyn Source) -> Result<(), LineError> {
        self.wait_for(Duration::MAX, |ledger| ledger.is_some())?;
        self.barrier = self.ledger().barrier(self.number);
        for scan in self.scans() {
            loop {
                let todo = self.missing(scan);
                if todo.is_empty() {
                    break;
                }
                for row in todo {
                    self.take(source, row)?;
                }
                self.pass_barrier()?;
            }
            self.end(scan)?;
        }
        self.end_all()
    }

    /// Plan - ledger, for one scan.
    fn missing(&self, scan: usize) -> Vec<u32> {
        let states = self.ledger().taps();
        let rows = self.plan.scans()[scan].taps.iter().copied();
        rows.filter(|&row| states[row as usize] == TapState::Missing).collect()
    }

    fn take(&mut self, source: &mut dyn Source, row: u32) -> Result<(), LineError> {
        self.keep_pace()?;
        let attempt = self.ledger().attempt(row as usize);
        let retakes_left = if source.can_retake() { self.retakes.saturating_sub(attempt) } else { 0 };
        let mut loan = self.taps.loan(lanes_for(self.plan.recording.payload_bytes_max()))?;
        let rendered = loan.fill(|header, lanes| {
            let rendered = source.render(row, attempt, header, lanes);
            header.retakes_left = retakes_left.into();
            header.sent_ns = monotonic_ns();
            (rendered, *header)
        });
        match rendered {
            (Ok(()), header) => {
                loan.send(RecordKind::Data)?;
                self.outcome.sent_count += 1;
                self.outcome.sample_bytes += header.payload_bytes() as u64;
            }
            (Err(refusal), header) => {
                drop(loan);
                self.refuse(&refusal, header)?;
            }
        }
        let last = self.sent[row as usize].replace(attempt);
        self.outcome.resent_count += u64::from(last == Some(attempt));
        self.outcome.retake_count += u64::from(attempt > 0 && last != Some(attempt));
        let now = Instant::now();
        self.span = Some((self.span.map_or(now, |(first, _)| first), now));
        Ok(())
    }

    fn refuse(&mut self, refusal: &Refusal, header: TapHeader) -> Result<(), LineError> {
        let text = cut(refusal.to_string(), REASON_BYTES_MAX);
        let mut loan: Loan<'_, '_, TapTopic> = self.taps.loan(lanes_for(text.len()))?;
        loan.fill(|to, lanes| {
            *to = header;
            to.text_bytes = u32::try_from(text.len()).unwrap_or(0);
            bytes_of_mut(lanes)[..text.len()].copy_from_slice(text.as_bytes());
        });
        loan.send(RecordKind::Refusal)?;
        self.outcome.refused_count += 1;
        Ok(())
    }

    /// Waits for the turn of the next tap, where a pace is set.
    fn keep_pace(&mut self) -> Result<(), LineError> {
        if self.line.is_stopped() {
            return Err(stopped());
        }
        let Some(period) = self.period else { return Ok(()) };
        while let Some(early) = self.next_due.checked_duration_since(Instant::now()).filter(|d| !d.is_zero()) {
            // The bell's clock is coarse: what is left at the end is slept.
            match early.checked_sub(COARSE) {
                Some(most) => self.pause(most)?,
                None => std::thread::sleep(early),
            }
        }
        // A rig that was held up takes its next tap a period from now, not a burst of those it missed.
        self.next_due = if self.next_due + period > Instant::now() { self.next_due } else { Instant::now() } + period;
        Ok(())
    }

    fn pause(&mut self, timeout: Duration) -> Result<(), LineError> {
        if self.line.is_stopped() {
            return Err(stopped());
        }
        self.line.wait(timeout)?;
        self.refresh()
    }

    fn mark(&self, kind: RecordKind, mark: u64) -> Result<(), LineError> {
        let header = TapHeader { stamp: Stamp { mark, ..Stamp::default() }, ..TapHeader::default() };
        self.taps.send(kind, header, &[])
    }

    /// Sends a barrier and waits until it has passed: everything sent before it is settled then, or lost.
    fn pass_barrier(&mut self) -> Result<(), LineError> {
        self.barrier = self.barrier.wrapping_add(1);
        let (barrier, number) = (self.barrier, self.number);
        let has_passed = move |ledger: Option<&Ledger>| ledger.is_some_and(|l| l.barrier(number) == barrier);
        loop {
            self.mark(RecordKind::Barrier, u64::from(barrier))?;
            if self.wait_for(MARK_AGAIN, has_passed)? {
                return Ok(());
            }
        }
    }

    fn end(&self, scan: usize) -> Result<(), LineError> {
        if self.ledger().scans()[scan] >= ScanState::Ended {
            return Ok(());
        }
        self.mark(RecordKind::End, scan as u64)
    }

    /// Waits until the archive knows that all scans of this station have ended.
    fn end_all(&mut self) -> Result<(), LineError> {
        let scans = self.scans();
        let are_ended = |ledger: Option<&Ledger>| {
            ledger.is_some_and(|l| scans.iter().all(|&scan| l.scans()[scan] >= ScanState::Ended))
        };
        while !self.wait_for(MARK_AGAIN, are_ended)? {
            for &scan in &scans {
                self.end(scan)?;
            }
        }
        Ok(())
    }

    /// Waits until `is_so` of the ledger, at most `timeout`; whether it came to be so.
    fn wait_for(&mut self, timeout: Duration, is_so: impl Fn(Option<&Ledger>) -> bool) -> Result<bool, LineError> {
        let since = Instant::now();
        self.refresh()?;
        while !is_so(self.ledger.as_ref()) {
            if since.elapsed() >= timeout {
                return Ok(false);
            }
            self.pause(Duration::from_millis(100))?;
        }
        Ok(true)
    }

    fn refresh(&mut self) -> Result<(), LineError> {
        if let Some(snapshot) = self.snapshots.receive_newest()? {
            self.ledger = Ledger::decode(snapshot.header(), &snapshot).or(self.ledger.take());
        }
        Ok(())
    }

    fn ledger(&self) -> &Ledger {
        self.ledger.as_ref().expect("nothing is taken before the first snapshot of the ledger")
    }

    /// After being asked to end: waits a while until what was sent is in the archive, if that can be written at all.
    fn drain(&mut self) -> Result<(), LineError> {
        let since = Instant::now();
        let is_settled = |station: &Self| {
            let Some(ledger) = station.ledger.as_ref().filter(|ledger| !ledger.is_held) else { return true };
            let is_done = |(row, sent): (usize, &Option<u16>)| {
                sent.is_none_or(|attempt| ledger.taps()[row].is_settled() || ledger.attempt(row) > attempt)
            };
            station.sent.iter().enumerate().all(is_done)
        };
        while !is_settled(self) && since.elapsed() < DRAIN {
            self.line.wait(Duration::from_millis(50))?;
            self.refresh()?;
        }
        Ok(())
    }
}

fn stopped() -> LineError {
    LineError::Stopped { topic: <TapTopic as tapline_wire::Topic>::NAME }
}

fn cut(mut text: String, bytes: usize) -> String {
    text.truncate(text.floor_char_boundary(bytes));
    text
}
