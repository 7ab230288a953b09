//! Cases 43 and 44: numbers in other units, and numbers made under other settings.

use hdf5::types::FixedUnicode;
use tapline_fuse::{Direction, FuseConfig, Reference};
use tapline_process::{Extractor, ProcessConfig};
use tapline_store::{Error, Lineage, Reader, Writer};
use tapline_wire::{Channel, Discriminator, Geometry, Plan, Recording, SampleFormat, Samples, TapHeader, Truth};

use crate::stability::scatter::{Normal, judge, mean, naive_eq_55, planned, records, ring_plan, sd, tyre};

/// A plan that an archive can be made of.
fn archived_plan() -> Plan {
    let recording = Recording {
        sample_rate_hz: 40_960.0,
        pre_trigger_samples: 64,
        sample_count_max: 256,
        sample_format: SampleFormat::I16,
        channels: Channel::BOTH.to_vec(),
        calibration: tapline_wire::Calibration::computed(),
    };
    let taps = (0..=4).map(|l| planned(tyre("T1"), 1, l, 4)).collect();
    Plan::new(Geometry::Ring, recording, taps, Truth::new()).unwrap()
}

/// Case 43: a force in mN.
///
/// Naive: a factor of 1000 passes Eq. 55 of one tyre unseen (1e-9), and by the extremes of another tyre puts every location
/// beyond them. Hold: levels are those of a turn, so that a factor changes the default index by less than 1e-6; an archive
/// states its units and is refused if they differ or are missing.
#[test]
fn c43_a_factor_of_a_thousand() {
    let mut normal = Normal::new(43);
    let newton: Vec<f64> = normal.take(100).into_iter().map(|x| 30.0 + x).collect();
    let milli: Vec<f64> = newton.iter().map(|f| 1000.0 * f).collect();
    let of = |column: &[f64]| naive_eq_55(column, column, Direction::Falls);
    assert!(of(&newton).iter().zip(of(&milli)).all(|(a, b)| (a - b).abs() < 1e-9));
    let plan = ring_plan(&[tyre("T1"), tyre("T2")], 1, 100);
    let config = FuseConfig {
        discriminators: vec![Discriminator::FMax],
        ..FuseConfig::by(Reference::Shoulder { tyre: tyre("T2"), shoulder: 1 })
    };
    assert!(naive_eq_55(&newton, &milli, Direction::Falls).iter().all(|&y| y > 1.0));
    let map = |of_second: &[f64]| -> Vec<f64> {
        let of = records(&plan, |tap| {
            let k = tap.id.location as usize % 100;
            vec![(Discriminator::FMax, if tap.id.tyre == tyre("T2") { of_second[k] } else { newton[k] })]
        });
        judge(&config, &plan, &of).remove(0).1.iter().map(|cell| cell.damage_index).collect()
    };
    assert!(map(&newton).iter().zip(map(&milli)).all(|(a, b)| (a - b).abs() < 1e-6));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    drop(Writer::create(&path, &archived_plan(), 5, "").unwrap());
    Reader::open_unfinished(&path).unwrap();
    let units = || {
        let table = hdf5::File::open(&path).unwrap().dataset("discriminators").unwrap();
        table.attr("units_f_max").unwrap().read_scalar::<FixedUnicode<32>>().unwrap().to_string()
    };
    assert_eq!(units(), "N");
    let refuses = |change: &dyn Fn(&hdf5::Dataset)| {
        let file = hdf5::File::open_rw(&path).unwrap();
        change(&file.dataset("discriminators").unwrap());
        file.close().unwrap();
        // Units are a part of what must not change once a file is begun.
        let outcome = Reader::open_unfinished(&path);
        assert!(matches!(outcome, Err(Error::OtherUnits { .. } | Error::Damaged { .. })), "{outcome:?}");
    };
    refuses(&|table| {
        let units: FixedUnicode<32> = "mN".parse().unwrap();
        table.attr("units_f_max").unwrap().write_scalar(&units).unwrap();
    });
    refuses(&|table| table.delete_attr("units").unwrap());
}

/// PR of a sound tap with a little noise, whose ringing has modes at 300, 480 and 900 Hz.
fn power_ratio(f_c_hz: f64, normal: &mut Normal) -> f64 {
    let ring = |t: f64| -> f64 {
        let mode = |f: f64, a: f64| a * (-120.0 * t).exp() * (std::f64::consts::TAU * f * t).sin();
        if t < 0.0 { 0.0 } else { mode(300.0, 1.0) + mode(480.0, 0.5) + mode(900.0, 0.4) }
    };
    let samples: Vec<f32> =
        (0..8192).map(|k| (ring((f64::from(k) - 512.0) / 40_960.0) + 2e-3 * normal.next()) as f32).collect();
    let header = TapHeader::in_units(40_960.0, 512, 8192, &[Channel::Sound]);
    let config = ProcessConfig { f_c_hz, ..ProcessConfig::default() };
    let found = Extractor::<f64>::new(&config).unwrap().extract(&header, Samples::F32(&samples));
    found.values.get(Discriminator::Pr).unwrap()
}

/// Case 44: an archive that is continued with another band.
///
/// Naive: PR of 400 Hz and of 550 Hz in one normalisation part a sound ring into halves that lie more than half of the
/// whole scale and 10 of their own deviations apart. Hold: an archive holds the settings of its results, and is
/// refused under other options; both are named.
#[test]
fn c44_an_archive_of_two_bands() {
    let mut normal = Normal::new(44);
    let mixed: Vec<f64> = (0..40).map(|k| power_ratio(if k < 20 { 550.0 } else { 400.0 }, &mut normal)).collect();
    let naive = naive_eq_55(&mixed, &mixed, Direction::Rises);
    let (old, new) = naive.split_at(20);
    assert!(mean(new) - mean(old) > 0.5 && mean(new) - mean(old) > 10.0 * sd(old), "{old:?} {new:?}");

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let plan = archived_plan();
    let lineage = |made_by| Lineage { made_by, ..Lineage::from("") };
    let old = lineage("process.f_c_hz = 550.0\nprocess.f_hi_hz = 2000.0");
    drop(Writer::create(&path, &plan, plan.taps().len(), old).unwrap());
    drop(Writer::resume(&path, old).unwrap());
    match Writer::resume(&path, lineage("process.f_c_hz = 400.0\nprocess.f_hi_hz = 2000.0")) {
        Err(Error::OtherLineage { archived, given, .. }) => {
            assert_eq!((archived.as_str(), given.as_str()), ("process.f_c_hz = 550.0", "process.f_c_hz = 400.0"));
        }
        other => panic!("{:?}", other.map(|_| "opened")),
    }
}
