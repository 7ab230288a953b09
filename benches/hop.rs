//! A record from one process to two others: through the line's shared memory, a Unix socket, a pipe, and ZeroMQ, by turns.

use std::time::Duration;

use anyhow::Result;
use tapline_bench::{Row, Sheet, Spread};
use tapline_lab::hop::{Carrier, RecordSize, Run, is_consumer, run};

const ROUNDS: usize = 7;
/// Sizes of a record. A tap of 50 ms has 8 KiB, one of 0.4 s has 64 KiB.
const SIZES_KIB: [usize; 5] = [4, 8, 64, 256, 1024];
const CARRIERS: &[Carrier] = &[
    Carrier::Topic,
    Carrier::Socket,
    Carrier::Pipe,
    #[cfg(feature = "zeromq")]
    Carrier::ZeroMq,
];
/// Records of a paced run, and how many of them per second.
const PACED: (u64, u32) = (1000, 500);
/// Records of 64 KiB of an unpaced run; smaller ones are more, larger ones fewer.
const FAST: u64 = 4000;

/// All runs of one carrier and size.
struct Case {
    kib: usize,
    carrier: Carrier,
    paced: Vec<Run>,
    fast: Vec<Run>,
}

fn main() -> Result<()> {
    if is_consumer()? {
        return Ok(());
    }
    let of_size = |kib| CARRIERS.iter().map(move |&carrier| Case { kib, carrier, paced: Vec::new(), fast: Vec::new() });
    let mut cases: Vec<Case> = SIZES_KIB.into_iter().flat_map(of_size).collect();
    let period = Duration::from_secs(1) / PACED.1;
    let [small, .., large] = SIZES_KIB.map(|kib| kib * 1024);
    let mut untouched = Vec::new();
    for _ in 0..ROUNDS {
        for case in &mut cases {
            let count = (FAST * 64 / case.kib as u64).clamp(FAST / 16, 4 * FAST);
            let size = RecordSize::whole(case.kib * 1024);
            case.paced.push(run(case.carrier, size, PACED.0, Some(period))?);
            case.fast.push(run(case.carrier, size, count, None)?);
        }
        untouched.push(run(Carrier::Topic, RecordSize { bytes: large, used: small }, PACED.0, Some(period))?);
    }
    Sheet {
        title: "The hop".to_owned(),
        command: "cargo bench -p tapline-bench --bench hop".to_owned(),
        notes: vec![
            format!(
                "A producer writes each record, two consumers sum it, each in its own process; {ROUNDS} rounds of {} records at {} \
                 per second, and of others as fast as they are read. Every record arrives whole and in order, or the bench fails.",
                PACED.0, PACED.1
            ),
            "Latency is from sending to the first consumer, which is woken for every record. Processor time is of all three \
             processes, per record."
                .to_owned(),
            "Filling a record of 1 MiB evicts what sending and receiving need from the caches; the record of the last row is \
             not filled, though the layer zeroes it."
                .to_owned(),
            "ZeroMQ: libzmq, PUSH to PULL over `ipc://`, a socket for each consumer.".to_owned(),
        ],
        rows: rows(&cases, &untouched),
    }
    .keep("hop")
}

fn of(runs: &[Run], value: fn(&Run) -> f64) -> Vec<f64> {
    runs.iter().map(value).collect()
}

/// The rows of the page; `untouched` are runs with the largest record, of which only the smallest size is used.
fn rows(cases: &[Case], untouched: &[Run]) -> Vec<Row> {
    let case = |kib, carrier| cases.iter().find(|case| case.kib == kib && case.carrier == carrier);
    let mut rows = Vec::new();
    for kib in SIZES_KIB {
        let Some(ours) = case(kib, Carrier::Topic) else { continue };
        let compared = |row: Row, runs: fn(&Case) -> &[Run], value: fn(&Run) -> f64| {
            CARRIERS[1..].iter().filter_map(|&carrier| Some((carrier, case(kib, carrier)?))).fold(
                row,
                |row, (carrier, theirs)| {
                    let ratio = Spread::of_ratio(&of(runs(ours), value), &of(runs(theirs), value));
                    row.beside(
                        &format!("of that over {}", name(carrier)),
                        ratio,
                        if carrier == Carrier::Socket { "<= 1" } else { "" },
                    )
                },
            )
        };
        for (what, value) in [
            ("latency at 500 records/s, median", (|run| run.p50_us) as fn(&Run) -> f64),
            ("latency at 500 records/s, 99 of 100", |run| run.p99_us),
            ("processor time at 500 records/s", |run| run.cpu_us),
        ] {
            let mut row = Row::new(format!("{kib} KiB: {what}"), "us", &of(&ours.paced, value));
            row = compared(row, |case| &case.paced, value);
            if let (true, Some(small)) = (what.ends_with("median") && kib == 1024, case(SIZES_KIB[0], Carrier::Topic)) {
                let ratio = Spread::of_ratio(&of(&ours.paced, value), &of(&small.paced, value));
                row = row.beside("of that of 4 KiB", ratio, "<= 1.5");
            }
            rows.push(row);
        }
        let row = Row::new(
            format!("{kib} KiB: as fast as they go, time of a record"),
            "us",
            &of(&ours.fast, |run| run.elapsed_us),
        );
        rows.push(compared(row, |case| &case.fast, |run| run.elapsed_us));
    }
    if let Some(small) = case(SIZES_KIB[0], Carrier::Topic) {
        let ours = of(untouched, |run| run.p50_us);
        let ratio = Spread::of_ratio(&ours, &of(&small.paced, |run| run.p50_us));
        let what = "1024 KiB, of which 4 KiB are filled and read: latency at 500 records/s, median";
        rows.push(Row::new(what, "us", &ours).beside("of that of 4 KiB", ratio, "<= 1.5"));
    }
    rows
}

fn name(carrier: Carrier) -> &'static str {
    match carrier {
        Carrier::Socket => "a Unix socket",
        Carrier::Pipe => "a pipe",
        carrier => carrier.name(),
    }
}
