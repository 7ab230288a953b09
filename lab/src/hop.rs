//! One hop: a producer sends records to two consumers, each in its own process.

use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use tapline_draw::stats::quantile;
use tapline_wire::{
    CasingLimits, Limits, Line, LineAddress, Publisher, RecordKind, Role, Subscriber, TapHeader, TapTopic, bytes_of,
    bytes_of_mut, cache_lines_for, now_ns,
};

/// Tells a copy of the program which consumer to be, and how large records are.
const ROLE: &str = "TAPLINE_LAB_HOP";

/// What a consumer prints first.
const STARTED: &str = "started\n";

/// How records travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// Through shared memory, as on a line.
    Topic,
    /// Through a Unix socket to each consumer.
    Socket,
    /// Through a pipe to each consumer.
    Pipe,
    /// Through ZeroMQ (`ipc://`, PUSH to PULL) to each consumer.
    #[cfg(feature = "zeromq")]
    ZeroMq,
}

impl Carrier {
    /// The ways in the atlas.
    pub const ALL: [Self; 3] = [Self::Topic, Self::Socket, Self::Pipe];

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Topic => "shared memory",
            Self::Socket => "Unix socket",
            Self::Pipe => "pipe",
            #[cfg(feature = "zeromq")]
            Self::ZeroMq => "ZeroMQ ipc",
        }
    }
}

/// Size of a record in bytes, and how many of them, from the first on, are filled and read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordSize {
    /// Of the record.
    pub bytes: usize,
    /// Bytes filled and read. Only shared memory can carry more: its layer zeroes the others, and nobody reads them.
    pub used: usize,
}

impl RecordSize {
    /// A record that is filled and read whole.
    pub fn whole(bytes: usize) -> Self {
        Self { bytes, used: bytes }
    }
}

/// Result of a run.
#[derive(Debug, Clone)]
pub struct Run {
    /// Records.
    pub count: u64,
    /// Time from the first record to the last, per record.
    pub elapsed_us: f64,
    /// Processor time of all three processes, per record.
    pub cpu_us: f64,
    /// Median time from sending to arrival at the first consumer, which is woken for every record.
    pub p50_us: f64,
    /// The same time, 99th percentile.
    pub p99_us: f64,
}

/// Sends `count` records of `size` over `carrier`, one per `period` or as fast as they are read.
///
/// # Errors
/// A record that does not arrive whole and in order, or an error of the system.
pub fn run(carrier: Carrier, size: RecordSize, count: u64, period: Option<Duration>) -> Result<Run> {
    let bytes = size.bytes;
    ensure!(carrier == Carrier::Topic || size.used == bytes, "{} only carries whole records", carrier.name());
    let (cpu_ns, begun_ns, reports) = match carrier {
        Carrier::Topic => over_topic(size, count, period)?,
        Carrier::Socket | Carrier::Pipe => over_stream(carrier, bytes, count, period)?,
        #[cfg(feature = "zeromq")]
        Carrier::ZeroMq => over_zeromq(bytes, count, period)?,
    };
    for report in &reports {
        ensure!(report.count == count && report.bad == 0, "{}: {report:?} of {count} records", carrier.name());
    }
    let [a, b] = reports;
    let last_ns = if a.last_ns > b.last_ns { a.last_ns } else { b.last_ns };
    let us_of = |ns: f64| ns / 1e3 / count as f64;
    Ok(Run {
        count,
        elapsed_us: us_of((last_ns - begun_ns) as f64),
        cpu_us: us_of((cpu_ns + a.cpu_ns + b.cpu_ns) as f64),
        p50_us: a.p50_us,
        p99_us: a.p99_us,
    })
}

// ---- the record ------------------------------------------------------------------------------------------------

/// Writes record number `number` into `bytes`: the number, the time of sending, and a word for each place.
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

/// Processor time of all threads of this process so far, ns.
fn process_cpu_ns() -> u64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    u64::try_from(time.tv_sec * 1_000_000_000 + time.tv_nsec).unwrap_or(0)
}

// ---- the producer ----------------------------------------------------------------------------------------------

/// Calls `send` for each record number, on schedule; returns the processor time that took, and when it began.
fn produce(count: u64, period: Option<Duration>, mut send: impl FnMut(u64) -> Result<()>) -> Result<(u64, i64)> {
    let (cpu_before, begun_ns, begun) = (process_cpu_ns(), now_ns(), Instant::now());
    for number in 0..count {
        if let Some(period) = period {
            let due = begun + period * u32::try_from(number)?;
            sleep(due.saturating_duration_since(Instant::now()));
        }
        send(number)?;
    }
    Ok((process_cpu_ns() - cpu_before, begun_ns))
}

fn over_topic(size: RecordSize, count: u64, period: Option<Duration>) -> Result<(u64, i64, [Report; 2])> {
    let RecordSize { bytes, used } = size;
    let address = LineAddress::fresh()?;
    let name = address.root().display();
    let outcome = {
        let line = Line::join(&address, Role::Acquire(0), &limits(bytes), Arc::default())?;
        let mut consumers = Vec::new();
        for role in ["process", "store"] {
            consumers.push(start(&format!("{role} {bytes} {used} {name}"), Stdio::null())?);
        }
        let publisher = Publisher::<TapTopic>::open(&line)?;
        publisher.wait_ready()?;
        let (cpu_ns, begun_ns) = produce(count, period, |number| {
            let mut loan = publisher.loan(cache_lines_for(bytes))?;
            loan.fill(|header, buffer| {
                header.plan_index = 0;
                fill(&mut bytes_of_mut(buffer)[..used], number);
            });
            Ok(loan.send(RecordKind::Data)?)
        })?;
        publisher.send(RecordKind::End, TapHeader::default(), &[])?;
        (cpu_ns, begun_ns, reported(consumers)?)
    };
    address.clear()?;
    Ok(outcome)
}

fn over_stream(
    carrier: Carrier,
    bytes: usize,
    count: u64,
    period: Option<Duration>,
) -> Result<(u64, i64, [Report; 2])> {
    let (mut ends, mut consumers) = (Vec::new(), Vec::new());
    for _ in 0..2 {
        let (ours, theirs): (OwnedFd, OwnedFd) = match carrier {
            Carrier::Socket => UnixStream::pair().map(|(a, b)| (a.into(), b.into()))?,
            _ => io::pipe().map(|(reader, writer)| (writer.into(), reader.into()))?,
        };
        ends.push(File::from(ours));
        consumers.push(start(&format!("stream {bytes} {bytes} -"), Stdio::from(theirs))?);
    }
    let mut record = vec![0_u8; bytes];
    let (cpu_ns, begun_ns) = produce(count, period, |number| {
        fill(&mut record, number);
        for end in &mut ends {
            end.write_all(&record)?;
        }
        Ok(())
    })?;
    drop(ends);
    Ok((cpu_ns, begun_ns, reported(consumers)?))
}

#[cfg(feature = "zeromq")]
fn over_zeromq(bytes: usize, count: u64, period: Option<Duration>) -> Result<(u64, i64, [Report; 2])> {
    let context = zmq::Context::new();
    let (mut sockets, mut consumers) = (Vec::new(), Vec::new());
    for number in 0..2 {
        let socket = context.socket(zmq::PUSH)?;
        // An abstract name, which leaves no file.
        let name = format!("ipc://@tapline-hop-{}-{number}", std::process::id());
        socket.bind(&name)?;
        consumers.push(start(&format!("zeromq {bytes} {bytes} {name}"), Stdio::null())?);
        sockets.push(socket);
    }
    let mut record = vec![0_u8; bytes];
    let (cpu_ns, begun_ns) = produce(count, period, |number| {
        fill(&mut record, number);
        Ok(sockets.iter().try_for_each(|socket| socket.send(&record, 0))?)
    })?;
    sockets.iter().try_for_each(|socket| socket.send(zmq::Message::new(), 0))?;
    Ok((cpu_ns, begun_ns, reported(consumers)?))
}

#[cfg(feature = "zeromq")]
fn from_zeromq(name: &str) -> Result<Seen> {
    let socket = zmq::Context::new().socket(zmq::PULL)?;
    socket.connect(name)?;
    let (mut message, mut seen) = (zmq::Message::new(), Seen::default());
    loop {
        socket.recv(&mut message, 0)?;
        if message.is_empty() {
            return Ok(seen);
        }
        seen.take(&message);
    }
}

/// A consumer that runs, and what it prints.
type Consumer = (Child, BufReader<ChildStdout>);

/// Starts a consumer, and waits until it runs: its start must not be measured.
fn start(role: &str, stdin: Stdio) -> Result<Consumer> {
    let mut command = Command::new(std::env::current_exe()?);
    command.env(ROLE, role).stdin(stdin).stdout(Stdio::piped());
    let mut child = command.spawn().with_context(|| format!("cannot start the consumer {role}"))?;
    let mut printed = BufReader::new(child.stdout.take().context("a consumer has no output")?);
    let mut line = String::new();
    printed.read_line(&mut line)?;
    ensure!(line == STARTED, "the consumer {role} says {line:?}");
    Ok((child, printed))
}

/// Limits of a line with room for these records and little else.
fn limits(bytes: usize) -> Limits {
    let casing = CasingLimits { taps: 1, room: 0, scans: 1, locations: 1, known_locations: 0, record_bytes: bytes };
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
            self.first_cpu_ns = process_cpu_ns();
        }
        let checked = check(bytes).filter(|&(number, _)| number == self.count);
        self.bad += u64::from(checked.is_none());
        self.latency_us.extend(checked.map(|(_, sent_ns)| (arrived_ns - sent_ns) as f64 / 1e3));
        self.count += 1;
        self.last_ns = now_ns();
    }

    fn report(&self) -> Result<()> {
        let cpu_ns = process_cpu_ns() - self.first_cpu_ns;
        let [p50_us, p99_us] = [0.5, 0.99].map(|q| quantile(&self.latency_us, q).unwrap_or(0.0));
        let report = Report { count: self.count, bad: self.bad, cpu_ns, last_ns: self.last_ns, p50_us, p99_us };
        writeln!(io::stdout(), "{}", serde_json::to_string(&report)?).context("cannot report")
    }
}

/// Whether [`run`], which starts copies of the program that calls it, started this process as a consumer; its work
/// is then done.
///
/// # Errors
/// Those of the consumer.
pub fn is_consumer() -> Result<bool> {
    let Ok(role) = std::env::var(ROLE) else { return Ok(false) };
    consume(&role)?;
    Ok(true)
}

/// Runs the consumer that `role` names: its kind, the bytes of a record, how many of them are read, and the line.
fn consume(role: &str) -> Result<()> {
    let words: Vec<&str> = role.splitn(4, ' ').collect();
    let &[kind, bytes, used, name] = words.as_slice() else {
        bail!("{ROLE} is {role:?}; only this program may set it")
    };
    let number = |word: &str| word.parse::<usize>().with_context(|| format!("{ROLE} is {role:?}"));
    let size = RecordSize { bytes: number(bytes)?, used: number(used)? };
    io::stdout().write_all(STARTED.as_bytes())?;
    let seen = match kind {
        "process" => from_topic(Role::Process, size, name)?,
        "store" => from_topic(Role::Store, size, name)?,
        "stream" => from_stream(size.bytes)?,
        #[cfg(feature = "zeromq")]
        "zeromq" => from_zeromq(name)?,
        _ => bail!("{ROLE} is {role:?}; only this program may set it"),
    };
    seen.report()
}

fn from_topic(role: Role, size: RecordSize, name: &str) -> Result<Seen> {
    let line = Line::join(&LineAddress::at(name.as_ref())?, role, &limits(size.bytes), Arc::default())?;
    let taps = Subscriber::<TapTopic>::open(&line)?;
    let mut seen = Seen::default();
    loop {
        match taps.receive()? {
            Some(tap) if tap.kind() == Some(RecordKind::End) => break,
            Some(tap) => seen.take(bytes_of(&tap).get(..size.used).unwrap_or_default()),
            None => {
                line.wait(Duration::from_millis(100))?;
            }
        }
    }
    seen.bad += taps.lost();
    Ok(seen)
}

fn from_stream(bytes: usize) -> Result<Seen> {
    let mut stream = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    let (mut record, mut seen) = (vec![0_u8; bytes], Seen::default());
    while stream.read_exact(&mut record).is_ok() {
        seen.take(&record);
    }
    Ok(seen)
}

/// What a consumer reports.
#[derive(Debug, Serialize, Deserialize)]
struct Report {
    count: u64,
    bad: u64,
    cpu_ns: u64,
    last_ns: i64,
    p50_us: f64,
    p99_us: f64,
}

fn reported(consumers: Vec<Consumer>) -> Result<[Report; 2]> {
    let mut reports = Vec::new();
    for (mut child, mut printed) in consumers {
        let mut text = String::new();
        printed.read_to_string(&mut text)?;
        let status = child.wait()?;
        ensure!(status.success(), "a consumer failed ({status})");
        reports.push(serde_json::from_str(&text).with_context(|| format!("a consumer reports {text:?}"))?);
    }
    reports.try_into().ok().context("there are two consumers")
}
