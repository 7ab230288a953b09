//! The current state of each station, for displays: no verdict if there is any doubt about it.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::shown::status::StationStatus;
use crate::shown::verdict::CasingVerdict;

/// A line that has sent no status for so long hangs: it sends one every second.
const SILENT_AFTER: Duration = Duration::from_secs(5);

/// How long a verdict stays current if no other casing comes.
const STANDS_FOR: Duration = Duration::from_secs(600);

/// The current state of a station.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum StationState {
    /// The line starts, ends, hangs or is held, or the station's rig or device is away: which casing is there is not known.
    NoSignal,
    /// No casing, and no current verdict.
    Ready,
    /// A casing is tapped or judged.
    Busy,
    /// The last casing is judged, and no other has come.
    Judged(Arc<CasingVerdict>),
}

impl StationState {
    /// Its name on every wire.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::NoSignal => "no_signal",
            Self::Ready => "ready",
            Self::Busy => "busy",
            Self::Judged(_) => "judged",
        }
    }
}

#[derive(Debug, Default)]
struct Station {
    is_busy: bool,
    /// Whether something keeps it from seeing which casing is there.
    has_fault: bool,
    verdict: Option<(Instant, Arc<CasingVerdict>)>,
    judged_count: u64,
}

#[derive(Debug, Default)]
struct State {
    /// When the line last sent its status; `None` before the first.
    at: Option<Instant>,
    is_ended: bool,
    /// Whether something keeps it from taking in casings.
    is_held: bool,
    /// How often it has sent its status.
    beats: u64,
    stations: BTreeMap<u16, Station>,
    latest: Option<Arc<CasingVerdict>>,
}

/// The current state of each station.
#[derive(Debug)]
pub(crate) struct Now {
    state: Mutex<State>,
}

impl Now {
    pub(crate) fn new(stations: &[u16]) -> Self {
        let stations = stations.iter().map(|&number| (number, Station::default())).collect();
        Self { state: Mutex::new(State { stations, ..State::default() }) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A casing has come to `station`: the last verdict is no longer current.
    pub(crate) fn opened(&self, station: u16) {
        if let Some(station) = self.state().stations.get_mut(&station) {
            (station.is_busy, station.verdict) = (true, None);
        }
    }

    /// A casing at `station` is refused, or the last one was taken off: the last verdict is no longer current.
    pub(crate) fn refused(&self, station: u16) {
        if let Some(station) = self.state().stations.get_mut(&station) {
            station.verdict = None;
        }
    }

    /// The casing at a station is judged; `is_busy` says whether another one is under way there, `is_removed` whether it was taken off
    /// before.
    pub(crate) fn judged(&self, verdict: &CasingVerdict, is_busy: bool, is_removed: bool) {
        let verdict = Arc::new(verdict.clone());
        let mut state = self.state();
        state.latest = Some(Arc::clone(&verdict));
        if let Some(station) = state.stations.get_mut(&verdict.station) {
            station.judged_count += 1;
            station.is_busy = is_busy;
            station.verdict = (!is_busy && !is_removed).then(|| (Instant::now(), verdict));
        }
    }

    /// The line sends its status, with its stations; `is_held` says whether something keeps it from taking in casings.
    pub(crate) fn show(&self, shown: &[StationStatus], is_held: bool) {
        let mut state = self.state();
        state.is_held = is_held;
        state.at = Some(Instant::now());
        state.beats += 1;
        for shown in shown {
            if let Some(station) = state.stations.get_mut(&shown.number) {
                station.is_busy = shown.casing.is_some();
                station.has_fault = shown.fault.is_some();
                station.verdict.take_if(|(at, _)| shown.casing.is_some() || at.elapsed() > STANDS_FOR);
            }
        }
    }

    /// The line ends: it sends no more statuses.
    pub(crate) fn end(&self) {
        self.state().is_ended = true;
    }

    /// Whether the line works, and knows which casings are at its stations.
    pub(crate) fn is_alive(&self) -> bool {
        let state = self.state();
        !state.is_ended && !state.is_held && state.at.is_some_and(|at| at.elapsed() < SILENT_AFTER)
    }

    /// How often the line has sent its status: at least once a second while it works.
    pub(crate) fn beats(&self) -> u64 {
        self.state().beats
    }

    /// The state of `station`, and how many of its casings were judged since the line was started.
    pub(crate) fn at(&self, station: u16) -> (StationState, u64) {
        let is_alive = self.is_alive();
        let state = self.state();
        let Some(station) = state.stations.get(&station).filter(|_| is_alive) else {
            return (StationState::NoSignal, 0);
        };
        let station_state = match &station.verdict {
            _ if station.is_busy => StationState::Busy,
            _ if station.has_fault => StationState::NoSignal,
            Some((at, verdict)) if at.elapsed() < STANDS_FOR => StationState::Judged(Arc::clone(verdict)),
            _ => StationState::Ready,
        };
        (station_state, station.judged_count)
    }

    /// The last verdict of any station, while the line works.
    pub(crate) fn latest(&self) -> Option<Arc<CasingVerdict>> {
        let is_alive = self.is_alive();
        self.state().latest.clone().filter(|_| is_alive)
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use tapline_wire::Verdict;

    use super::*;

    /// Catches a verdict that stands, and a station that counts as ready, while the line hangs, while a full disk keeps it from taking in
    /// the next casing, or after it has ended.
    #[test]
    fn a_line_that_hangs_says_nothing() {
        let now = Now::new(&[1]);
        assert_eq!(now.at(1), (StationState::NoSignal, 0));
        let shown = [StationStatus { number: 1, ..StationStatus::default() }];
        let verdict = CasingVerdict {
            kind: "verdict".to_owned(),
            id: String::new(),
            at_ns: 0,
            casing: "A".to_owned(),
            station: 1,
            verdict: Verdict::Pass,
            shoulders: Vec::new(),
            archived: 0,
            refused: 0,
            missing: 0,
            file: PathBuf::new(),
        };
        now.show(&shown, false);
        now.judged(&verdict, false, true);
        assert_eq!(now.at(1), (StationState::Ready, 1), "it was taken off before its verdict");
        now.judged(&verdict, false, false);
        assert_eq!(now.at(1), (StationState::Judged(Arc::new(verdict)), 2));
        now.state().at = Instant::now().checked_sub(SILENT_AFTER);
        assert_eq!((now.at(1), now.latest()), ((StationState::NoSignal, 0), None));
        now.show(&shown, false);
        assert!(matches!(now.at(1), (StationState::Judged(_), 2)));
        now.show(&shown, true);
        assert_eq!((now.at(1), now.latest()), ((StationState::NoSignal, 0), None));
        let away = [StationStatus { fault: Some("the rig is away".to_owned()), ..shown[0].clone() }];
        now.show(&away, false);
        assert_eq!(now.at(1), (StationState::NoSignal, 2), "its rig is away");
        now.show(&shown, false);
        assert!(matches!(now.at(1), (StationState::Judged(_), 2)));
        now.end();
        assert_eq!((now.at(1), now.latest()), ((StationState::NoSignal, 0), None));
    }
}
