//! A station taps again what stands out, before its casing is judged.

use std::collections::{BTreeMap, BTreeSet};

use rustix::process::Signal;
use tapline_store::{Reader, verify};
use tapline_testing::documents::csv_rows;
use tapline_wire::{Purpose, TapState};

use crate::line::{archived, file_of};
use crate::sandbox::Sandbox;
use crate::sandbox::running::{Running, until};
use crate::sandbox::stages::{signal, stage};

/// Catches a casing that is let go before its second reading, an added tap that is lost, one that the archive does not distinguish from
/// the others, a verdict on the first reading alone, and results that reprocessing does not find again.
#[test]
fn a_crack_is_tapped_again_before_it_is_judged() {
    let sandbox = Sandbox::new();
    let station = "[[station]]\nnumber = 1\nsource = \"simulated\"\n";
    let scan = "[scan]\noffsets_mm = [0.0, 10.0]\nvelocities_m_per_s = [1.5, 1.85]\nlocations = 60\ntap_period_s = 0.4\noffset_change_s = 3.0\n";
    let head = "[simulation]\nsample_count = 2048\n[fuse]\nreference = \"self\"\n";
    sandbox.write("plant.toml", &format!("{scan}{head}{station}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 2");
    let verdicts = line.verdicts(2);
    line.finish().expect(0);
    // The casings of a station are alternately cracked and sound.
    assert_eq!((&verdicts[0]["verdict"], &verdicts[1]["casing"]), (&"REJECT".into(), &"S1-2".into()), "{verdicts:?}");
    let file = file_of(&verdicts[0]);
    assert!(verify(&file).unwrap().is_complete());
    let reader = Reader::open(&file).unwrap();
    let plan = reader.plan();
    // A closed turn at each offset and velocity, on both shoulders.
    assert_eq!(plan.begun().taps().len(), 2 * 2 * 2 * 61);
    let is = |purpose| plan.added().iter().filter(move |tap| tap.purpose == purpose).count();
    assert!(
        is(Purpose::Suspect) > 0 && is(Purpose::Control) >= 24,
        "{} and {}",
        is(Purpose::Suspect),
        is(Purpose::Control)
    );
    // A place is tapped again where it stands out most, at one offset, and there with both velocities.
    let of_suspects = || plan.added().iter().filter(|tap| tap.purpose == Purpose::Suspect).map(|tap| tap.id);
    let with = |velocity| of_suspects().filter(|id| id.velocity_m_per_s() == Some(velocity)).count();
    assert_eq!((with(1.5), with(1.85)), (of_suspects().count() / 2, of_suspects().count() / 2));
    let mut offsets: BTreeMap<(u16, u32), BTreeSet<String>> = BTreeMap::new();
    for id in of_suspects() {
        offsets.entry((id.shoulder, id.location)).or_default().insert(format!("{:?}", id.offset_mm()));
    }
    assert!(offsets.values().all(|offsets| offsets.len() == 1), "{offsets:?}");
    assert!(reader.ledger().taps().iter().all(|&state| state == TapState::Archived));
    let (judgement, _) = reader.judgements().unwrap()[0].clone().unwrap();
    assert!(judgement.first_strongest_arc.is_finite() && judgement.strongest_arc >= judgement.limit_reject);
    // The time of a scan is that of its first reading: the second one waits for the other shoulder.
    let headers = reader.headers().unwrap();
    let span_s = |is_taken: &dyn Fn(u32) -> bool| {
        let rows = plan.scans()[0].taps.iter().filter(|&&row| is_taken(row));
        let times_ns: Vec<i64> = rows.map(|&row| headers[row as usize].unwrap().tap_time_ns).collect();
        (times_ns.iter().max().unwrap() - times_ns.iter().min().unwrap()) as f64 * 1e-9
    };
    let first_s = span_s(&|row| !plan.taps()[row as usize].is_second_reading());
    let exported = csv_rows(&sandbox.run(&format!("export {} verdicts", file.display())).expect(0).out);
    assert!(
        (exported[0]["scan_s"].parse::<f64>().unwrap() - first_s).abs() < 1e-6 && span_s(&|_| true) > first_s + 1.0
    );
    let live = reader.judgements().unwrap();
    drop(reader);
    let done = sandbox.run(&format!("reprocess {}", file.display())).expect(0);
    let results = sandbox.path(done.out.trim());
    let again = Reader::open(results).unwrap().judgements().unwrap();
    assert_eq!(format!("{again:?}"), format!("{live:?}"));
}

/// Catches a second reading that is forgotten, taken twice or judged half when the stage that asked for it or added it dies.
#[test]
fn a_second_reading_outlives_the_stages() {
    let sandbox = Sandbox::new();
    let station = "[[station]]\nnumber = 1\nsource = \"simulated\"\n";
    let head = "[simulation]\nsample_count = 2048\n[fuse]\nreference = \"self\"\n[acquire]\n";
    // The casing is killed for when so many of its 202 first taps and some 30 second ones are archived.
    let made = |taps_per_s: f64, kills: &[(u64, &str)]| {
        sandbox.write("plant.toml", &format!("{head}taps_per_s = {taps_per_s}\n{station}"));
        let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 1");
        for &(archived_count, victim) in kills {
            until("taps are archived", || archived(&sandbox) >= archived_count);
            signal(stage(line.child(), victim), Signal::KILL);
        }
        let file = file_of(&line.verdict());
        line.finish().expect(0);
        assert!(verify(&file).unwrap().is_complete());
        let reader = Reader::open(&file).unwrap();
        let arcs: Vec<u64> =
            reader.judgements().unwrap().into_iter().map(|judged| judged.unwrap().0.strongest_arc.to_bits()).collect();
        let plan = reader.plan().clone();
        std::fs::remove_dir_all(sandbox.path("out")).unwrap();
        (plan, arcs)
    };
    let expected = made(1000.0, &[]);
    assert!(!expected.0.added().is_empty());
    assert_eq!(made(20.0, &[(120, "fuse"), (199, "store"), (206, "fuse"), (210, "store")]), expected);
}
