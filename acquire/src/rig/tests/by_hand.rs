//! What station and rig say to each other, and when one of them is silent.

use std::collections::BTreeMap;

use tapline_wire::OVER;

use super::*;

/// Catches words that are not those of `docs/rig-protocol.md`, a refused casing that is said to be done, and a tap that begins anew although it is there.
#[test]
fn the_words_are_those_of_the_protocol() {
    let (listener, mut bench) = by_hand(30.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig-7 1\ncasing T 1\r\n");
    assert_eq!(rig.hear(), "scan T 1 7");
    let mut casing = bench.casing();
    rig.is_homed(&bench, &mut casing, 2, "homed\n");
    assert_eq!(casing.taps.poll(2, 0), Readiness::NotYet);
    let waits_for = bench.arrivals.waits_for();
    let want = " to move to location 2 (120°) of shoulder 1, 5 mm from the belt edge";
    assert!(waits_for.ends_with(want), "{waits_for}");
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
    assert!(bench.arrivals.waits_for().ends_with(": T 1 was refused"), "{}", bench.arrivals.waits_for());
    // The same serial again is another casing, but not when the rig did not hear that the first is closed.
    rig.say("removed\ncasing T 1\n");
    assert_eq!(rig.hear(), "scan T 1 7");
    let second = bench.casing();
    drop(rig);
    bench.until(|waits_for| waits_for.contains("went away"));
    bench.arrivals.ended(&second.name, &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig-7 1\ncasing T 1\n");
    assert_eq!(rig.hear(), "closed T 1");
}

/// Catches the end of a casing that is lost with the connection: the rig would wait for a scan that is over.
#[test]
fn an_end_that_may_not_have_arrived_is_reported_again() {
    let (listener, mut bench, mut rig, casing) = scanning();
    bench.arrivals.ended(&casing.name, &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
    assert_eq!(rig.hear(), "closed T");
    assert!(bench.arrivals.waits_for().ends_with(": T is done"), "{}", bench.arrivals.waits_for());
    drop(rig); // it has answered nothing since
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "closed T");
    rig.say("casing T\n");
    assert_eq!(rig.hear(), "scan T 7", "it was reported: the same serial is a new casing");
}

/// Catches a casing that is done and scanned again, because its rig connects again or the line starts anew while it is still there.
#[test]
fn a_casing_that_is_done_is_not_scanned_again() {
    let folder = tempfile::tempdir().unwrap();
    let last_end = folder.path().join(".rig-1");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let [patience, timeout] = [30, 5].map(Duration::from_secs);
    let address = listener.local_addr().unwrap().to_string();
    let last = Some(last_end.clone());
    let config =
        RigConfig { address, patience, timeout, home_timeout: timeout, last_end: last, ..RigConfig::default() };
    let mut bench = Bench::of(config.clone());
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T 1\n");
    assert_eq!(rig.hear(), "scan T 1 7");
    let casing = bench.casing();
    bench.arrivals.ended(&casing.name, &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
    assert_eq!(rig.hear(), "closed T 1");
    for _ in 0..3 {
        rig.say("pong\n");
        drop(rig);
        rig = ByHand::accept(&listener);
        rig.say("hello rig 1\ncasing T 1\n");
        assert_eq!(rig.hear(), "closed T 1");
    }
    drop((rig, bench));
    // As the line writes it.
    std::fs::write(&last_end, "T 1").unwrap();
    let mut bench = Bench::of(config);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T 1\n");
    assert_eq!(rig.hear(), "closed T 1");
    rig.say("removed\ncasing T 1\n");
    assert_eq!(rig.hear(), "scan T 1 7", "it was taken off: it is to be scanned again");
    assert!(!last_end.exists(), "the next line is to scan it too");
    assert_eq!(bench.arrivals.take_messages(), [(RecordKind::Removed, String::new())]);
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
    assert_eq!(why, "the rig was stopped or away for more than 0.05 s");
    // People hear of it at once, not when patience ends.
    let alarms = bench.alarms();
    assert!(alarms[0].starts_with("casing T: the connection to the rig is lost: "), "{alarms:?}");
    assert_eq!(alarms[1..], ["casing T: the rig was stopped or away for more than 0.05 s"]);
    // It comes back with nothing, and then with the same casing: that is scanned anew.
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let mut again = bench.casing();
    rig.is_homed(&bench, &mut again, 0, "homed\n");
    bench.arrivals.ended("T", &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
    rig.say("ready\n");
    assert_eq!(casing.taps.poll(0, 0), Readiness::Gone(why));
    assert_eq!(rig.hear(), "hit 1.85", "the second is not what ended");
}

/// Catches a rig that sends anything at all being listened to for ever.
#[test]
fn rigs_that_send_garbage_are_cut_off() {
    let (listener, bench) = by_hand(30.0);
    let flood = "casing A\nremoved\n".repeat(100);
    let long = "x".repeat(1000);
    let late = "ready\n".repeat(101);
    let errors = "error x\n".repeat(101);
    for (says, want) in [
        ("good day\n", "the rig has said \"good day\", which is not in the protocol"),
        ("ready\n", "the rig has said \"ready\" before hello"),
        ("hello rig 2\n", "the rig speaks version 2 of the protocol; this station speaks 1"),
        ("hello rig 1\nready\n", "the rig has said \"ready\" unexpectedly"),
        ("hello rig 1\nhit 1e9\n", "the rig has said \"hit 1e9\", which is not in the protocol"),
        (&*format!("hello rig 1\n{flood}"), "the rig has sent more than 100 unexpected lines within a second"),
        (
            &*format!("hello rig 1\nstopped x\n{late}"),
            "the rig has sent more than 100 unexpected lines within a second",
        ),
        (&*format!("hello rig 1\n{errors}"), "the rig has sent more than 100 unexpected lines within a second"),
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
        bench.until(|waits_for| waits_for.contains(want));
    }
}

/// Catches a rig whose reader flickers, and which fills the disk with casings, or the page with alarms.
#[test]
fn rigs_that_announce_too_much_are_cut_off() {
    let (listener, bench) = by_hand(30.0);
    for _ in 0..2 {
        let mut rig = ByHand::accept(&listener);
        rig.say("hello rig 1\n");
        for number in 0..61 {
            rig.say(&format!("casing A-{number}\n"));
            // The second connection ends at the last one.
            if rig.heard.read_line(&mut String::new()).is_ok_and(|count| count == 0) {
                break;
            }
        }
    }
    bench.until(|waits_for| waits_for.contains("more than 120 casings and stops within a minute"));
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
    bench.until(|waits_for| waits_for.contains("the rig at serial:"));
}

/// Catches a hit that is not answered and not reported before the connection is given up, a report that is repeated, and one of
/// an answer that comes at once.
#[test]
fn a_hit_that_is_not_answered_is_an_alarm() {
    let (_listener, mut bench, mut rig, mut casing) = scanning();
    rig.is_homed(&bench, &mut casing, 2, "homed\n");
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    assert_eq!(bench.alarms(), [""; 0]);
    let since = Instant::now();
    let mut alarms = Vec::new();
    while alarms.is_empty() {
        assert!(since.elapsed() < LONG, "no alarm");
        bench.pause();
        alarms = bench.alarms();
    }
    assert_eq!(alarms, ["the rig has not answered \"hit 1.85\" for 1s"]);
    rig.say("hit 1.84\n");
    assert_eq!(bench.poll(&mut casing, 2), Readiness::Ready, "late is not lost");
    assert_eq!(bench.alarms(), [""; 0]);
}

#[test]
fn a_rig_that_never_obeys_is_an_alarm() {
    // Catches a rig that connects anew and homes, and does not move, or does not home: for ever, and nobody is told; an alarm
    // for each time, and one of a rig that answers in between.
    let (listener, mut bench) = by_hand(30.0);
    let (mut alarms, mut away_count, mut over_count) = (Vec::new(), 0, 0);
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
        bench.until(|waits_for| waits_for.contains("which went away"));
        let all = bench.alarms();
        let (away, other): (Vec<_>, Vec<_>) =
            all.into_iter().partition(|alarm| alarm.contains("casing T: the connection to the rig is lost: "));
        over_count += away.iter().filter(|alarm| alarm.starts_with(OVER)).count();
        away_count += away.len();
        alarms.push(other);
    }
    // No tap was made: that is said once, and not that it is over.
    assert_eq!((away_count, over_count), (1, 0));
    let told = |what: &str, command: &str| {
        vec![format!("the rig does not {what}: it was sent {command:?} 3 times in a row and has not answered")]
    };
    let mut want = vec![Vec::new(); 10];
    want[4] = told("move", "move 1 0 0 5");
    want[8] = told("home", "home");
    assert_eq!(alarms, want);
}

#[test]
fn a_tap_that_the_rig_cannot_make_is_an_alarm() {
    // Catches a broken rig whose taps are refused one by one, and nobody is told; and an alarm for each of them.
    let (_listener, mut bench, mut rig, mut casing) = scanning();
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    for row in 0..2 {
        // The bench tries a failed move twice again.
        let rest = if row == 0 { 2 } else { 3 };
        let answer = thread::Builder::new().name("rig".to_owned()).spawn(move || {
            if row == 0 {
                rig.say("error the spring is broken\n");
            }
            for _ in 0..rest {
                assert!(rig.hear().starts_with("move "));
                rig.say("error the spring is broken\n");
            }
            rig
        });
        let Readiness::Refused(refusal) = bench.poll(&mut casing, row) else { panic!("not refused") };
        assert!(refusal.reason.contains("the spring is broken"), "{}", refusal.reason);
        rig = answer.unwrap().join().unwrap();
    }
    let want = "casing T: the rig cannot make this tap: the spring is broken";
    assert_eq!(bench.alarms(), [want]);
}
