use tapline_wire::Serial;

use super::*;
use crate::Crack;

const FS: f64 = 40_960.0;
const TAP: Tap = Tap {
    shoulder: 1,
    offset_mm: 0.0,
    velocity_m_per_s: 1.85,
    repetition: 0,
    location: 12,
    location_count: 100,
    attempt: 0,
};

fn casing(population: &Population, cracks: Vec<Crack>) -> Casing {
    Casing::new(population, 3, Serial::new("C-1").unwrap(), cracks)
}

/// A population without any scatter.
fn exact() -> Population {
    Population {
        place_stiffness: 0.0,
        place_modes: 0.0,
        turn_gain: 0.0,
        turn_drift: 0.0,
        turn_sensor: 0.0,
        turn_sensor_drift: 0.0,
        tap_stiffness: 0.0,
        tap_velocity: 0.0,
        tap_modes: 0.0,
        velocity_error: 0.0,
        force_noise_n: 0.0,
        sound_noise_v: 0.0,
        ..Population::smooth()
    }
}

fn record(population: &Population, casing: &Casing, tap: &Tap) -> (Vec<f32>, Vec<f32>, f64) {
    let mut rig = Rig::new(population, FS, 256).unwrap();
    let (mut force, mut sound) = (vec![0.0; 2048], vec![0.0; 2048]);
    let measured = rig.record(casing, tap, &mut force, &mut sound);
    (force, sound, measured)
}

fn largest(signal: &[f32]) -> f32 {
    signal.iter().map(|x| x.abs()).max_by(f32::total_cmp).unwrap()
}

/// Catches state that is carried from one tap to the next, and a part of a tap's identity that has no effect.
#[test]
fn a_record_depends_on_its_name_alone() {
    let p = Population::rough();
    let casing = casing(&p, Vec::new());
    let mut rig = Rig::new(&p, FS, 256).unwrap();
    let names = [
        TAP,
        Tap { shoulder: 2, ..TAP },
        Tap { offset_mm: 5.0, ..TAP },
        Tap { velocity_m_per_s: 1.5, ..TAP },
        Tap { repetition: 1, ..TAP },
        Tap { location: 13, ..TAP },
        Tap { attempt: 1, ..TAP },
    ];
    let mut taken = |tap: &Tap| {
        let (mut force, mut sound) = (vec![1.0; 2048], vec![1.0; 2048]);
        rig.record(&casing, tap, &mut force, &mut sound);
        (force, sound)
    };
    let forwards: Vec<_> = names.iter().map(&mut taken).collect();
    let backwards: Vec<_> = names.iter().rev().map(&mut taken).collect();
    assert!(forwards.iter().eq(backwards.iter().rev()));
    for (number, a) in forwards.iter().enumerate() {
        assert!(forwards[..number].iter().all(|b| b != a), "{number}");
    }
    let other = Casing::new(&p, 4, Serial::new("C-1").unwrap(), Vec::new());
    assert_ne!(record(&p, &other, &TAP).0, forwards[0].0, "the seed counts");
}

/// Catches a crack that does not lower the force and lengthen the contact, the more the longer it is.
#[test]
fn a_crack_lowers_the_force_and_lengthens_the_contact() {
    let p = exact();
    let of_length = |length_mm: f64| {
        let crack = Crack { depth_mm: 10.0, length_mm, ..Crack::default() }.over(10, 5, 100);
        record(&p, &casing(&p, vec![crack]), &TAP)
    };
    let sound = record(&p, &casing(&p, Vec::new()), &TAP);
    let all = [sound, of_length(8.0), of_length(14.0), of_length(20.0), of_length(25.0)];
    let peaks = all.each_ref().map(|r| largest(&r.0));
    let touched = all.each_ref().map(|r| r.0.iter().filter(|&&f| f > 0.1 * largest(&r.0)).count());
    assert!(peaks.windows(2).all(|p| p[1] < p[0]), "{peaks:?}");
    assert!(touched.windows(2).all(|t| t[1] >= t[0]) && touched[4] > touched[0] + 2, "{touched:?}");
}

/// Catches gains and drifts within a turn that are not the planted ones: without other scatter, the sounds of two
/// locations differ by these alone.
#[test]
fn a_turn_drifts_as_planted() {
    let p = Population { turn_gain: 0.03, turn_drift: 0.05, turn_sensor_drift: 0.02, ..exact() };
    let casing = casing(&p, Vec::new());
    let still = exact();
    let mut drifts = Vec::new();
    let mut gains = Vec::new();
    for repetition in 0..300 {
        let at = |location: u32| {
            let tap = Tap { repetition, location, ..TAP };
            let (force, sound, _) = record(&p, &casing, &tap);
            let (plain_force, plain_sound, _) = record(&still, &casing, &tap);
            let ratio = |a: &[f32], b: &[f32]| f64::from(largest(a)) / f64::from(largest(b));
            (ratio(&force, &plain_force), ratio(&sound, &plain_sound))
        };
        let (first, middle, last) = (at(0), at(50), at(100));
        assert!((first.1 + last.1 - 2.0 * middle.1).abs() < 1e-5, "a drift is a straight line");
        drifts.push(((last.0 - first.0) / middle.0, (last.1 - first.1) / middle.1));
        gains.push(middle.1);
    }
    let sd = |of: &dyn Fn(&(f64, f64)) -> f64| (drifts.iter().map(|d| of(d).powi(2)).sum::<f64>() / 300.0).sqrt();
    assert!((sd(&|d| d.0) / 0.02 - 1.0).abs() < 0.15 && (sd(&|d| d.1) / 0.05 - 1.0).abs() < 0.15);
    let mean = gains.iter().sum::<f64>() / 300.0;
    let spread = (gains.iter().map(|g| (g / mean - 1.0).powi(2)).sum::<f64>() / 300.0).sqrt();
    assert!((spread / 0.03 - 1.0).abs() < 0.15, "{spread}");
}

/// Catches rogue taps at another rate than stated, and rogue taps that change their neighbours.
#[test]
fn rogue_taps_are_as_many_as_stated() {
    let p = Population { rogue: 0.1, ..exact() };
    let casing = casing(&p, Vec::new());
    let plain = exact();
    let is_rogue = |location: u32, repetition: u16| {
        let tap = Tap { location, repetition, ..TAP };
        record(&p, &casing, &tap).0 != record(&plain, &casing, &tap).0
    };
    let count = (0..2000_u16).filter(|&k| is_rogue(u32::from(k % 100), k / 100)).count();
    assert!((150..250).contains(&count), "{count} of 2000");
}

/// Catches noise of another size than stated, and noise that is only before the trigger.
#[test]
fn noise_is_as_stated() {
    let p = Population { force_noise_n: 0.05, sound_noise_v: 0.004, ..exact() };
    let casing = casing(&p, Vec::new());
    let (force, sound, _) = record(&p, &casing, &TAP);
    let (plain_force, plain_sound, _) = record(&exact(), &casing, &TAP);
    let sd = |a: &[f32], b: &[f32]| {
        (a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    };
    assert!((sd(&force, &plain_force) / 0.05 - 1.0).abs() < 0.06);
    assert!((sd(&sound, &plain_sound) / 0.004 - 1.0).abs() < 0.06);
}

/// Catches a rate out of its bounds that is accepted, and a record that is too short for its pulse.
#[test]
fn bad_rates_are_refused_and_short_records_are_cut() {
    assert!(Rig::new(&exact(), FS, 0).is_err() && Rig::new(&exact(), f64::NAN, 256).is_err());
    let casing = casing(&exact(), Vec::new());
    let mut rig = Rig::new(&exact(), FS, 256).unwrap();
    let (mut short, mut whole) = ((vec![0.0; 270], vec![0.0; 270]), (vec![0.0; 2048], vec![0.0; 2048]));
    rig.record(&casing, &TAP, &mut short.0, &mut short.1);
    rig.record(&casing, &TAP, &mut whole.0, &mut whole.1);
    assert!(short.0 == whole.0[..270] && short.1 == whole.1[..270]);
}
