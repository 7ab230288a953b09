//! The finite list of casings in a tap set: the folder is read once, and its casings share it.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;
use std::sync::Arc;

use tapline_wire::CasingLimits;

use crate::tap_set::casings::{SetCasing, casings_of};
use crate::tap_set::recordings::Recordings;
use crate::{Arrival, Arrivals, Casing, CasingList, Error, ListedCasing, Source as _, TapSet};

/// The casings of a tap set.
#[derive(Debug, Clone)]
pub struct TapSetList {
    set: Arc<Recordings>,
    casings: Arc<[SetCasing]>,
}

/// The casings of the tap set in `dir`. Where `taps.csv` names no station, casings are distributed over `station_count`
/// stations in order of first appearance. A set with `geometry = "line"` is one casing with the name of the folder.
///
/// # Errors
/// [`Error`] if a table is missing or wrong, if no recording can be used, if a casing is at two stations, or if there
/// are no stations.
pub fn listed_tap_set(dir: &Path, station_count: u16) -> Result<TapSetList, Error> {
    let set = Recordings::open(dir)?;
    let casings = casings_of(&set, station_count)?.into();
    Ok(TapSetList { set: Arc::new(set), casings })
}

impl TapSetList {
    /// Number of casings.
    pub(crate) fn len(&self) -> usize {
        self.casings.len()
    }

    pub(crate) fn name(&self, number: usize) -> &str {
        &self.casings[number].name
    }

    /// Casing `number`, at `station`.
    pub(crate) fn casing(&self, number: usize, station: u16) -> Result<Casing, Error> {
        let taps = TapSet::from_casing(&self.set, &self.casings[number], station)?;
        debug_assert_eq!(taps.plan().stations(), [station]);
        Ok(Casing { name: self.name(number).to_owned(), taps: Box::new(taps) })
    }
}

/// Casings are in the order of their first appearance.
impl CasingList for TapSetList {
    fn listed(&self) -> Box<dyn Iterator<Item = Result<ListedCasing, Error>> + '_> {
        Box::new(self.casings.iter().map(|casing| {
            let plan = self.set.plan(&casing.rows, |_| casing.station)?;
            Ok((casing.name.clone(), casing.station, plan))
        }))
    }

    fn stations(&self) -> Vec<u16> {
        let stations: BTreeSet<u16> = self.casings.iter().map(|casing| casing.station).collect();
        stations.into_iter().collect()
    }

    fn arrivals(&self, station: u16) -> Box<dyn Arrivals> {
        let ours = self.casings.iter().enumerate().filter(|(_, casing)| casing.station == station);
        let numbers = ours.map(|(number, _)| number).collect();
        Box::new(Listed { list: self.clone(), station, numbers })
    }

    fn limits(&self) -> Result<CasingLimits, Error> {
        self.listed()
            .try_fold(CasingLimits::default(), |most, listed| Ok(most.and(CasingLimits::from_plan(&listed?.2))))
    }
}

/// The casings of one station.
#[derive(Debug)]
struct Listed {
    list: TapSetList,
    station: u16,
    /// The casings still to come, by their number in the list.
    numbers: VecDeque<usize>,
}

impl Arrivals for Listed {
    fn station(&self) -> u16 {
        self.station
    }

    fn next(&mut self) -> Result<Arrival, Error> {
        match self.numbers.pop_front() {
            Some(number) => Ok(Arrival::Casing(self.list.casing(number, self.station)?)),
            None => Ok(Arrival::Ended),
        }
    }
}

#[cfg(test)]
#[path = "listed_tests.rs"]
pub(crate) mod tests;
