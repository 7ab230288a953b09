//! Peak force and contact time: processor time of an estimator against its error, and against loss of detection.

mod detection;

use anyhow::{Context as _, Result};
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::Discriminator;

use crate::chart::Bench;
use crate::chart::cost::{Workload, by_turns};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Failure, Point, exceeds};
use crate::estimators::{
    Effort, Estimator as Way, Row, SignalCase, estimators_of as ways, extract_force, measure_one, pulse_records,
};
use crate::simulated::Simulator;

/// Pulses whose errors are shown: those of the contact models that run in time, on sound rubber and over cracks.
const PULSES: [&str; 3] = ["integral", "plate", "full"];
/// The rig's sample rate, and one at which a pulse has ten samples.
const RATE_HZ: u32 = 40_960;
const COARSE_RATE_HZ: u32 = 10_240;

impl Way {
    fn is_default(self) -> bool {
        let default = ProcessConfig::default();
        (self.config.f_max, self.config.tau) == (default.f_max, default.tau)
    }

    fn words(self) -> String {
        format!("{} = \"{}\"", if self.quantities[0] == Discriminator::FMax { "f_max" } else { "tau" }, self.name)
    }
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let (peaks, times) = (ways(Discriminator::FMax), ways(Discriminator::Tau));
    let of_times = costs(bench, &times)?;
    let mut facets = vec![
        against_truth(bench, ("f_max", "Peak force, noise of 1 % of the peak"), &peaks, &costs(bench, &peaks)?)?,
        against_truth(bench, ("tau", "Contact time, noise of 1 % of the peak"), &times, &of_times)?,
    ];
    for simulator in Simulator::ALL {
        facets.push(detection::alone(bench, simulator, &times, &of_times)?);
    }
    Ok(Panel::new(
        "How are the peak and the duration of a pulse found?",
        "Which estimator of F_max and tau is nearest to the contact, and which tells a crack from sound rubber?",
        [
            "Errors are of pulses of the contact models that run in time, on sound rubber and over a crack 5 mm deep, at 40.96 kHz; \
             the cost is that of reading a record of the force alone, in double precision.",
            "Every estimator of tau gives a skewed pulse a shorter duration than its contact. Pulses of one shape lose the same part. \
             That is most of the error here, and does not matter to an index, which compares with the rest of the ring. So detection is \
             shown beside it, on casings with faint cracks tapped twice at the belt edge: tau alone, mean of three neighbours. What the index finds with \
             each is in the panel `settings`.",
        ],
        facets,
    ))
}

fn cell(signal: &'static str, rate_hz: u32, snr_db: Option<u32>) -> SignalCase {
    SignalCase { table: "force", signal, rate_hz, snr_db, fault: "" }
}

/// The row of `way` among the measured rows of a cell.
fn row_of<'a>(rows: &'a [Row], way: &Way) -> Result<&'a Row> {
    rows.iter()
        .find(|row| row.estimator == way.name && row.quantity == way.quantities[0].column())
        .with_context(|| format!("{} was not measured", way.name))
}

fn against_truth(bench: &Bench, (name, title): (&str, &str), ways: &[Way], costs: &[Cost]) -> Result<Facet> {
    let mut by_seed = vec![Vec::new(); ways.len()];
    for seed in bench.seeds() {
        let effort = Effort { seed, taps: bench.size.pulses };
        let mut squares = vec![0.0; ways.len()];
        for pulse in PULSES {
            let rows = measure_one(&cell(pulse, RATE_HZ, Some(40)), effort)?;
            for (way, squares) in ways.iter().zip(&mut squares) {
                let row = row_of(&rows, way)?;
                *squares += (row.bias_percent.powi(2) + row.spread_percent.powi(2)) / PULSES.len() as f64;
            }
        }
        by_seed.iter_mut().zip(squares).for_each(|(by_seed, squares)| by_seed.push(squares.sqrt()));
    }
    let n = PULSES.len() * bench.size.pulses as usize * bench.size.seed_count as usize;
    let points = ways.iter().zip(costs).zip(by_seed);
    let points = points.map(|((way, &cost), by_seed)| point(bench, way, cost, Error::mean_of(by_seed), n));
    Ok(Facet {
        cost: Quantity::linear("Processor time of a record of the force", "\u{b5}s"),
        error: Quantity::log("Error against the contact, rms", "%"),
        tolerance: Tolerance { cost: 0.1, error: 0.1 },
        truth: "peak and duration of the contact model that made the pulse".to_owned(),
        families: vec!["estimators"],
        points: points.collect::<Result<_>>()?,
        ..bench.facet(name, title)
    })
}

fn point(bench: &Bench, way: &Way, cost: Cost, error: Error, n: usize) -> Result<Point> {
    Ok(Point::new(way.words(), way.name, cost, error, n).default_if(way.is_default()).failing(failures(bench, way)?))
}

/// The limits that the estimator of `which`, F_max or tau, in `config` fails.
pub(super) fn of_estimator(bench: &Bench, which: Discriminator, config: &ProcessConfig) -> Result<Vec<Failure>> {
    let is_it = |way: &Way| (way.config.f_max, way.config.tau) == (config.f_max, config.tau);
    ways(which).into_iter().find(is_it).map_or(Ok(Vec::new()), |way| failures(bench, &way))
}

/// What an estimator fails on a pulse of ten samples, and over a crack.
fn failures(bench: &Bench, way: &Way) -> Result<Vec<Failure>> {
    let effort = Effort { seed: bench.seed, taps: bench.size.pulses };
    let bias = |pulse: &'static str, rate_hz, snr_db| -> Result<f64> {
        let rows = measure_one(&cell(pulse, rate_hz, snr_db), effort)?;
        Ok(row_of(&rows, way)?.bias_percent)
    };
    if way.quantities[0] == Discriminator::FMax {
        let few = bias("plate", COARSE_RATE_HZ, None)?.abs();
        return Ok(exceeds("C13: a pulse of ten samples, bias of F_max in %", few, 2.0).into_iter().collect());
    }
    // Duration must rise over a crack as the contact does, whatever part of it is measured.
    let (sound, cracked) = (bias("integral", RATE_HZ, None)?, bias("plate", RATE_HZ, None)?);
    let rise = (1.0 + cracked / 100.0) / (1.0 + sound / 100.0);
    let lost = exceeds("part of the rise of tau over a crack that is lost", 1.0 - rise, 0.25);
    Ok(lost.into_iter().collect())
}

fn costs(bench: &Bench, ways: &[Way]) -> Result<Vec<Cost>> {
    let records =
        pulse_records(&cell("integral", RATE_HZ, Some(40)), Effort { seed: bench.seed, taps: bench.size.pulses })?;
    let mut workloads = Vec::new();
    for way in ways {
        let mut extractor = ProcessExtractor::new(&way.config)?;
        let which = way.quantities[0];
        workloads.push(Workload::each(&records, move |samples| {
            extract_force(&mut extractor, samples, RATE_HZ).and_then(|values| values.get(which)).unwrap_or(f64::NAN)
        }));
    }
    Ok(by_turns(workloads, bench.size.rounds))
}
