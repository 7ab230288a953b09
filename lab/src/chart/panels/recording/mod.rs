//! What must be recorded: length, sample rate and bits of a record against loss of detection.

pub(super) mod readings;
pub(super) mod scenes;
mod table;

use anyhow::Result;

use self::readings::{Heard, HeardCost, costs};
use self::scenes::{Found, found};
use crate::chart::Bench;
use crate::chart::casings::{Place, loss};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Failure, Point};
use crate::simulated::Simulator;

/// What loss of detection, and what part of a cost, counts as a difference.
pub(super) const TOLERANCE: Tolerance = Tolerance { cost: 0.15, error: 0.003 };

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let lengths = Heard::lengths();
    let of_lengths = costs(bench, &lengths)?;
    let found_lengths = found(bench, &lengths, &scenes::ALL)?;
    let converters = Heard::converters(&bench.size);
    let of_converters = costs(bench, &converters)?;
    let found_converters = found(bench, &converters, &scenes::FAINT)?;
    let bytes = Quantity::log("Archived a tap, packed with lz4", "KiB");
    let time = Quantity::log("Processor time of a tap, all discriminators", "\u{b5}s");
    let by_bytes: fn(&HeardCost) -> Cost = |cost| cost.bytes_kib;
    let of_lengths = (&lengths, &of_lengths, &found_lengths, &readings::LENGTH_FAMILIES[..]);
    let of_converters = (&converters, &of_converters, &found_converters, &readings::CONVERTER_FAMILIES[..]);
    let mut facets = Vec::new();
    for simulator in Simulator::ALL {
        for (name, title, cost, value, (heard, costs, found, families)) in [
            ("bytes", "Length by bytes", bytes, by_bytes, of_lengths),
            ("time", "Length by processor time", time, |cost| cost.cpu_us, of_lengths),
            ("converter", "Sample rate and bits", bytes, by_bytes, of_converters),
        ] {
            let point = |(place, heard)| point(bench, heard, value(&costs[place]), found, (simulator, place));
            facets.push(Facet {
                cost,
                error: Quantity::log("Loss of detection, 1 \u{2212} AUC", ""),
                tolerance: TOLERANCE,
                families: families.to_vec(),
                points: heard.iter().enumerate().map(point).collect::<Result<_>>()?,
                ..bench
                    .facet(format!("{}-{name}", simulator.name()), format!("{title}, simulator {}", simulator.name()))
            });
        }
    }
    let tables = vec![table::by_length(bench, &lengths, &found_lengths)?];
    let panel = Panel::new(
        "Which length, rate and resolution must a record have?",
        "The rig waits for a record to end, and every stage carries and reads its samples. How much of it helps find cracks?",
        [
            "The same taps, shortened: one turn at each of two offsets, with an equally shortened reference. Faint and strong cracks of both \
             populations, and faint ones in eight times the noise, all locations together; the table has each scene.",
            "Sample rates and bits are of faint cracks in smooth casings alone, with and without that noise, in records of 0.1 s. Another \
             rate is another simulation, with the same noise per sample. The force's range is 222 N, of which a tap uses a tenth.",
            "Bytes are both channels of taps of `model`, packed with `lz4`. Shared memory and disk without a codec carry 4 bytes a \
             sample pair. Samples whose number is no power of two pack and transform less well: 0.06 s are 2458 of them, 0.05 s 2048.",
            "The simulated casings have rung down after 25 ms or so. Casings that ring longer need the ringing to be over before the \
             next tap, not in the record.",
        ],
        facets,
    );
    Ok(Panel { tables, ..panel })
}

/// The point of `heard`, which is the way number `place`, on casings of `simulator`.
pub(super) fn point(
    bench: &Bench,
    heard: &Heard,
    cost: Cost,
    found: &[Found],
    (simulator, place): (Simulator, usize),
) -> Result<Point> {
    let of_simulator = || found.iter().filter(|found| found.simulator == simulator);
    let new = |error: Error, n: usize| {
        Point::new(heard.name.clone(), heard.label.clone(), cost, error, n)
            .family(heard.family)
            .default_if(heard.is_default)
    };
    if of_simulator().any(|f| f.judged[place].is_none()) {
        // A scene without any index: half of its pairs are ranked correctly, by chance.
        let error = Error { value: 0.5, low: 0.5, high: 0.5, by_seed: bench.seeds().map(|_| 0.5).collect() };
        let failure = Failure { case: "scenes in which such records make no reference", measured: 1.0, limit: 0.0 };
        return Ok(new(error, 0).failing(vec![failure]));
    }
    let places: Vec<Place> = of_simulator().flat_map(|found| found.places(place)).collect();
    let (error, n) = loss(bench, &places)?;
    Ok(new(error, n).failing(heard.failures()))
}
