//! Taps of a rig that a sound card hears.

use tapline_wire::OVER;

use super::*;
use crate::capture::TriggerConfig;
use crate::capture::fake::{Cable, PRE, RECORD, Step, config, frames, frames_of, record};

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

/// The rig hits, and nothing is heard from frame `from` on: the tap is made again.
fn miss(bench: &Bench, cable: &Cable, rig: &mut ByHand, casing: &mut Casing, from: u64) {
    strike(rig, || cable.play([Step::Frames(frames(from..from + 2000, &[]))]));
    bench.until_told(casing, 0, "move 1 0 0 5");
    assert_eq!(rig.hear(), "move 1 0 0 5");
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
    assert_eq!(cable.ear.take_alarms(), ["fake has lost about 100 samples; any tap in them is lost"]);
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
    bench.until(|waits_for| waits_for == "its hit to be heard");
    assert_eq!(casing.taps.poll(0, 0), Readiness::NotYet, "a stray pulse was taken");
    cable.play([Step::Frames(frames(5000..7000, &[6000]))]);
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    let mut samples = vec![CacheLine::default(); cache_lines_for(config(16).recording().payload_bytes_max())];
    casing.taps.render(0, 0, &mut TapHeader::default(), &mut samples).unwrap();
    assert_eq!(frames_of(&mut samples, 16), record(6000));
}

#[test]
fn a_second_strike_within_the_hold_off_is_reported() {
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
    let told = "casing T: the rig was told to hit once, but was heard more than once";
    let mut alarms = bench.alarms();
    // On a busy machine the rig of the test may take a second.
    alarms.retain(|alarm| !alarm.contains("has not answered"));
    assert_eq!(alarms, [told]);
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
fn a_hit_below_the_trigger_level_is_reported_with_its_height() {
    // Catches a height of what came after the strike, with which people are sent to the cable and not to the trigger level: the rig
    // reports late, and the pulse is older than its report.
    let config = CaptureConfig { trigger: TriggerConfig { level: 0.5, ..config(16).trigger }, ..config(16) };
    let (mut bench, cable, mut rig, mut casing) = heard_bench_of(&config);
    cable.play([Step::Frames(frames(0..1000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    strike(&mut rig, || {
        cable.play([Step::Frames(frames(1000..40_000, &[1500]))]);
        thread::sleep(Duration::from_millis(600));
    });
    let since = Instant::now();
    let told = loop {
        assert_eq!(casing.taps.poll(0, 0), Readiness::NotYet);
        match bench.alarms().into_iter().find(|alarm| alarm.contains("nothing was heard")) {
            Some(told) => break told,
            None => bench.pause(),
        }
        assert!(since.elapsed() < LONG);
    };
    assert!(told.contains("the force rose to 24.4 % of full scale"), "{told}");
    assert!(told.ends_with("the trigger level is 50.0 %"), "{told}");
}

#[test]
fn an_unheard_hit_uses_up_no_try() {
    // Catches a tap that is refused at the first fault of the rig, because the microphone was unplugged before.
    let (bench, cable, mut rig, mut casing) = heard_bench();
    cable.play([Step::Frames(frames(0..1000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    for from in [1000, 3000] {
        miss(&bench, &cable, &mut rig, &mut casing, from);
    }
    rig.say("error no air\n");
    rig.stream.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let (mut told, since) = (String::new(), Instant::now());
    while rig.heard.read_line(&mut told).is_err() {
        assert_eq!(casing.taps.poll(0, 0), Readiness::NotYet);
        assert!(since.elapsed() < LONG);
    }
    assert_eq!(told, "move 1 0 0 5\n");
}

#[test]
fn unheard_hits_are_one_alarm_until_one_is_heard() {
    // Catches an alarm for each hit that a dead force sensor does not hear, and one that stays when it hears again, also where that is
    // on the next casing.
    let (mut bench, cable, mut rig, mut casing) = heard_bench();
    cable.play([Step::Frames(frames(0..1000, &[]))]);
    rig.is_homed(&bench, &mut casing, 0, "homed\n");
    for from in [1000, 3000] {
        miss(&bench, &cable, &mut rig, &mut casing, from);
    }
    // On a busy machine the rig of the test may take a second.
    let unheard = |bench: &mut Bench| -> Vec<String> {
        bench.alarms().into_iter().filter(|alarm| alarm.contains(UNHEARD)).collect()
    };
    let begun = unheard(&mut bench);
    assert!(begun.len() == 1 && begun[0].starts_with(UNHEARD), "{begun:?}");
    rig.say("removed\nerror it was taken away\ncasing U\n");
    assert_eq!(rig.hear(), "scan U 7");
    let mut casing = bench.casing();
    bench.until_told(&mut casing, 0, "move 1 0 0 5");
    assert_eq!(rig.hear(), "move 1 0 0 5");
    miss(&bench, &cable, &mut rig, &mut casing, 5000);
    assert_eq!(unheard(&mut bench), [""; 0]);
    strike(&mut rig, || cable.play([Step::Frames(frames(7000..9000, &[8000]))]));
    assert_eq!(bench.poll(&mut casing, 0), Readiness::Ready);
    assert_eq!(unheard(&mut bench), [format!("{OVER}{}", begun[0])]);
}
