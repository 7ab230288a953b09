//! The finite list of simulated tyres that a run scans: each is made when its turn comes, and handed over.

use std::sync::Arc;

use tapline_model::SimulationConfig;
use tapline_wire::{CasingLimits, digest_of_parts};

use crate::simulated::{Tyre, default_tyre, plan_of, rig_of, station_of, tyre_of};
use crate::{Arrival, Arrivals, Casing, CasingList, Error, ListedCasing, ScanConfig, SimulatedLine};

/// The casings of a simulated scan.
#[derive(Debug, Clone)]
pub struct SimulatedList {
    world: Arc<World>,
}

/// What determines every simulated tyre.
#[derive(Debug)]
struct World {
    scan: ScanConfig,
    simulation: SimulationConfig,
}

/// The casings of the simulated scan that `scan` and `simulation` describe: one per tyre.
///
/// # Errors
/// [`Error`] for a value out of its bounds.
pub fn listed_simulated(scan: &ScanConfig, simulation: &SimulationConfig) -> Result<SimulatedList, Error> {
    scan.validate()?;
    let world = World { scan: scan.clone(), simulation: simulation.clone() };
    // The cracks of all tyres are checked now, not when each tyre's turn comes: one rig per tyre, dropped at once.
    let tyres: Vec<Tyre> = (0..scan.tyre.len()).map(|number| tyre_of(scan, number)).collect::<Result<_, _>>()?;
    rig_of(scan, simulation, &tyres)?;
    Ok(SimulatedList { world: Arc::new(world) })
}

impl CasingList for SimulatedList {
    fn listed(&self) -> Box<dyn Iterator<Item = Result<ListedCasing, Error>> + '_> {
        let World { scan, simulation } = &*self.world;
        Box::new((0..scan.tyre_count()).map(move |number| {
            let tyre = tyre_of(scan, number)?;
            let plan = plan_of(scan, simulation, std::slice::from_ref(&tyre), 0)?;
            Ok((tyre.serial.to_string(), tyre.station, plan))
        }))
    }

    fn stations(&self) -> Vec<u16> {
        let scan = &self.world.scan;
        let mut stations: Vec<u16> = (0..scan.tyre_count()).map(|number| station_of(scan, number)).collect();
        stations.sort_unstable();
        stations.dedup();
        stations
    }

    fn arrivals(&self, station: u16) -> Box<dyn Arrivals> {
        let which = Tyres::Listed { next: 0, taps_before: 0 };
        Box::new(SimulatedTyres { world: Arc::clone(&self.world), station, which })
    }

    fn limits(&self) -> Result<CasingLimits, Error> {
        Ok(self.world.scan.limits(&self.world.simulation))
    }
}

/// The simulated tyres of one station, one after another.
#[derive(Debug)]
pub(crate) struct SimulatedTyres {
    world: Arc<World>,
    station: u16,
    which: Tyres,
}

/// Which tyres come to a station.
#[derive(Debug)]
enum Tyres {
    /// Those of the scan's list that are this station's.
    Listed {
        /// Tyre of the whole scan that is looked at next.
        next: usize,
        /// Taps of this station's tyres so far: its clock.
        taps_before: u64,
    },
    /// Tyres that no list names, for endless lines.
    Unlisted {
        /// Number of the next tyre, from 1.
        next: u64,
        /// Number of the last tyre, where there is a last one.
        last: Option<u64>,
    },
}

impl SimulatedTyres {
    /// Tyres that no list names, from number `first` on, `count` of them where that is known.
    pub(crate) fn unlisted(
        scan: &ScanConfig,
        simulation: &SimulationConfig,
        station: u16,
        count: Option<u64>,
    ) -> Result<Self, Error> {
        scan.validate()?;
        rig_of(scan, simulation, &[])?;
        let world = World { scan: scan.clone(), simulation: simulation.clone() };
        Ok(Self { world: Arc::new(world), station, which: Tyres::Unlisted { next: 1, last: count } })
    }
}

impl Arrivals for SimulatedTyres {
    fn station(&self) -> u16 {
        self.station
    }

    fn next(&mut self) -> Result<Arrival, Error> {
        let World { scan, simulation } = &*self.world;
        let (tyre, taps_before, source_digest) = match &mut self.which {
            Tyres::Listed { next, taps_before } => {
                let ours = (*next..scan.tyre_count()).find(|&number| station_of(scan, number) == self.station);
                let Some(number) = ours else { return Ok(Arrival::Ended) };
                *next = number + 1;
                let before = *taps_before;
                *taps_before += scan.taps_per_tyre();
                (tyre_of(scan, number)?, before, 0)
            }
            Tyres::Unlisted { next, last } => {
                let number = *next;
                if last.is_some_and(|last| number > last) {
                    return Ok(Arrival::Ended);
                }
                *next = number.saturating_add(1);
                let serial = format!("S{}-{number}", self.station);
                let tyre = default_tyre(scan, &serial, self.station, number % 2 == 1)?;
                // Numbers restart with this process: a finished tyre is recognised by its source, and not tapped again.
                let texts = [toml::to_string(scan), toml::to_string(simulation)].map(Result::unwrap_or_default);
                let source_digest = digest_of_parts(texts.iter().map(String::as_bytes));
                (tyre, (number - 1).saturating_mul(scan.taps_per_tyre()), source_digest)
            }
        };
        let taps = SimulatedLine::for_tyre(scan, simulation, &tyre, taps_before, source_digest)?;
        Ok(Arrival::Casing(Casing { name: tyre.serial.to_string(), taps: Box::new(taps) }))
    }
}

#[cfg(test)]
#[path = "listed_tests.rs"]
pub(crate) mod tests;
