//! A station at a rig that plays a script.

use std::sync::atomic::{AtomicBool, Ordering};

use super::*;

/// Plays `script`, of `count` casings if it does not say how many, to a station that takes `count`.
fn played(script: &RigScript, count: u64) -> (Vec<Went>, RigReport) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let script = RigScript { casings: script.casings.or(Some(count)), ..script.clone() };
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
        let mut bench = Bench::new(address, 30.0, 2);
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
    let (went, report) = played(&script, 3);
    let want = |name: &str| Went { name: name.to_owned(), taps: 7, refused: 0, gone: None };
    assert_eq!(went, [want("A-1"), want("T 2"), want("RIG-3")]);
    assert_eq!((report.casings, report.closed, report.hits, report.homed), (3, 3, 21, 1));
}

/// Catches a serial that stops the station, and unknown casings of one name.
#[test]
fn unknown_and_bad_serials_are_passed_over() {
    let serials = ["?", "a/b", "?", "\u{202e}x"].map(str::to_owned).to_vec();
    let (went, report) = played(&RigScript { serials, casings: Some(5), ..RigScript::default() }, 3);
    let names: Vec<&str> = went.iter().map(|went| went.name.as_str()).collect();
    assert!(names[0].starts_with("unknown-1-20") && names[1].starts_with("unknown-1-20"), "{names:?}");
    assert_ne!(names[0], names[1]);
    assert_eq!(names[2], "RIG-5");
    assert_eq!((report.casings, report.closed, report.refused), (5, 3, 2));
}

/// Catches a rig that is switched off and on losing a casing, one taken away that is waited for, and hits that fail.
#[test]
fn what_goes_wrong_at_a_rig_ends_no_station() {
    let script = RigScript { switched_off: 1.0, off_s: [0.0, 0.05], ..RigScript::default() };
    let (went, report) = played(&script, 3);
    assert!(went.iter().all(|went| went.taps == 7 && went.gone.is_none()), "{went:?}");
    assert_eq!((report.switched_off, report.closed), (3, 3));

    let script = RigScript { removed: 1.0, repeated: 0.5, gap_s: [0.0, 0.02], ..RigScript::default() };
    let (went, report) = played(&script, 4);
    assert!(went.iter().all(|w| w.gone.as_ref().is_some_and(|why| why.starts_with("it was taken away"))), "{went:?}");
    assert_eq!((report.removed, report.closed), (4, 0));

    let script = RigScript { failed_hits: 1.0, ..RigScript::default() };
    let (went, report) = played(&script, 1);
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
    assert_eq!(bench.alarms(), ["the rig is stopped: emergency stop", "over: the rig is stopped: emergency stop"]);
    let report = played.unwrap().join().unwrap();
    assert_eq!((report.stopped, report.closed, report.homed), (1, 1, 2));
}
