//! What an ear makes of a device that loses samples, fails and comes back.

use super::*;
use crate::capture::fake::{Cable, Frame, PRE, Step, config, frames, heard, record};

/// The records of all taps that can be taken.
fn taken(ear: &Ear) -> Vec<Vec<Frame>> {
    std::iter::from_fn(|| ear.take_tap()).map(|tap| heard(ear, tap)).collect()
}

#[test]
fn what_lies_in_a_gap_is_lost_and_what_follows_has_its_own_samples() {
    // Catches samples from before and behind a gap in one record, a tap behind it at another's place, and a gap that nobody is
    // told of.
    for bits in [16, 24] {
        let cable = Cable::new(&config(bits));
        // The second tap is cut off after its pulse; the third, in the gap, never comes.
        let taps = [1000, 3000, 3700, 5000, 7000];
        cable.play([Step::Frames(frames(0..2000, &taps)), Step::Frames(frames(2000..3200, &taps))]);
        assert_eq!((taken(&cable.ear), cable.ear.strike_count()), (vec![record(1000)], 1), "{bits} bits");
        cable.play([Step::Lost(1000), Step::Frames(frames(4200..8000, &taps))]);
        assert_eq!(cable.ear.strike_count(), 2, "{bits} bits");
        assert_eq!(taken(&cable.ear), [5000, 7000].map(record), "{bits} bits");
        // One when it began to listen.
        assert_eq!(cable.ear.loss_count(), 2);
        assert_eq!(cable.ear.take_alarms(), ["fake has lost about 1000 samples; any tap in them is lost"]);
    }
}

#[test]
fn a_pulse_that_a_gap_cuts_is_no_tap() {
    // Catches half a pulse before a gap that is ended by what comes behind it.
    let cable = Cable::new(&config(16));
    cable.play([
        Step::Frames(frames(0..1020, &[1000])),
        Step::Lost(1),
        Step::Frames(frames(1021..3000, &[1000, 2000])),
    ]);
    assert_eq!(taken(&cable.ear), [record(2000)]);
    assert_eq!(cable.ear.loss_count(), 2);
}

#[test]
fn a_tap_that_begins_in_a_gap_is_reported_as_lost() {
    // Catches a record whose first samples were never heard: they are those of another time.
    let cable = Cable::new(&config(16));
    let tap = 2000 + PRE - 10;
    cable.play([Step::Frames(frames(0..1000, &[])), Step::Lost(1000), Step::Frames(frames(2000..4000, &[tap, 3000]))]);
    assert_eq!((cable.ear.strike_count(), cable.ear.loss_count()), (2, 2));
    assert_eq!(taken(&cable.ear), [record(3000)]);
    assert_eq!(cable.ear.loss_count(), 3);
    let alarms = cable.ear.take_alarms();
    assert!(alarms.len() == 2 && alarms[1].starts_with("a tap was heard but not taken in time"), "{alarms:?}");
}

#[test]
fn the_level_changes_while_the_device_is_heard() {
    // Catches a level that stays what it was, and one for which the device is opened again.
    let cable = Cable::new(&config(16));
    let mut played = 0;
    for (level, is_heard) in [(0.05, true), (0.5, false), (0.1, true)] {
        cable.ear.set_level(level);
        cable.play([Step::Frames(frames(played..played + 2000, &[played + 1000]))]);
        assert_eq!(taken(&cable.ear).len(), usize::from(is_heard), "{level}");
        played += 2000;
    }
    assert_eq!(cable.ear.loss_count(), 1);
}

#[test]
fn a_device_that_comes_back_is_heard_as_before() {
    // Catches a device that is given up, samples of two openings in one record, a fault that is told again and again or that
    // stays, and one that is over before anything is heard.
    let cable = Cable::new(&config(16));
    cable.play([Step::Frames(frames(0..1200, &[500, 1100]))]);
    assert_eq!(taken(&cable.ear), [record(500)]);
    cable.play([
        Step::Fails("it was pulled out"),
        Step::Fails("it is not there"),
        Step::Fails("it is not there"),
        Step::Opens,
    ]);
    let gone = |why: &str| format!("the device fake is not heard: {why}");
    assert_eq!(cable.ear.fault(), Some(gone("it is not there")));
    cable.play([Step::Frames(frames(0..2000, &[300, 1500]))]);
    assert_eq!(cable.ear.fault(), None);
    assert_eq!(taken(&cable.ear), [300, 1500].map(record));
    let alarms = ["it was pulled out", "it is not there"].map(|why| [gone(why), format!("{OVER}{}", gone(why))]);
    assert_eq!(cable.ear.take_alarms(), alarms.concat());
    assert_eq!(cable.ear.loss_count(), 2);
}

#[test]
fn taps_for_which_nobody_asks_are_one_alarm() {
    // Catches an alarm for each of them, and none when it happens again.
    let cable = Cable::new(&config(16));
    for turn in 0..2 {
        let count = TAPS_MAX as u64 + 9;
        let first = turn * 600 * (count + 1);
        let taps: Vec<u64> = (1..=count).map(|n| first + 600 * n - 300).collect();
        cable.play([Step::Frames(frames(first..first + 600 * (count + 1), &taps))]);
        assert_eq!(cable.ear.take_alarms(), ["more taps were heard than the station has asked for"]);
        assert!(cable.ear.take_tap().is_some());
    }
}
