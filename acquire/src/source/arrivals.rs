//! Where a station's casings come from, one at a time: a list, a watched folder, a rig.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tapline_wire::{CasingLimits, Plan, RecordKind};

use crate::{Error, Source};

/// Called from a source's own thread when something has changed (a rig has answered): wakes the polling loop.
pub type Wake = Arc<dyn Fn() + Send + Sync>;

/// A casing to be tapped.
#[derive(Debug)]
pub struct Casing {
    /// Its name, not escaped: the serial, or the name of the tap set's folder if the set is one piece with many lines.
    pub name: String,
    /// Its taps; their plan is that of this casing alone.
    pub taps: Box<dyn Source>,
}

/// What a station's next casing is.
#[derive(Debug)]
pub enum Arrival {
    /// A casing that has arrived.
    Casing(Casing),
    /// None now; one may come later.
    NotYet,
    /// No more casings will come.
    Ended,
}

/// How a casing ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CasingEnd {
    /// Its file is finished.
    Closed {
        /// The finished file.
        file: PathBuf,
        /// Whether the file was finished before the casing came: it was judged from the same recordings, and is not judged
        /// again.
        was_there: bool,
    },
    /// Nothing was made of it.
    Refused {
        /// Why.
        reason: String,
    },
}

/// Name, station and plan of a casing of a list.
pub type ListedCasing = (String, u16, Plan);

/// A finite list of casings.
pub trait CasingList: fmt::Debug {
    /// Every casing, in order; each plan is made when the iterator reaches it.
    fn listed(&self) -> Box<dyn Iterator<Item = Result<ListedCasing, Error>> + '_>;

    /// The stations that have casings, ascending.
    fn stations(&self) -> Vec<u16>;

    /// The casings of `station`, in order.
    fn arrivals(&self, station: u16) -> Box<dyn Arrivals>;

    /// Limits that are sufficient for every casing. Only one plan is in memory at a time.
    ///
    /// # Errors
    /// [`Error`] if a casing's plan cannot be made.
    fn limits(&self) -> Result<CasingLimits, Error>;
}

/// Where one station's casings come from.
pub trait Arrivals: Send + fmt::Debug {
    /// The station.
    fn station(&self) -> u16;

    /// The next casing, if there is one now. Never blocks for longer than reading a tap set takes.
    ///
    /// # Errors
    /// [`Error`] for what ends the line. A bad tap set in a watched folder, or a rig that is off, is no error: it is
    /// logged and skipped.
    fn next(&mut self) -> Result<Arrival, Error>;

    /// Takes note of how the casing `name` ended. Casings of one name are closed in the order in which they came; one that is refused is
    /// the last of them.
    fn ended(&mut self, name: &str, end: &CasingEnd) {
        let _nobody_asks = (name, end);
    }

    /// What is waited for while [`Arrivals::next`] says [`Arrival::NotYet`], for people: `the rig at 127.0.0.1:7001`.
    fn waits_for(&self) -> String {
        "nothing: its casings are there".to_owned()
    }

    /// What keeps it from seeing or tapping a casing that comes, for people; `None` while nothing does.
    fn fault(&self) -> Option<String> {
        None
    }

    /// Why its rig is stopped, as that says; `None` while it is not, and for other sources.
    fn stopped(&self) -> Option<String> {
        None
    }

    /// How long a half-tapped casing may be away: on a rig it may come back, and is gone for good when
    /// another follows it. From a list or a folder each comes until it is done, and a missing one is gone: `None`.
    fn patience(&self) -> Option<Duration> {
        None
    }

    /// Whether something keeps it from seeing which casings are there: then none is known to be gone.
    fn is_blind(&self) -> bool {
        false
    }

    /// Messages for people that have not been reported yet: that a casing or a set was skipped or put aside, with the reason
    /// ([`RecordKind::Refusal`]), and others ([`RecordKind::Alarm`]).
    fn take_messages(&mut self) -> Vec<(RecordKind, String)> {
        Vec::new()
    }

    /// How soon `next` and [`Source::poll`] should be asked again when nothing wakes the loop.
    fn look_every(&self) -> Duration {
        Duration::from_secs(1)
    }
}
