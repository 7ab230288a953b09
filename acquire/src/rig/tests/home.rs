//! A rig is homed before it moves.

use super::*;

#[test]
fn a_rig_is_homed_before_it_moves_and_after_it_was_stopped() {
    // Catches a rig that moves before it knows where it is, a stop after which it is taken to know it still, and an answer from
    // before the stop that counts.
    let (_listener, bench, mut rig, mut casing) = scanning();
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    rig.say("hit 1.85\n");
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    // It stays homed.
    bench.until_told(&mut casing, 1, "move 1 1 60 5");
    assert_eq!(rig.hear(), "move 1 1 60 5");
    rig.say("stopped door\n");
    bench.until(|waits_for| waits_for.ends_with("it is stopped (door)"));
    assert_eq!((bench.arrivals.fault(), bench.arrivals.stopped().as_deref()), (None, Some("door")));
    rig.say("running\n");
    bench.until_told(&mut casing, 1, "home");
    assert_eq!(rig.hear(), "home");
    rig.say("stopped door\nhomed\nrunning\n");
    bench.until(|waits_for| !waits_for.ends_with(" to find its home"));
    bench.until_told(&mut casing, 1, "home");
    rig.is_homed(&bench, &mut casing, 1, "homed\n");
}

#[test]
fn a_rig_without_a_home_is_used_as_it_is() {
    // Catches a rig that does not know the command and is asked for ever, or whose casing is given up.
    let (_listener, bench, mut rig, mut casing) = scanning();
    rig.is_homed(&bench, &mut casing, 0, "error home is no command\n");
    rig.say("ready\n");
    assert_eq!(rig.hear(), "hit 1.85");
    rig.say("hit 1.85\n");
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    bench.until_told(&mut casing, 1, "move 1 1 60 5");
}

#[test]
fn a_casing_that_may_have_been_turned_is_given_up() {
    // Catches a casing that goes on after a stop during which somebody may have turned it, or on a rig that has lost its place and cannot
    // find its home; one that is given up before its first tap; and a rig that is not told how such a casing has ended.
    let hit = |bench: &Bench, rig: &mut ByHand, casing: &mut Casing, home: &str| {
        rig.is_homed(bench, casing, 0, home);
        rig.say("ready\n");
        assert_eq!(rig.hear(), "hit 1.85");
        rig.say("hit 1.85\n");
        assert_eq!(bench.poll(casing, 0), Readiness::Ready);
    };
    // A patience of nothing: every stop is longer.
    let (listener, mut bench) = by_hand(0.0);
    let mut rig = ByHand::accept(&listener);
    rig.say("hello rig 1\ncasing T\n");
    assert_eq!(rig.hear(), "scan T 7");
    let mut casing = bench.casing();
    let stop = |bench: &Bench, rig: &mut ByHand| {
        rig.say("stopped door\n");
        bench.until(|waits_for| waits_for.contains("door"));
        rig.say("running\n");
        bench.until(|waits_for| !waits_for.contains("door"));
    };
    stop(&bench, &mut rig);
    hit(&bench, &mut rig, &mut casing, "homed\n");
    stop(&bench, &mut rig);
    let gone = |readiness| matches!(readiness, Readiness::Gone(why) if why.contains("may have been turned"));
    assert!(gone(bench.poll(&mut casing, 1)));
    bench.arrivals.ended(&casing.name, &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
    assert_eq!(rig.hear(), "closed T");

    let (_listener, bench, mut rig, mut casing) = scanning();
    hit(&bench, &mut rig, &mut casing, "error home is no command\n");
    stop(&bench, &mut rig);
    bench.until_told(&mut casing, 1, "home");
    assert_eq!(rig.hear(), "home");
    rig.say("error home is no command\n");
    assert!(gone(bench.poll(&mut casing, 1)));
}

#[test]
fn a_rig_may_take_its_own_time_to_home_and_no_more() {
    // Catches a rig that homes slowly and is cut off, and one that never answers and is waited for.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let times = |timeout_ms, home_timeout_ms| RigConfig {
        address: address.clone(),
        patience: LONG,
        timeout: Duration::from_millis(timeout_ms),
        home_timeout: Duration::from_millis(home_timeout_ms),
        ..RigConfig::default()
    };
    for (rig, is_patient) in [(times(200, 30_000), true), (times(30_000, 200), false)] {
        let mut bench = Bench::of(rig);
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
