//! The cost of one hop between processes: over the topics of the line, a Unix socket and a pipe.
//!
//! One producer writes records of 64 KiB; two consumers, each in its own process, read and sum them, as `process` and
//! `store` do. For a topic, a record is written once, into shared memory, and read there. A socket and a pipe copy it
//! twice, once per consumer, through the kernel, with the default buffers of the system.
#![expect(clippy::print_stdout, reason = "the figures are what this program is for")]

mod common;

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use tapline_wire::{
    CasingLimits, Limits, Line, LineAddress, Publisher, RecordKind, Role, Subscriber, TapHeader, TapTopic, bytes_of,
    bytes_of_mut, cache_lines_for, now_ns,
};

use common::{print_table, quantile};

/// Bytes of one record: 16384 samples of 16 bits, force and sound.
const BYTES: usize = 65_536;
const RECORDS: u64 = 12_000;
const ROUNDS: usize = 5;
const PACED_PER_S: u64 = 500;
const PACED_RECORDS: u64 = 1_000;
/// Tells a copy of this program which consumer to be.
const ROLE: &str = "TAPLINE_BENCH_HOP";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Topic,
    Socket,
    Pipe,
}

const WAYS: [Way; 3] = [Way::Topic, Way::Socket, Way::Pipe];

impl Way {
    fn name(self) -> &'static str {
        match self {
            Self::Topic => "topic (shared memory)",
            Self::Socket => "Unix socket",
            Self::Pipe => "pipe",
        }
    }
}

fn main() -> Result<()> {
    match std::env::var(ROLE) {
        Ok(role) => consume(&role),
        Err(_) => compare(),
    }
}

fn compare() -> Result<()> {
    let mut runs: [Vec<Run>; 3] = Default::default();
    let mut paced: [Vec<Run>; 3] = Default::default();
    for _ in 0..ROUNDS {
        for (way, runs) in WAYS.into_iter().zip(&mut runs) {
            runs.push(run(way, RECORDS, None)?);
        }
    }
    for (way, paced) in WAYS.into_iter().zip(&mut paced) {
        paced.push(run(way, PACED_RECORDS, Some(Duration::from_micros(1_000_000 / PACED_PER_S)))?);
    }
    report(&mut runs);
    report_paced(&paced);
    Ok(())
}

/// The result of one run.
#[derive(Debug)]
struct Run {
    elapsed_s: f64,
    producer_cpu_us: f64,
    /// Mean of the two consumers.
    consumer_cpu_us: f64,
    /// Median and 99th percentile of the first consumer. Over a topic, it is woken for every record; the second one
    /// polls.
    latency_us: (f64, f64),
}

/// Sends `count` records over `way`, one per `period` or as fast as they are accepted.
fn run(way: Way, count: u64, period: Option<Duration>) -> Result<Run> {
    let (cpu_ns, begin_ns, reports) = match way {
        Way::Topic => over_topic(count, period)?,
        Way::Socket | Way::Pipe => over_stream(way, count, period)?,
    };
    for report in &reports {
        ensure!(report.count == count && report.bad == 0, "{}: {report:?} of {count} records", way.name());
    }
    let [a, b] = reports;
    let last_ns = if a.last_ns > b.last_ns { a.last_ns } else { b.last_ns };
    #[expect(clippy::cast_precision_loss, reason = "figures for people to read")]
    let us_per_record = |ns: u64| ns as f64 / 1e3 / count as f64;
    Ok(Run {
        elapsed_s: us_per_record(u64::try_from(last_ns - begin_ns)?) * count as f64 / 1e6,
        producer_cpu_us: us_per_record(cpu_ns),
        consumer_cpu_us: us_per_record(a.cpu_ns + b.cpu_ns) / 2.0,
        latency_us: (a.p50_us, a.p99_us),
    })
}

// ---- the record ------------------------------------------------------------------------------------------------

/// Writes record number `number` into `bytes`: the number, the time of sending, and a word for each position.
fn fill(bytes: &mut [u8], number: u64) {
    let (words, _) = bytes.as_chunks_mut::<8>();
    for (k, word) in (0_u64..).zip(words.iter_mut()) {
        *word = (number + k).to_ne_bytes();
    }
    words[0] = number.to_ne_bytes();
    words[1] = now_ns().to_ne_bytes();
}

/// The number and the time in a record; `None` if its other words do not fit the number.
fn check(bytes: &[u8]) -> Option<(u64, i64)> {
    let (words, _) = bytes.as_chunks::<8>();
    let (&[number, sent_ns], rest) = words.split_first_chunk::<2>()?;
    let (number, rest_count) = (u64::from_ne_bytes(number), rest.len() as u64);
    let sum = rest.iter().fold(0_u64, |sum, &word| sum.wrapping_add(u64::from_ne_bytes(word)));
    let places: u64 = (2..2 + rest_count).sum();
    (sum == number.wrapping_mul(rest_count).wrapping_add(places)).then_some((number, i64::from_ne_bytes(sent_ns)))
}

/// Processor time of this process so far, in ns.
fn cpu_ns() -> u64 {
    let text = |entry: std::fs::DirEntry| std::fs::read_to_string(entry.path().join("schedstat")).ok();
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    tasks.filter_map(text).filter_map(|t| t.split(' ').next().and_then(|ns| ns.parse::<u64>().ok())).sum()
}

// ---- the producer ----------------------------------------------------------------------------------------------

/// Calls `send` for each record number, on schedule; returns the processor time that took, and when it began.
fn produce(count: u64, period: Option<Duration>, mut send: impl FnMut(u64) -> Result<()>) -> Result<(u64, i64)> {
    let (cpu_before, begin_ns, begin) = (cpu_ns(), now_ns(), Instant::now());
    for number in 0..count {
        if let Some(period) = period {
            let due = begin + period * u32::try_from(number)?;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        send(number)?;
    }
    Ok((cpu_ns() - cpu_before, begin_ns))
}

fn over_topic(count: u64, period: Option<Duration>) -> Result<(u64, i64, [ConsumerReport; 2])> {
    let address = LineAddress::fresh()?;
    let name = address.root().display();
    let outcome = {
        let line = Line::join(&address, Role::Acquire(0), &limits(), Arc::default())?;
        let mut consumers = Vec::new();
        for role in ["process", "store"] {
            consumers.push(start(&format!("{role} {name}"), Stdio::null())?);
        }
        let publisher = Publisher::<TapTopic>::open(&line)?;
        publisher.wait_ready()?;
        let (cpu_ns, begin_ns) = produce(count, period, |number| {
            let mut loan = publisher.loan(cache_lines_for(BYTES))?;
            loan.fill(|header, buffer| {
                header.plan_index = 0;
                fill(bytes_of_mut(buffer), number);
            });
            Ok(loan.send(RecordKind::Data)?)
        })?;
        publisher.send(RecordKind::End, TapHeader::default(), &[])?;
        (cpu_ns, begin_ns, said_by(consumers)?)
    };
    address.clear()?;
    Ok(outcome)
}

fn over_stream(way: Way, count: u64, period: Option<Duration>) -> Result<(u64, i64, [ConsumerReport; 2])> {
    let (mut ends, mut consumers) = (Vec::new(), Vec::new());
    for _ in 0..2 {
        let (ours, theirs): (OwnedFd, OwnedFd) = match way {
            Way::Socket => UnixStream::pair().map(|(a, b)| (a.into(), b.into()))?,
            Way::Topic | Way::Pipe => std::io::pipe().map(|(reader, writer)| (writer.into(), reader.into()))?,
        };
        ends.push(File::from(ours));
        consumers.push(start("stream", Stdio::from(theirs))?);
    }
    // Waits until they have started, because their start is not to be measured.
    std::thread::sleep(Duration::from_millis(50));
    let mut bytes = vec![0_u8; BYTES];
    let (cpu_ns, begin_ns) = produce(count, period, |number| {
        fill(&mut bytes, number);
        for end in &mut ends {
            end.write_all(&bytes)?;
        }
        Ok(())
    })?;
    drop(ends);
    Ok((cpu_ns, begin_ns, said_by(consumers)?))
}

fn start(role: &str, stdin: Stdio) -> Result<Child> {
    let mut command = Command::new(std::env::current_exe()?);
    command.env(ROLE, role).stdin(stdin).stdout(Stdio::piped());
    command.spawn().with_context(|| format!("cannot start the consumer {role}"))
}

/// Limits of a line with room for these records and little else.
fn limits() -> Limits {
    let casing = CasingLimits { taps: 1, room: 0, scans: 1, locations: 1, record_bytes: BYTES };
    Limits { casing, ..Limits::default() }
}

// ---- the consumers ---------------------------------------------------------------------------------------------

/// What a consumer counts.
#[derive(Debug, Default)]
struct Seen {
    count: u64,
    bad: u64,
    first_cpu_ns: u64,
    last_ns: i64,
    latency_us: Vec<f64>,
}

impl Seen {
    fn take(&mut self, bytes: &[u8]) {
        let arrived_ns = now_ns();
        if self.count == 0 {
            self.first_cpu_ns = cpu_ns();
        }
        let checked = check(bytes).filter(|&(number, _)| number == self.count);
        self.bad += u64::from(checked.is_none());
        #[expect(clippy::cast_precision_loss, reason = "figures for people to read")]
        let latency_us = checked.map_or(f64::NAN, |(_, sent_ns)| (arrived_ns - sent_ns) as f64 / 1e3);
        self.latency_us.push(latency_us);
        self.count += 1;
        self.last_ns = now_ns();
    }

    fn report(mut self) {
        let cpu_ns = cpu_ns() - self.first_cpu_ns;
        let (p50_us, p99_us) = (quantile(&mut self.latency_us, 0.5), quantile(&mut self.latency_us, 0.99));
        println!("{} {} {cpu_ns} {} {p50_us} {p99_us}", self.count, self.bad, self.last_ns);
    }
}

fn consume(role: &str) -> Result<()> {
    let seen = match role.split_once(' ') {
        Some(("process", name)) => from_topic(Role::Process, name)?,
        Some(("store", name)) => from_topic(Role::Store, name)?,
        None if role == "stream" => from_stream()?,
        _ => bail!("{ROLE} is {role:?}; it is set by this program alone"),
    };
    seen.report();
    Ok(())
}

fn from_topic(role: Role, name: &str) -> Result<Seen> {
    let line = Line::join(&LineAddress::at(name.as_ref())?, role, &limits(), Arc::default())?;
    let taps = Subscriber::<TapTopic>::open(&line)?;
    let mut seen = Seen::default();
    loop {
        match taps.receive()? {
            Some(tap) if tap.kind() == Some(RecordKind::End) => break,
            Some(tap) => seen.take(bytes_of(&tap)),
            None => line.wait(Duration::from_millis(100))?,
        }
    }
    seen.bad += taps.lost();
    Ok(seen)
}

fn from_stream() -> Result<Seen> {
    let mut stream = File::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    let (mut bytes, mut seen) = (vec![0_u8; BYTES], Seen::default());
    while stream.read_exact(&mut bytes).is_ok() {
        seen.take(&bytes);
    }
    Ok(seen)
}

/// What a consumer reports.
#[derive(Debug)]
struct ConsumerReport {
    count: u64,
    bad: u64,
    cpu_ns: u64,
    last_ns: i64,
    p50_us: f64,
    p99_us: f64,
}

fn said_by(consumers: Vec<Child>) -> Result<[ConsumerReport; 2]> {
    let mut reports = Vec::new();
    for consumer in consumers {
        let output = consumer.wait_with_output()?;
        ensure!(output.status.success(), "a consumer failed ({})", output.status);
        let text = String::from_utf8(output.stdout)?;
        let words: Vec<&str> = text.split_whitespace().collect();
        let &[count, bad, cpu_ns, last_ns, p50_us, p99_us] = words.as_slice() else {
            bail!("a consumer reports {text:?}")
        };
        reports.push(ConsumerReport {
            count: count.parse()?,
            bad: bad.parse()?,
            cpu_ns: cpu_ns.parse()?,
            last_ns: last_ns.parse()?,
            p50_us: p50_us.parse()?,
            p99_us: p99_us.parse()?,
        });
    }
    reports.try_into().ok().context("there are two consumers")
}

// ---- the report ------------------------------------------------------------------------------------------------

#[expect(clippy::cast_precision_loss, reason = "figures for people to read")]
fn report(runs: &mut [Vec<Run>; 3]) {
    let per_s = |runs: &[Run]| {
        let mut rates: Vec<f64> = runs.iter().map(|run| RECORDS as f64 / run.elapsed_s).collect();
        (quantile(&mut rates, 0.5), quantile(&mut rates, 0.75))
    };
    let rates: Vec<(f64, f64)> = runs.iter().map(|runs| per_s(runs)).collect();
    let pipe = rates[2].1;
    let rows: Vec<[String; 7]> = WAYS
        .into_iter()
        .zip(runs.iter())
        .zip(&rates)
        .map(|((way, runs), &(median, quartile))| {
            let cpu = |of: fn(&Run) -> f64| quantile(&mut runs.iter().map(of).collect::<Vec<_>>(), 0.25);
            [
                way.name().to_owned(),
                format!("{median:.0}"),
                format!("{quartile:.0}"),
                format!("{:.2}", quartile * BYTES as f64 / 1e9),
                format!("{:.2}", quartile / pipe),
                format!("{:.1}", cpu(|run| run.producer_cpu_us)),
                format!("{:.1}", cpu(|run| run.consumer_cpu_us)),
            ]
        })
        .collect();
    let head = ["way", "median/s", "upper quartile/s", "GB/s", "/ pipe", "CPU us, producer", "CPU us, each consumer"];
    let title = format!("one hop to two consumers, records of 64 KiB as fast as they go, {ROUNDS} rounds by turns");
    print_table(&title, head, &rows);
}

fn report_paced(paced: &[Vec<Run>; 3]) {
    let rows: Vec<[String; 5]> = WAYS
        .into_iter()
        .zip(paced.iter().flatten())
        .map(|(way, run)| {
            [
                way.name().to_owned(),
                format!("{:.0}", run.latency_us.0),
                format!("{:.0}", run.latency_us.1),
                format!("{:.1}", run.producer_cpu_us),
                format!("{:.1}", run.consumer_cpu_us),
            ]
        })
        .collect();
    let title = format!("the same at {PACED_PER_S} records/s: from sending to arrival at the first consumer");
    print_table(&title, ["way", "p50 us", "p99 us", "CPU us, producer", "CPU us, each consumer"], &rows);
}
