//! Tests of the rig, over TCP on loopback.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;
use std::time::Instant;

use tapline_model::Crack;
use tapline_wire::{cache_lines_for, now_ns};

use super::*;
use crate::TyreConfig;
use crate::capture::TriggerConfig;
use crate::capture::fake::{Cable, PRE, RECORD, Step, config, frames, frames_of, record};
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
    fn new(address: String, patience_s: f64, retakes: u16) -> Self {
        Self::of(&RigConfig { address, patience_s, timeout_s: 5.0, home_timeout_s: 5.0, retakes, device: None })
    }

    fn of(rig: &RigConfig) -> Self {
        let (wake, woken) = sync_channel(1);
        let wake: Wake = Arc::new(move || {
            let _woken_already = wake.try_send(());
        });
        Self { arrivals: RigArrivals::open(rig, 1, &scan(), &simulation(), wake).unwrap(), woken }
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

    /// Asks for a tap until the rig is told to do `command` for it.
    fn until_told(&self, casing: &mut Casing, row: u32, command: &str) {
        let since = Instant::now();
        while !self.arrivals.waits_for().ends_with(&format!(" to {command}")) {
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
        self.arrivals.ended(&casing.name, &CasingEnd::Closed { file: "x.h5".into() });
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

/// Plays `script` to a station that takes `count` casings.
fn played(script: &RigScript, patience_s: f64, count: u64) -> (Vec<Went>, RigReport) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let script = RigScript { casings: Some(count), ..script.clone() };
    thread::scope(|scope| {
        let stop = Arc::new(AtomicBool::new(false));
        let of_rig = Arc::clone(&stop);
        let rig = thread::Builder::new().name("rig".to_owned());
        let rig = rig.spawn_scoped(scope, move || serve_rig(&listener, &script, &of_rig).unwrap()).unwrap();
        // A test that fails here must not wait for the rig for ever.
        struct Stop(Arc<AtomicBool>);
        impl Drop for Stop {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Relaxed);
            }
        }
        let guard = Stop(stop);
        let mut bench = Bench::new(address, patience_s, 2);
        let went = (0..count).map(|_| bench.scan_one()).collect();
        let report = rig.join().unwrap();
        drop(guard);
        (went, report)
    })
}

/// Catches a tap that differs from that of a simulated line, a casing that is left out, and one that is not closed.
#[test]
fn casings_on_a_rig_are_scanned() {
    let script = RigScript { serials: vec!["A-1".to_owned(), "T 2".to_owned()], ..RigScript::default() };
    let (went, report) = played(&script, 30.0, 3);
    let want = |name: &str| Went { name: name.to_owned(), taps: 7, refused: 0, gone: None };
    assert_eq!(went, [want("A-1"), want("T 2"), want("RIG-3")]);
    assert_eq!((report.casings, report.closed, report.hits, report.homed), (3, 3, 21, 1));
}

/// Catches a serial that stops the station, and unknown casings of one name.
#[test]
fn unknown_and_bad_serials_are_passed_over() {
    let serials = ["?", "a/b", "?", "\u{202e}x"].map(str::to_owned).to_vec();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut bench = Bench::new(listener.local_addr().unwrap().to_string(), 30.0, 0);
    let script = RigScript { serials, casings: Some(5), ..RigScript::default() };
    let rig = thread::Builder::new().name("rig".to_owned());
    let rig = rig.spawn(move || serve_rig(&listener, &script, &AtomicBool::new(false)).unwrap()).unwrap();
    let names: Vec<String> = (0..3).map(|_| bench.scan_one().name).collect();
    assert!(names[0].starts_with("unknown-1-20") && names[1].starts_with("unknown-1-20"), "{names:?}");
    assert_ne!(names[0], names[1]);
    assert_eq!(names[2], "RIG-5");
    let report = rig.join().unwrap();
    assert_eq!((report.casings, report.closed, report.refused), (5, 3, 2));
}

/// Catches a rig that is switched off and on losing a casing, one taken away that is waited for, and hits that fail.
#[test]
fn what_goes_wrong_at_a_rig_ends_no_station() {
    let script = RigScript { switched_off: 1.0, off_s: [0.0, 0.05], ..RigScript::default() };
    let (went, report) = played(&script, 30.0, 3);
    assert!(went.iter().all(|went| went.taps == 7 && went.gone.is_none()), "{went:?}");
    assert_eq!((report.switched_off, report.closed), (3, 3));

    let script = RigScript { removed: 1.0, repeated: 0.5, gap_s: [0.0, 0.02], ..RigScript::default() };
    let (went, report) = played(&script, 30.0, 4);
    assert!(went.iter().all(|w| w.gone.as_ref().is_some_and(|why| why.starts_with("it was taken away"))), "{went:?}");
    assert_eq!((report.removed, report.closed), (4, 0));

    let script = RigScript { failed_hits: 1.0, ..RigScript::default() };
    let (went, report) = played(&script, 30.0, 1);
    assert_eq!((went[0].refused, went[0].taps, report.failed_hits), (7, 0, 21), "a try and two more each");
}

/// Catches a casing that goes on after another one, and taps of two casings mixed.
#[test]
fn a_rig_that_is_back_with_another_casing_has_lost_the_first() {
    let script = RigScript { switched_off: 1.0, swapped: 1.0, ..RigScript::default() };
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut bench = Bench::new(listener.local_addr().unwrap().to_string(), 30.0, 0);
    let stop = Arc::new(AtomicBool::new(false));
    let of_rig = Arc::clone(&stop);
    let rig = thread::Builder::new().name("rig".to_owned());
    let rig = rig.spawn(move || serve_rig(&listener, &script, &of_rig).unwrap()).unwrap();
    for number in 1..4 {
        let went = bench.scan_one();
        assert_eq!(went.name, format!("RIG-{number}"));
        assert!(went.gone.unwrap().starts_with("another casing was put on the rig"));
    }
    stop.store(true, Ordering::Relaxed);
    rig.join().unwrap();
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
        assert!(bench.arrivals.waits_for().ends_with(" to home"), "{}", bench.arrivals.waits_for());
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

/// Catches words that are not those of `docs/rig-protocol.md`, and a tap that begins anew although it is there.
#[test]
fn the_words_are_those_of_the_protocol() {
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig-7 1\ncasing T 1\r\n");
    assert_eq!(rig.hear(), "scan T 1 7");
    let mut casing = bench.casing();
    rig.is_homed(&bench, &mut casing, 2, "homed\n");
    assert_eq!(casing.taps.poll(2, 0), Readiness::NotYet);
    assert!(bench.arrivals.waits_for().ends_with(" to move 1 2 120 5"), "{}", bench.arrivals.waits_for());
    assert!(render(&mut *casing.taps, 2).unwrap_err().reason.contains("has not made this tap"));
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    rig.say("hit 1.84\n");
    assert_eq!(bench.poll(&mut casing, 2), Readiness::Ready);
    assert!((render(&mut *casing.taps, 2).unwrap().0.velocity_measured_m_per_s - 1.84).abs() < 1e-12);
    rig.say("casing T 1\n");
    assert_eq!(rig.hear(), "error casing T 1 is on the rig already");
    assert_eq!(bench.poll(&mut casing, 2), Readiness::Ready, "it was made");
    bench.arrivals.ended("T 1", &CasingEnd::Refused { reason: "no\nroom".to_owned() });
    assert_eq!(rig.hear(), "refused T 1 no room");
    // The same serial again is another casing, but not when the rig did not hear that the first is closed.
    rig.say("removed\ncasing T 1\n");
    assert_eq!(rig.hear(), "scan T 1 7");
    let second = bench.casing();
    drop(rig);
    let since = Instant::now();
    while !bench.arrivals.waits_for().contains("went away") {
        bench.pause();
        assert!(since.elapsed() < LONG);
    }
    bench.arrivals.ended(&second.name, &CasingEnd::Closed { file: "x.h5".into() });
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig-7 1\ncasing T 1\n");
    assert_eq!(rig.hear(), "closed T 1");
}

/// Catches the end of a casing that is lost with the connection: the rig would wait for a scan that is over.
#[test]
fn an_end_that_may_not_have_arrived_is_reported_again() {
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let casing = bench.casing();
    bench.arrivals.ended(&casing.name, &CasingEnd::Closed { file: "x.h5".into() });
    assert_eq!(rig.hear(), "closed T");
    drop(rig); // it has answered nothing since
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "closed T");
    rig.say("casing T\n");
    assert_eq!(rig.hear(), "scan T 7", "it was reported: the same serial is a new casing");
}

/// Catches a rig that is away for ever being waited for as long.
#[test]
fn patience_ends() {
    let (listener, mut bench) = by_hand(0.05);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    let mut casing = bench.casing();
    assert_eq!(casing.taps.poll(0, 0), Readiness::NotYet);
    drop(rig);
    let Readiness::Gone(why) = bench.poll(&mut casing, 0) else { panic!("not gone") };
    assert_eq!(why, "the rig was away for more than 0.05 s");
    // People hear of it at once, not when patience ends.
    let alarms = bench.arrivals.take_alarms();
    assert!(alarms[0].starts_with("casing T: the rig is away: "), "{alarms:?}");
    assert_eq!(alarms[1..], ["casing T: the rig was away for more than 0.05 s"]);
    // It comes back with nothing, and then with the same casing: that is scanned anew.
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let mut again = bench.casing();
    rig.is_homed(&bench, &mut again, 0, "homed\n");
    bench.arrivals.ended("T", &CasingEnd::Closed { file: "x.h5".into() });
    rig.say("ready\n");
    assert_eq!(casing.taps.poll(0, 0), Readiness::Gone(why));
    assert_eq!(rig.hear(), "hit 1.85", "the second is not what ended");
}

/// Catches a rig that sends anything at all being listened to for ever.
#[test]
fn rigs_that_send_garbage_are_cut_off() {
    let (listener, bench) = by_hand(30.0);
    let flood = "casing A\nremoved\n".repeat(50);
    let long = "x".repeat(1000);
    for (says, want) in [
        ("good day\n", "the rig has said \"good day\", which means nothing here"),
        ("ready\n", "the rig has said \"ready\" before hello"),
        ("hello rig 2\n", "the rig speaks version 2 of the protocol; this station speaks 1"),
        ("hello rig 1\nready\n", "the rig has said \"ready\" unasked"),
        ("hello rig 1\nhit 1e9\n", "the rig has said \"hit 1e9\", which means nothing here"),
        (&*format!("hello rig 1\n{flood}"), "the rig has said more than 20 lines unasked within a second"),
        (&*long, "the rig has sent a line of more than 256 bytes"),
    ] {
        let mut rig = ByHand::accept(&listener);
        rig.say(says);
        let mut heard = BTreeMap::new();
        // A connection that is cut off may end with a reset.
        let mut line = String::new();
        while rig.heard.read_line(&mut line).is_ok_and(|count| count > 0) {
            *heard.entry(std::mem::take(&mut line)).or_insert(0) += 1;
        }
        let since = Instant::now();
        while !bench.arrivals.waits_for().contains(want) {
            bench.pause();
            assert!(since.elapsed() < LONG, "{:?} lacks {want:?} after {heard:?}", bench.arrivals.waits_for());
        }
    }
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

#[test]
fn a_rig_at_a_serial_port_is_asked_who_it_is() {
    // Catches a port that waits for a greeting, one that is opened again for noise while a board starts, which then starts again,
    // lines that are cut, and a rig that is gone and is not told.
    use serialport::SerialPort as _;

    let (rig, port) = serialport::TTYPort::pair().unwrap();
    let address = format!("serial:{}", port.name().unwrap());
    drop(port);
    let played = thread::Builder::new().name("rig".to_owned()).spawn(move || {
        let mut rig = rig;
        rig.set_timeout(LONG).unwrap();
        let mut noise = rig.try_clone_native().unwrap();
        let mut lines = BufReader::new(rig.try_clone_native().unwrap()).lines();
        // Nothing can be read before the station has opened its end.
        let mut next = || lines.find_map(Result::ok).unwrap();
        let mut say = |line: &str| rig.write_all(format!("{line}\n").as_bytes()).unwrap();
        assert_eq!(next(), "hello");
        noise.write_all(b"\xff\xfe\x80 boot\n\xc0\n").unwrap();
        say("hello press 1");
        say("casing A-1");
        assert_eq!(next(), "scan A-1 7");
        loop {
            let line = next();
            match line.split(' ').next().unwrap() {
                "home" => say("homed"),
                "move" => say("ready"),
                "hit" => say("hit 1.85"),
                "closed" => break,
                _ => panic!("{line}"),
            }
        }
        say("removed");
    });
    let mut bench = Bench::new(address, 30.0, 0);
    let went = bench.scan_one();
    assert_eq!((went.name.as_str(), went.taps, went.refused, went.gone), ("A-1", 7, 0, None));
    played.unwrap().join().unwrap();
    let since = Instant::now();
    while !bench.arrivals.waits_for().contains("the rig at serial:") {
        assert!(since.elapsed() < LONG, "{}", bench.arrivals.waits_for());
        bench.pause();
    }
}

/// Catches a hit that is not answered and not reported before the connection is given up, a report that is repeated, and one of
/// an answer that comes at once.
#[test]
fn a_hit_that_is_not_answered_is_an_alarm() {
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig-7 1\ncasing T 1\r\n");
    assert_eq!(rig.hear(), "scan T 1 7");
    let mut casing = bench.casing();
    rig.is_homed(&bench, &mut casing, 2, "homed\n");
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    assert_eq!(bench.arrivals.take_alarms(), [""; 0]);
    let since = Instant::now();
    let mut alarms = Vec::new();
    while alarms.is_empty() {
        assert!(since.elapsed() < LONG, "no alarm");
        bench.pause();
        alarms = bench.arrivals.take_alarms();
    }
    assert_eq!(alarms, ["the rig has not answered \"hit 1.85\" for 1s"]);
    rig.say("hit 1.84\n");
    assert_eq!(bench.poll(&mut casing, 2), Readiness::Ready, "late is not lost");
    assert_eq!(bench.arrivals.take_alarms(), [""; 0]);
}

#[test]
fn a_rig_that_never_does_what_it_is_told_is_an_alarm() {
    // Catches a rig that connects anew and homes, and does not move, or does not home: for ever, and nobody is told; an alarm
    // for each time, and one of a rig that answers in between.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let mut bench = Bench::new(address, 30.0, 0);
    let mut alarms = Vec::new();
    let mut casing = None;
    // Whether it answers `home` and `move` before it is gone.
    let times =
        [(true, false), (true, true), (true, false), (true, false), (true, false), (true, false), (false, false)];
    for (homes, moves) in times.into_iter().chain([(false, false); 3]) {
        let mut rig = ByHand::accept(&listener);
        rig.say("hello rig 1\ncasing T\n");
        assert_eq!(rig.hear(), "scan T 7");
        let casing = casing.get_or_insert_with(|| bench.casing());
        bench.until_told(casing, 0, "home");
        assert_eq!(rig.hear(), "home");
        if homes {
            rig.say("homed\n");
            bench.until_told(casing, 0, "move 1 0 0 5");
        }
        if moves {
            assert_eq!(rig.hear(), "move 1 0 0 5");
            rig.say("ready\n");
            assert_eq!(rig.hear(), "hit 1.85");
        }
        drop(rig);
        let since = Instant::now();
        while !bench.arrivals.waits_for().contains("which went away") {
            assert!(since.elapsed() < LONG, "{}", bench.arrivals.waits_for());
            bench.pause();
        }
        let (away, other): (Vec<_>, Vec<_>) = bench
            .arrivals
            .take_alarms()
            .into_iter()
            .partition(|alarm| alarm.starts_with("casing T: the rig is away: "));
        assert_eq!(away.len(), 1, "{away:?}");
        alarms.push(other);
    }
    let told = |what: &str, command: &str| {
        vec![format!("the rig does not {what}: it was told {command:?} 3 times in a row, and has not answered")]
    };
    let mut want = vec![Vec::new(); 10];
    want[4] = told("move", "move 1 0 0 5");
    want[8] = told("home", "home");
    assert_eq!(alarms, want);
}

#[test]
fn a_rig_that_is_stopped_makes_its_taps_when_it_goes_on() {
    // Catches a stop that is taken for a fault of the tap, and a tap that is commanded while people are at the rig.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let script = RigScript {
        casings: Some(1),
        serials: vec!["A-1".to_owned()],
        stopped: 1.0,
        off_s: [0.5, 0.5],
        ..RigScript::default()
    };
    let played = thread::Builder::new()
        .name("rig".to_owned())
        .spawn(move || serve_rig(&listener, &script, &AtomicBool::new(false)).unwrap());
    let mut bench = Bench::new(address, 30.0, 0);
    let went = bench.scan_one();
    assert_eq!((went.taps, went.refused, went.gone), (7, 0, None));
    assert_eq!(bench.arrivals.take_alarms(), ["the rig is stopped: emergency stop"]);
    let report = played.unwrap().join().unwrap();
    assert_eq!((report.stopped, report.closed, report.homed), (1, 1, 2));
}

/// A station that hears its rig through a cable, and a rig whose casing it has taken over.
fn heard_bench() -> (Bench, Cable, ByHand, Casing) {
    heard_bench_of(&config(16))
}

fn heard_bench_of(config: &CaptureConfig) -> (Bench, Cable, ByHand, Casing) {
    let (listener, mut bench) = by_hand(30.0);
    let cable = Cable::new(config);
    bench.arrivals.ear = Some(Arc::clone(&cable.ear));
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let casing = bench.casing();
    (bench, cable, rig, casing)
}

/// Hits when it is told to, and reports the hit once `play` has played it.
fn strike(rig: &mut ByHand, play: impl FnOnce()) {
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    // Longer than what is played lasts: all of it was heard after the command.
    thread::sleep(Duration::from_millis(100));
    play();
    rig.say("hit 1.85\n");
}

#[test]
fn a_tap_in_a_gap_is_made_again() {
    // Catches a tap of which half was lost and that is taken, or given up.
    let (bench, cable, mut rig, mut casing) = heard_bench();
    cable.play([Step::Frames(frames(0..1000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    let gap = [Step::Frames(frames(1000..1700, &[1500])), Step::Lost(100), Step::Frames(frames(1800..2800, &[]))];
    strike(&mut rig, || cable.play(gap));
    let again = thread::Builder::new().name("rig".to_owned()).spawn(move || {
        assert_eq!(rig.hear(), "move 1 0 0 5");
        strike(&mut rig, || cable.play([Step::Frames(frames(2800..4800, &[4000]))]));
        (rig, cable)
    });
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    let mut samples = vec![CacheLine::default(); cache_lines_for(config(16).recording().payload_bytes_max())];
    casing.taps.render(0, 0, &mut TapHeader::default(), &mut samples).unwrap();
    assert_eq!(frames_of(&mut samples, 16), record(4000));
    let (_rig, cable) = again.unwrap().join().unwrap();
    assert_eq!(cable.ear.take_alarms(), ["fake has lost about 100 samples; a tap in them is not there"]);
}

#[test]
fn a_pulse_from_before_the_command_is_not_its_tap() {
    // Catches a stray pulse between move and hit that is taken for the tap: one that is heard at once, and one whose samples were
    // read late, when the rig had been told to hit.
    let (bench, cable, mut rig, mut casing) = heard_bench();
    cable.play([Step::Frames(frames(0..1000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    cable.play([Step::Frames(frames(1000..3000, &[2000]))]);
    // Half a second of samples waits behind those with the stray pulse.
    strike(&mut rig, || cable.play([Step::Late(frames(3000..5000, &[4000]), 20_480)]));
    let since = Instant::now();
    while bench.arrivals.waits_for() != "its hit to be heard" {
        assert!(since.elapsed() < LONG, "no hit; {}", bench.arrivals.waits_for());
        bench.pause();
    }
    assert_eq!(casing.taps.poll(0, 0), Readiness::NotYet, "a stray pulse was taken");
    cable.play([Step::Frames(frames(5000..7000, &[6000]))]);
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    let mut samples = vec![CacheLine::default(); cache_lines_for(config(16).recording().payload_bytes_max())];
    casing.taps.render(0, 0, &mut TapHeader::default(), &mut samples).unwrap();
    assert_eq!(frames_of(&mut samples, 16), record(6000));
}

#[test]
fn a_second_strike_within_the_hold_off_is_told() {
    // Catches a rig that hits twice, the second time behind the record, and whose tap is taken as if it had hit once; and a
    // rebound within the record, or a click behind it, that is taken for a second strike.
    let config = CaptureConfig { trigger: TriggerConfig { hold_off_s: 0.03, ..config(16).trigger }, ..config(16) };
    let (bench, cable, mut rig, mut casing) = heard_bench_of(&config);
    cable.play([Step::Frames(frames(0..1000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    // The record of a tap ends 300 frames after it, its hold-off after 1229.
    strike(&mut rig, || cable.play([Step::Frames(frames(1000..4000, &[1500, 2300]))]));
    let again = thread::Builder::new().name("rig".to_owned()).spawn(move || {
        assert_eq!(rig.hear(), "move 1 0 0 5");
        let mut once = frames(4000..7000, &[4500, 4700]);
        once[1000][0] = 8000;
        strike(&mut rig, || cable.play([Step::Frames(once)]));
        (rig, cable)
    });
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    let mut samples = vec![CacheLine::default(); cache_lines_for(config.recording().payload_bytes_max())];
    casing.taps.render(0, 0, &mut TapHeader::default(), &mut samples).unwrap();
    let first = 4501 - PRE;
    assert_eq!(frames_of(&mut samples, 16), frames(first..first + RECORD, &[4500, 4700]));
    let (_rig, _cable) = again.unwrap().join().unwrap();
    let mut bench = bench;
    let told = "casing T: the rig was told to hit once, and was heard more than once";
    assert_eq!(bench.arrivals.take_alarms(), [told]);
}

#[test]
fn no_hit_is_asked_for_while_the_device_is_not_heard() {
    // Catches a rig that hits while nobody listens, and one that is not told to go on.
    let (bench, cable, mut rig, mut casing) = heard_bench();
    cable.play([Step::Frames(frames(0..1000, &[])), Step::Fails("it was pulled out")]);
    // Once it cannot be opened either, the ear has said so.
    cable.play([Step::Fails("it is not there"), Step::Opens]);
    assert_eq!(casing.taps.poll(0, 0), Readiness::NotYet);
    assert!(bench.arrivals.waits_for().contains("fake is not heard"), "{}", bench.arrivals.waits_for());
    rig.stream.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    let mut line = String::new();
    assert!(rig.heard.read_line(&mut line).is_err() && line.is_empty(), "{line:?}");
    rig.stream.set_read_timeout(Some(LONG)).unwrap();
    cable.play([Step::Frames(frames(1000..2000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
}

#[test]
fn a_rig_is_homed_before_it_moves_and_after_it_was_stopped() {
    // Catches a rig that moves before it knows where it is, a stop after which it is taken to know it still, and an answer from
    // before the stop that counts.
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let mut casing = bench.casing();
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    rig.say("hit 1.85\n");
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    // It stays homed.
    bench.until_told(&mut casing, 1, "move 1 1 60 5");
    assert_eq!(rig.hear(), "move 1 1 60 5");
    rig.say("stopped door\nrunning\n");
    bench.until_told(&mut casing, 1, "home");
    assert_eq!(rig.hear(), "home");
    rig.say("stopped door\nhomed\nrunning\n");
    let since = Instant::now();
    while bench.arrivals.waits_for().ends_with(" to home") {
        bench.pause();
        assert!(since.elapsed() < LONG);
    }
    bench.until_told(&mut casing, 1, "home");
    rig.is_homed(&bench, &mut casing, 1, "homed\n");
}

#[test]
fn a_rig_without_a_home_is_used_as_it_is() {
    // Catches a rig that does not know the command and is asked for ever, or whose casing is given up.
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let mut casing = bench.casing();
    rig.is_homed(&bench, &mut casing, 0, "error home is no command\n");
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    rig.say("hit 1.85\n");
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    bench.until_told(&mut casing, 1, "move 1 1 60 5");
}

#[test]
fn a_rig_may_take_its_own_time_to_home_and_no_more() {
    // Catches a rig that homes slowly and is cut off, and one that never answers and is waited for.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let times = |timeout_s, home_timeout_s| RigConfig {
        address: address.clone(),
        patience_s: 30.0,
        timeout_s,
        home_timeout_s,
        retakes: 0,
        device: None,
    };
    for (rig, is_patient) in [(times(0.2, 30.0), true), (times(30.0, 0.2), false)] {
        let mut bench = Bench::of(&rig);
        let mut rig = ByHand::accept(&listener);
        rig.say("hello rig 1\ncasing T\n");
        assert_eq!(rig.hear(), "scan T 7");
        let mut casing = bench.casing();
        assert_eq!((casing.taps.poll(0, 0), rig.hear()), (Readiness::NotYet, "home".to_owned()));
        if is_patient {
            // Longer than it takes to look at the time.
            thread::sleep(Duration::from_millis(1200));
            rig.say("homed\n");
            bench.until_told(&mut casing, 0, "move 1 0 0 5");
        } else {
            assert_eq!(rig.hear(), "", "it is still connected");
        }
    }
}
