//! `acquire` on a line: several stations, each of which takes the taps of one casing after the other.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tapline_wire::{
    CasingHeader, CasingTopic, Ledger, Line, LineError, Loan, ProposalTopic, Publisher, REASON_BYTES_MAX, Received,
    RecordKind, Stamp, Subscriber, TapHeader, TapTopic, Topic as _, bytes_of_mut, encode_proposal, lanes_for,
    monotonic_ns,
};

use crate::station::{Next, Station};
use crate::{AcquireConfig, Arrivals, Error, Refusal, Source};

/// How long a process that is asked to end waits for what it has sent to be archived.
const DRAIN: Duration = Duration::from_secs(10);

/// How far a wait for events may overshoot: shorter ones are slept.
const COARSE: Duration = Duration::from_millis(12);

/// Why `acquire` cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A source cannot be used.
    #[error(transparent)]
    Source(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
}

/// What one process did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Its stations.
    pub stations: Vec<u16>,
    /// Casings whose scans ended.
    pub casing_count: u64,
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
}

/// Takes the casings of `stations` as they arrive, and sends of each the taps that its ledger lacks, until told to stop.
///
/// The work is plan - ledger, asked for again until it is nothing: that one loop is the start of a casing, the resumption of
/// one that was interrupted, and the healing after a stage has died.
///
/// # Errors
/// [`RunError`] when shared memory fails or a source can give nothing any more. Being asked to stop is no error.
pub fn run(line: &Line, stations: Vec<Box<dyn Arrivals>>, config: &AcquireConfig) -> Result<Outcome, RunError> {
    let mut outcome = Outcome { stations: stations.iter().map(|s| s.station()).collect(), ..Outcome::default() };
    let mut outlet = Outlet {
        line,
        proposals: Publisher::open(line)?,
        taps: Publisher::open(line)?,
        retakes: config.retakes,
        outcome: &mut outcome,
    };
    let casings = Subscriber::<CasingTopic>::open(line)?;
    let period = config.taps_per_s.and_then(|rate| Duration::try_from_secs_f64(1.0 / rate).ok());
    let mut stations: Vec<Station> = stations.into_iter().map(|arrivals| Station::new(arrivals, period)).collect();
    match serve(&mut outlet, &casings, &mut stations) {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => drain(&outlet, &casings, &mut stations)?,
        Err(error) => return Err(error),
    }
    Ok(outcome)
}

fn serve(
    outlet: &mut Outlet<'_>,
    casings: &Subscriber<'_, CasingTopic>,
    stations: &mut [Station],
) -> Result<(), RunError> {
    while !outlet.line.is_stopped() {
        receive(casings, stations)?;
        let mut earliest = Duration::MAX;
        for station in stations.iter_mut() {
            match station.step(outlet)? {
                Next::Now => earliest = Duration::ZERO,
                Next::Within(wait) => earliest = earliest.min(wait),
            }
        }
        match earliest {
            Duration::ZERO => {}
            short if short < COARSE => std::thread::sleep(short),
            long => outlet.line.wait(long)?,
        }
    }
    Ok(())
}

/// Gives each station what `store` says of its casings.
fn receive(casings: &Subscriber<'_, CasingTopic>, stations: &mut [Station]) -> Result<(), RunError> {
    while let Some(record) = casings.receive()? {
        let station = stations.iter_mut().find(|s| u32::from(s.number()) == record.header().station);
        let Some(station) = station else { continue };
        match record.kind() {
            Some(RecordKind::Plan) => station.opened(record.header(), &text_of(&record)),
            Some(RecordKind::Ledger) => {
                if let Some(ledger) = Ledger::decode(record.header(), &record) {
                    station.told(record.header().stamp.casing, ledger);
                }
            }
            Some(RecordKind::Closed) => station.closed(record.header(), &text_of(&record)),
            Some(RecordKind::Refusal) => station.refused(record.header(), &text_of(&record)),
            _ => {}
        }
    }
    Ok(())
}

fn text_of(record: &Received<CasingTopic>) -> String {
    String::from_utf8_lossy(record).into_owned()
}

/// After being asked to end: waits a while until what was sent is in the archive, if that can be written at all.
fn drain(outlet: &Outlet<'_>, casings: &Subscriber<'_, CasingTopic>, stations: &mut [Station]) -> Result<(), RunError> {
    let since = Instant::now();
    while since.elapsed() < DRAIN {
        receive(casings, stations)?;
        let mut is_drained = true;
        for station in stations.iter_mut() {
            is_drained &= station.drain(outlet)?;
        }
        if is_drained {
            return Ok(());
        }
        outlet.line.wait(Duration::from_millis(20))?;
    }
    tracing::warn!("ends with taps under way that are not archived; they are taken again when the line goes on");
    Ok(())
}

/// The way out: what the stations of the process send.
pub(crate) struct Outlet<'a> {
    line: &'a Line,
    taps: Publisher<'a, TapTopic>,
    proposals: Publisher<'a, ProposalTopic>,
    retakes: u16,
    pub(crate) outcome: &'a mut Outcome,
}

impl Outlet<'_> {
    /// What of `source` this line has no room for.
    pub(crate) fn exceeded_by(&self, source: &dyn Source) -> Option<String> {
        self.line.limits().exceeded_by(source.plan())
    }

    /// Proposes the casing `name` at `station`.
    pub(crate) fn propose(&self, station: u16, name: &str, source: &dyn Source) -> Result<(), LineError> {
        let stamp = Stamp { mark: station.into(), ..Stamp::default() };
        self.proposals.send(RecordKind::Plan, stamp, &encode_proposal(name, source.plan()))
    }

    /// Gives up the casing numbered `casing`: what it lacks will not come.
    pub(crate) fn give_up(&self, casing: u64, reason: &str) -> Result<(), LineError> {
        let stamp = Stamp { casing, ..Stamp::default() };
        self.proposals.send(RecordKind::Refusal, stamp, cut(reason, REASON_BYTES_MAX).as_bytes())
    }

    /// Sends attempt `attempt` at the tap in plan row `row`, rendered by `source`.
    pub(crate) fn take(
        &mut self,
        casing: u64,
        source: &mut dyn Source,
        row: u32,
        attempt: u16,
    ) -> Result<(), LineError> {
        let retakes_left = if source.can_retake() { self.retakes.saturating_sub(attempt) } else { 0 };
        let mut loan = self.taps.loan(lanes_for(source.plan().recording.payload_bytes_max()))?;
        let rendered = loan.fill(|header, lanes| {
            let rendered = source.render(row, attempt, header, lanes);
            header.stamp.casing = casing;
            header.retakes_left = retakes_left.into();
            header.sent_ns = monotonic_ns();
            (rendered, *header)
        });
        match rendered {
            (Ok(()), header) => {
                loan.send(RecordKind::Data)?;
                self.outcome.sent_count += 1;
                self.outcome.sample_bytes += header.payload_bytes() as u64;
                Ok(())
            }
            (Err(refusal), header) => {
                drop(loan);
                self.refuse(&refusal, header)
            }
        }
    }

    /// Sends that the tap in plan row `row` will not come.
    pub(crate) fn refuse_row(
        &mut self,
        casing: u64,
        source: &dyn Source,
        row: u32,
        attempt: u16,
        refusal: &Refusal,
    ) -> Result<(), LineError> {
        let Some(planned) = source.plan().taps().get(row as usize) else { return Ok(()) };
        let mut header = TapHeader { id: planned.id, plan_index: row, ..TapHeader::default() };
        header.stamp.casing = casing;
        header.id.attempt = attempt;
        header.source = source.kind().code();
        self.refuse(refusal, header)
    }

    fn refuse(&mut self, refusal: &Refusal, header: TapHeader) -> Result<(), LineError> {
        let text = refusal.to_string();
        let text = cut(&text, REASON_BYTES_MAX);
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

    /// Sends a mark of the casing numbered `casing` behind its taps.
    pub(crate) fn mark(&self, casing: u64, kind: RecordKind, mark: u64) -> Result<(), LineError> {
        self.taps.send(kind, mark_header(casing, mark), &[])
    }

    /// As [`Outlet::mark`], without waiting; whether it was sent.
    pub(crate) fn try_mark(&self, casing: u64, kind: RecordKind, mark: u64) -> Result<bool, LineError> {
        self.taps.try_send(kind, mark_header(casing, mark), &[])
    }
}

fn mark_header(casing: u64, mark: u64) -> TapHeader {
    TapHeader { stamp: Stamp { casing, mark, ..Stamp::default() }, ..TapHeader::default() }
}

fn cut(text: &str, bytes: usize) -> &str {
    &text[..text.floor_char_boundary(bytes)]
}

/// Whether `header` is about the casing with this plan.
pub(crate) fn is_of_plan(header: &CasingHeader, source: &dyn Source) -> bool {
    header.plan_digest == source.plan().digest()
}

const _: () = assert!(TapTopic::BUFFER > TapTopic::WAKE_EVERY as usize, "store would sleep while its buffer is full");
