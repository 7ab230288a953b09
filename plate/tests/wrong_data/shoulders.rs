//! Faults of many taps: the reasons of a shoulder's verdict.

use std::sync::LazyLock;

use tapline_fuse::{FuseConfig, Fusion, Reference};
use tapline_model::{SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig, plant_cracks};
use tapline_plate::{Crack, Population, ScanShape, Tyre, discriminators};
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{
    Discriminator, Discriminators, Plan, PlannedTap, Reasons, SampleFormat, Samples, Serial, TapHeader, TapId,
};

use crate::header;

/// A casing's plan, and the discriminators of its taps.
type Scanned = (Plan, Vec<Discriminators>);

/// Casings of each simulator, every other one cracked, with rogue taps where the simulator has them.
static SCANS: LazyLock<[(&str, Vec<Scanned>); 2]> = LazyLock::new(|| {
    let shape = ScanShape { offsets_mm: vec![0.0, 10.0], ..ScanShape::default() };
    let one_turn = ScanShape { offsets_mm: vec![0.0], repetitions: 1, ..ScanShape::default() };
    let of = |k: u32| if k.is_multiple_of(4) { &one_turn } else { &shape };
    let process = ProcessConfig::default();
    let plate = |k: u32| {
        let crack = Crack { depth_mm: f64::from(3 + k % 8), ..Crack::default() }.over(30, 2 + k % 12, 100);
        let cracks = if k.is_multiple_of(2) { vec![] } else { vec![crack] };
        let tyres = [Tyre { serial: Serial::new(&format!("P-{k}")).unwrap(), cracks }];
        let plan = of(k).plan(&tyres).unwrap();
        let found = discriminators(&Population::rough(), 5, &tyres, &plan, &process, 2).unwrap();
        (plan, found)
    };
    let model = |k: u32| {
        let serial = format!("M-{k}");
        let cracks = if k.is_multiple_of(2) { vec![] } else { plant_cracks(4, &serial, 100, 4) };
        let plan = of(k).plan(&[Tyre { serial: Serial::new(&serial).unwrap(), cracks: vec![] }]).unwrap();
        let found = modelled(&plan, SimulatedTyre { serial, cracks }, &process);
        (plan, found)
    };
    [("model", (0..16).map(model).collect()), ("plate", (0..60).map(plate).collect())]
});

/// The taps of `plan` by the model, 50 ms each.
fn modelled(plan: &Plan, tyre: SimulatedTyre, process: &ProcessConfig) -> Vec<Discriminators> {
    let config = SimulationConfig { sample_count: 2048, pre_trigger_samples: 256, ..SimulationConfig::default() };
    let mut rig = SimulatedRig::new(&config, 9, &[tyre]).unwrap();
    let mut samples = vec![0_i16; rig.sample_total()];
    let mut extractor = ProcessExtractor::new(process).unwrap();
    let units = [config.force_full_scale_n, config.sound_full_scale_v].map(|full| full / 32_768.0);
    let tap = |(row, planned): (u32, &PlannedTap)| {
        let id = planned.id;
        let velocity_m_per_s = id.velocity_m_per_s().unwrap();
        let tap = SimulatedTap {
            tyre_serial: id.tyre.as_str(),
            shoulder: id.shoulder,
            offset_mm: id.offset_mm().unwrap(),
            velocity_m_per_s,
            location: id.location,
            location_count: 100,
            repetition: id.repetition,
            attempt: 0,
        };
        let measured = rig.render(&tap, &mut samples);
        let header = TapHeader {
            id,
            plan_index: row,
            microphone_distance_m: config.microphone_distance_m,
            ..header(SampleFormat::I16, 2048, 256, (velocity_m_per_s, measured), units)
        };
        extractor.extract(&header, Samples::I16(&samples))
    };
    (0..).zip(plan.taps()).map(tap).collect()
}

/// Counts the shoulders of each simulator that have `reason` after `spoil` has changed their taps.
fn share(reason: Reasons, what: &str, spoil: impl Fn(&mut Discriminators)) -> [f64; 2] {
    share_of(reason, what, 1, spoil)
}

/// The same for every `step`th casing: for 2, the sound ones.
fn share_of(reason: Reasons, what: &str, step: usize, spoil: impl Fn(&mut Discriminators)) -> [f64; 2] {
    SCANS.each_ref().map(|(name, scans)| {
        let (mut given_count, mut count) = (0, 0);
        for (plan, found) in scans.iter().step_by(step) {
            let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), plan).unwrap();
            for mut tap in found.iter().copied() {
                spoil(&mut tap);
                fusion.push(&tap).unwrap();
            }
            for scan in 0..plan.scans().len() {
                fusion.end(scan).unwrap();
            }
            for scan in 0..plan.scans().len() {
                count += 1;
                given_count += u32::from(fusion.judge(scan).unwrap().0.reasons.contains(reason));
            }
        }
        let share = f64::from(given_count) / f64::from(count);
        eprintln!("{what}, {name}: {reason} of {share:.4} of {count} shoulders");
        share
    })
}

/// Catches a force sensor whose gain changes within a scan, and a crack, a rogue tap or a drift that counts as such a change.
#[test]
fn a_force_gain_that_changes_within_a_scan() {
    assert!(share(Reasons::FORCE_OFF, "nothing", |_| ()).iter().all(|share| *share <= 0.01));
    for gain in [0.8, 1.2] {
        let off = |tap: &mut Discriminators, is_off: bool| {
            let f_max = tap.values.get(Discriminator::FMax).filter(|_| is_off);
            f_max.into_iter().for_each(|f_max| tap.values.set(Discriminator::FMax, Some(gain * f_max)));
        };
        type Place = fn(&TapId) -> bool;
        let places: [(&str, Place); 4] = [
            ("10 locations", |id| (55..65).contains(&id.location)),
            ("10 locations of a turn", |id| id.repetition == 0 && (55..65).contains(&id.location)),
            ("the first half", |id| id.location < 50),
            ("the end of the scan", |id| id.location > 70),
        ];
        for (place, is_there) in places {
            let what = format!("gain {gain} at {place}");
            // A crack in the same place reduces the force too: nothing shows whether the gain is off there as well.
            let shares = share_of(Reasons::FORCE_OFF, &what, 2, |tap| off(tap, is_there(&tap.id)));
            assert!(shares.iter().all(|share| *share >= 0.99), "{what}: {shares:?}");
        }
    }
}

/// Catches a gain of a whole turn that is off, where there are others.
#[test]
fn a_force_gain_that_changes_between_turns() {
    for gain in [0.8, 1.2] {
        let shares = share(Reasons::FORCE_OFF, &format!("gain {gain} of a turn"), |tap| {
            let is_off = tap.id.repetition == 1 && tap.id.offset_mm() == Some(0.0);
            let f_max = tap.values.get(Discriminator::FMax).filter(|_| is_off);
            f_max.into_iter().for_each(|f_max| tap.values.set(Discriminator::FMax, Some(gain * f_max)));
        });
        // A quarter of the casings have only one turn.
        assert!(shares.iter().all(|share| *share >= 0.75 * 0.99), "{shares:?}");
    }
}

/// Catches a block of locations without a force that passes because the sound is there.
#[test]
fn a_force_that_is_missing_in_a_block() {
    assert!(share(Reasons::DISCRIMINATORS_ABSENT, "nothing", |_| ()).iter().all(|share| *share <= 0.01));
    for width in [2, 10, 30] {
        let shares = share(Reasons::DISCRIMINATORS_ABSENT, &format!("no force at {width} locations"), |tap| {
            if (20..20 + width).contains(&tap.id.location) {
                use Discriminator::{A1, A2, FMax, Tau};
                [FMax, Tau, A1, A2].iter().for_each(|&which| tap.values.set(which, None));
            }
        });
        assert!(shares.iter().all(|share| *share >= 0.99), "{width}: {shares:?}");
    }
}

/// Catches a velocity that was never measured and not reported, and one that is missing at a tap.
#[test]
fn a_velocity_that_was_never_measured() {
    let some = |tap: &mut Discriminators| {
        tap.velocity_measured_m_per_s = if tap.id.location == 3 { tap.velocity_measured_m_per_s } else { f64::NAN };
    };
    assert!(share(Reasons::VELOCITY_UNKNOWN, "velocities at one location", some).iter().all(|share| *share < 0.01));
    let none = |tap: &mut Discriminators| tap.velocity_measured_m_per_s = f64::NAN;
    assert!(share(Reasons::VELOCITY_UNKNOWN, "no velocity", none).iter().all(|share| *share > 0.99));
}
