//! Tests of the rig, over TCP on loopback.
//!
//! - here: a station at a rig, and a rig whose lines are written by hand
//! - `played`: with a rig that plays a script; `by_hand`: what each says, and when the other is silent
//! - `home`: homing; `heard`: taps that a sound card hears

mod by_hand;
mod heard;
mod home;
mod played;

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;
use std::time::Instant;

use tapline_model::Crack;
use tapline_wire::{Serial, cache_lines_for, now_ns};

use super::dialogue::station::in_words;
use super::*;
use crate::TyreConfig;
use crate::source::unknown_name;

/// Far longer than anything here takes.
const LONG: Duration = Duration::from_secs(30);

fn scan() -> ScanConfig {
    ScanConfig {
        offsets_mm: vec![5.0],
        velocities_m_per_s: vec![1.85],
        repetitions: 1,
        locations: 6,
        shoulders: 1,
        tyre: vec![TyreConfig { serial: "A-1".to_owned(), station: 1, crack: vec![Crack::default()] }],
        ..ScanConfig::default()
    }
}

fn simulation() -> SimulationConfig {
    SimulationConfig { sample_count: 1024, ..SimulationConfig::default() }
}

/// A station at a rig, and what wakes it.
struct Bench {
    arrivals: RigArrivals,
    woken: Receiver<()>,
}

/// How a casing went.
#[derive(Debug, Clone, PartialEq)]
struct Went {
    name: String,
    taps: usize,
    refused: usize,
    gone: Option<String>,
}

impl Bench {
    /// The alarms since the last call.
    fn alarms(&mut self) -> Vec<String> {
        let messages = self.arrivals.take_messages().into_iter();
        messages.filter(|(kind, _)| *kind == RecordKind::Alarm).map(|(_, text)| text).collect()
    }

    fn new(address: String, patience_s: f64, retakes: u16) -> Self {
        let [patience, timeout] = [patience_s, 5.0].map(|seconds| Duration::try_from_secs_f64(seconds).unwrap());
        Self::of(RigConfig { address, patience, timeout, home_timeout: timeout, retakes, ..RigConfig::default() })
    }

    fn of(rig: RigConfig) -> Self {
        let (wake, woken) = sync_channel(1);
        let wake: Wake = Arc::new(move || {
            let _woken_already = wake.try_send(());
        });
        Self {
            arrivals: RigArrivals::open(RigConfig { station: 1, ..rig }, &scan(), &simulation(), wake).unwrap(),
            woken,
        }
    }

    fn pause(&self) {
        let _woken_or_not = self.woken.recv_timeout(Duration::from_millis(200));
    }

    fn casing(&mut self) -> Casing {
        let since = Instant::now();
        loop {
            match self.arrivals.next().unwrap() {
                Arrival::Casing(casing) => return casing,
                Arrival::NotYet => self.pause(),
                Arrival::Ended => panic!("a rig never ends"),
            }
            assert!(since.elapsed() < LONG, "no casing; {}", self.arrivals.waits_for());
        }
    }

    /// Whether the tap comes.
    fn poll(&self, casing: &mut Casing, row: u32) -> Readiness {
        let since = Instant::now();
        loop {
            match casing.taps.poll(row, 0) {
                Readiness::NotYet => self.pause(),
                readiness => return readiness,
            }
            assert!(since.elapsed() < LONG, "no tap; {}", self.arrivals.waits_for());
        }
    }

    /// Waits until `is_so` is true of what the station waits for.
    fn until(&self, is_so: impl Fn(&str) -> bool) {
        let since = Instant::now();
        while !is_so(&self.arrivals.waits_for()) {
            assert!(since.elapsed() < LONG, "{}", self.arrivals.waits_for());
            self.pause();
        }
    }

    /// Asks for a tap until the rig is told to do `command` for it.
    fn until_told(&self, casing: &mut Casing, row: u32, command: &str) {
        let since = Instant::now();
        while !self.arrivals.waits_for().ends_with(&format!(" to {}", in_words(command))) {
            assert_eq!(casing.taps.poll(row, 0), Readiness::NotYet);
            assert!(since.elapsed() < LONG, "not told; {}", self.arrivals.waits_for());
            self.pause();
        }
    }

    /// Takes all taps of the next casing, checks each against the simulated line, and closes it.
    fn scan_one(&mut self) -> Went {
        let mut casing = self.casing();
        let mut went = Went { name: casing.name.clone(), taps: 0, refused: 0, gone: None };
        let mut twin = twin(&casing.name);
        for row in 0..u32::try_from(casing.taps.plan().taps().len()).unwrap() {
            match self.poll(&mut casing, row) {
                Readiness::Ready => {
                    let (header, buffer) = render(&mut *casing.taps, row).unwrap();
                    let (of_twin, want) = render(&mut twin, row).unwrap();
                    assert_eq!((header.id, buffer), (of_twin.id, want));
                    assert!((header.velocity_measured_m_per_s / 1.85 - 1.0).abs() < 0.011);
                    assert!((now_ns() - header.tap_time_ns).abs() < 60_000_000_000);
                    went.taps += 1;
                }
                Readiness::Refused(_) => went.refused += 1,
                Readiness::Gone(why) => {
                    went.gone = Some(why);
                    break;
                }
                Readiness::NotYet => unreachable!(),
            }
        }
        self.arrivals.ended(&casing.name, &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
        went
    }
}

/// The same tyre on a simulated line.
fn twin(name: &str) -> SimulatedLine {
    let mut scan = scan();
    let crack = if name == "A-1" { vec![Crack::default()] } else { Vec::new() };
    scan.tyre = vec![TyreConfig { serial: name.to_owned(), station: 1, crack }];
    SimulatedLine::new(&scan, &simulation()).unwrap()
}

fn render(source: &mut dyn Source, row: u32) -> Result<(TapHeader, Vec<u8>), Refusal> {
    let mut header = TapHeader::default();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(source.plan().recording.payload_bytes_max())];
    source.render(row, 0, &mut header, &mut buffer)?;
    Ok((header, tapline_wire::bytes_of(&buffer)[..header.payload_bytes()].to_vec()))
}

/// A rig whose lines are written by hand.
struct ByHand {
    stream: TcpStream,
    heard: BufReader<TcpStream>,
}

impl ByHand {
    fn accept(listener: &TcpListener) -> Self {
        let stream = listener.accept().unwrap().0;
        stream.set_read_timeout(Some(LONG)).unwrap();
        Self { heard: BufReader::new(stream.try_clone().unwrap()), stream }
    }

    fn say(&mut self, lines: &str) {
        self.stream.write_all(lines.as_bytes()).unwrap();
    }

    /// Answers what must be the command to home with `answer`, and that to move for the tap of `row` comes.
    fn is_homed(&mut self, bench: &Bench, casing: &mut Casing, row: u32, answer: &str) {
        assert_eq!(casing.taps.poll(row, 0), Readiness::NotYet);
        assert_eq!(self.hear(), "home");
        assert!(bench.arrivals.waits_for().ends_with(" to find its home"), "{}", bench.arrivals.waits_for());
        self.say(answer);
        let command = format!("move 1 {row} {} 5", row * 60);
        bench.until_told(casing, row, &command);
        assert_eq!(self.hear(), command);
    }

    fn hear(&mut self) -> String {
        let mut line = String::new();
        self.heard.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }
}

fn by_hand(patience_s: f64) -> (TcpListener, Bench) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let bench = Bench::new(listener.local_addr().unwrap().to_string(), patience_s, 2);
    (listener, bench)
}

/// A rig with the casing `T`, which its station is about to scan.
fn scanning() -> (TcpListener, Bench, ByHand, Casing) {
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let casing = bench.casing();
    (listener, bench, rig, casing)
}

/// Catches two casings of one name, and times that are not those of UTC.
#[test]
fn unknown_casings_have_names() {
    let name = unknown_name(3, 1_795_416_388_500_000_000, "");
    assert_eq!(name, "unknown-3-20261123T064628Z");
    assert_eq!(unknown_name(3, 1_795_416_388_900_000_000, &name), "unknown-3-20261123T064629Z");
    assert!(Serial::new(&unknown_name(u16::MAX, i64::MAX, "")).is_ok());
}

/// Catches a script that is let through although it cannot be played.
#[test]
fn scripts_have_bounds() {
    RigScript::default().validate().unwrap();
    let of = |text: &str| toml::from_str::<RigScript>(text).unwrap().validate().unwrap_err().to_string();
    for (text, want) in [
        ("name = \"\"", "rig.name is \"\""),
        ("pattern = \"A\"", "rig.pattern is \"A\""),
        ("serials = [\"a\\nb\"]", "rig.serials is "),
        ("removed = 1.5", "rig.removed is 1.5; it must be from 0 to 1"),
        ("gap_s = [2.0, 1.0]", "rig.gap_s is 2 to 1"),
        ("hit_s = nan", "rig.hit_s is NaN"),
    ] {
        assert!(of(text).contains(want), "{} lacks {want}", of(text));
    }
}
