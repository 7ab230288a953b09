//! `acquire` on a line: several stations, each of which takes the taps of one casing after another.

pub(crate) mod outcome;
mod outlet;
mod pace;
mod station;
mod tapping;
mod unusable;

use std::time::{Duration, Instant};

use tapline_wire::{
    CasingTopic, Ledger, Line, LineError, Received, RecordKind, Subscriber, TapTopic, Topic as _, decode_opened,
};

use crate::stage::outcome::{Outcome, RunError};
use crate::stage::outlet::Outlet;
use crate::stage::pace::Next;
use crate::stage::station::Station;
use crate::{AcquireConfig, Arrivals};

/// How long a process that is asked to end waits until what it has sent is archived.
const DRAIN: Duration = Duration::from_secs(10);

/// Takes the casings of `stations` as they arrive and sends the taps that their ledgers lack, until asked to stop.
///
/// The work to do is plan - ledger, repeated until it is empty. This one loop starts a casing, resumes an interrupted one, and
/// recovers after a stage has died.
///
/// # Errors
/// [`RunError`] if shared memory or a source fails. Being asked to stop is not an error.
pub fn run(line: &Line, stations: Vec<Box<dyn Arrivals>>, config: &AcquireConfig) -> Result<Outcome, RunError> {
    let mut outcome = Outcome { stations: stations.iter().map(|s| s.station()).collect(), ..Outcome::default() };
    let mut outlet = Outlet::open(line, config.retakes, &mut outcome)?;
    let casings = Subscriber::<CasingTopic>::open(line)?;
    let period = config.taps_per_s.and_then(|rate| Duration::try_from_secs_f64(1.0 / rate).ok());
    let mut stations: Vec<Station> = stations.into_iter().map(|arrivals| Station::new(arrivals, period)).collect();
    match serve(line, &mut outlet, &casings, &mut stations) {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => drain(&outlet, &casings, &mut stations)?,
        Err(error) => return Err(error),
    }
    Ok(outcome)
}

fn serve(
    line: &Line,
    outlet: &mut Outlet<'_>,
    casings: &Subscriber<'_, CasingTopic>,
    stations: &mut [Station],
) -> Result<(), RunError> {
    while !line.is_stopped() {
        receive(casings, stations)?;
        let mut earliest = Duration::MAX;
        for station in stations.iter_mut() {
            match station.step(outlet)? {
                Next::Now => earliest = Duration::ZERO,
                Next::Within(wait) => earliest = earliest.min(wait),
            }
            station.report_wait(outlet)?;
        }
        if !earliest.is_zero() {
            line.wait(earliest)?;
        }
    }
    Ok(())
}

/// Passes each station what `store` sends about its casings.
fn receive(casings: &Subscriber<'_, CasingTopic>, stations: &mut [Station]) -> Result<(), RunError> {
    while let Some(record) = casings.receive()? {
        let header = record.header();
        if record.kind() == Some(RecordKind::Refusal) && header.station == 0 {
            // `store` does not know which station the casing belonged to.
            stations.iter_mut().for_each(|station| station.refused(header, &text_of(&record)));
            continue;
        }
        let station = stations.iter_mut().find(|s| u32::from(s.number()) == header.station);
        let Some(station) = station else { continue };
        match record.kind() {
            Some(RecordKind::Plan) => match decode_opened(&record) {
                Ok((name, added)) => station.opened(record.header(), &name, &added),
                Err(error) => tracing::error!(%error, "a record of store about a casing is unreadable"),
            },
            Some(RecordKind::Ledger) => {
                if let Some(ledger) = Ledger::decode(record.header(), &record) {
                    station.note_ledger(record.header().stamp.casing, ledger);
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

/// After a request to end: waits for a while until all that was sent is in the archive, unless the archive is stalled.
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
    tracing::warn!("ends with taps under way that are not archived; they are taken again when the line continues");
    Ok(())
}

const _: () = assert!(TapTopic::BUFFER > TapTopic::WAKE_EVERY as usize, "store would sleep while its buffer is full");
