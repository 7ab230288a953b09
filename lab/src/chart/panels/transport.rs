//! Transport: the shared-memory hop compared with a Unix socket and a pipe, by the size of the record.

use std::time::Duration;

use anyhow::Result;

use crate::chart::Bench;
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Point};
use crate::hop::{Carrier, RecordSize, Run, run};

/// Sizes of a record. A tap of 0.4 s has 64 KiB, one of 0.05 s 8 KiB.
const SIZES_KIB: [usize; 5] = [4, 16, 64, 256, 1024];

const PACE_PER_S: u32 = 500;

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let size = &bench.size;
    // A short chart leaves out every second size.
    let sizes = SIZES_KIB.into_iter().step_by(if size.is_full { 1 } else { 2 });
    let cases: Vec<(usize, Carrier)> = sizes.flat_map(|kib| Carrier::ALL.map(|carrier| (kib, carrier))).collect();
    let (mut fast, mut paced) = (vec![Vec::new(); cases.len()], vec![Vec::new(); cases.len()]);
    let period = Duration::from_secs(1) / PACE_PER_S;
    for _ in 0..size.hop_rounds {
        for (place, &(kib, carrier)) in cases.iter().enumerate() {
            let count = (size.hops * 64 / kib as u64).clamp(size.hops / 16, 4 * size.hops);
            fast[place].push(run(carrier, RecordSize::whole(kib * 1024), count, None)?);
            paced[place].push(run(carrier, RecordSize::whole(kib * 1024), size.paced, Some(period))?);
        }
    }
    let elapsed: fn(&Run) -> f64 = |run| run.elapsed_us;
    let facets = [
        ("fast", "As fast as records go", "Time of a record", &fast, elapsed),
        ("paced", "500 records a second", "Latency, 99 of 100 records", &paced, |run| run.p99_us),
    ];
    let facets = facets.map(|(name, title, error, runs, time_us)| Facet {
        cost: Quantity::log("Processor time of a record, three processes", "\u{b5}s"),
        error: Quantity::log(error, "\u{b5}s"),
        // Scheduling adds noise: differences of less than 20 us do not count.
        tolerance: Tolerance { cost: 0.25, error: 20.0 },
        truth: "every record arrives whole and in order, or the run fails".to_owned(),
        seeds: vec![bench.seed],
        families: Carrier::ALL.map(Carrier::name).to_vec(),
        points: cases.iter().zip(runs).map(|(&case, runs)| point(case, runs, time_us)).collect(),
        ..bench.facet(name, title)
    });
    Ok(Panel::new(
        "How do records cross from process to process?",
        "A producer and two consumers in processes of their own: what does a record cost, and how long is it under way?",
        [
            "Each record is written by the producer and summed by both consumers, as `acquire`, `process` and `store` do. Through shared \
             memory it is written once and read in place; a socket and a pipe copy it twice, once for each consumer, through the \
             kernel. Costs are of all three processes; errors are times, means over alternating rounds.",
            "Lines join one transport from 4 KiB to 1 MiB. Each size has a front of its own.",
            "On a machine with other work, the 99th of 100 latencies is due to that work.",
        ],
        facets.into(),
    ))
}

/// The point of records of `kib` that are sent over `carrier`.
fn point((kib, carrier): (usize, Carrier), runs: &[Run], time_us: fn(&Run) -> f64) -> Point {
    let of = |value: fn(&Run) -> f64| runs.iter().map(value).collect::<Vec<f64>>();
    let n = runs.iter().map(|run| run.count as usize).sum();
    let size = if kib < 1024 { format!("{kib} KiB") } else { "1 MiB".to_owned() };
    let cost = Cost::of(&of(|run| run.cpu_us));
    Point::new(format!("{}, {size}", carrier.name()), size, cost, Error::mean_of(of(time_us)), n)
        .family(carrier as usize)
        .group(kib)
        .default_if(carrier == Carrier::Topic)
        .remark(format!("median latency {:.0} us", Cost::of(&of(|run| run.p50_us)).median))
}
