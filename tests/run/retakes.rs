//! Unusable taps: taken again if the source can, flagged otherwise.

use std::collections::BTreeMap;

use rustix::process::Signal;

use crate::sandbox::archives::{assert_same, contents};
use crate::sandbox::stages::{signal, stage};
use crate::sandbox::{Sandbox, short_scan};
use tapline_testing::documents::csv_rows;
use tapline_testing::program::Done;

/// A rig with a second hit in a tenth of its taps, and a neighbour's tap in another tenth, somewhere in records of 0.4 s.
fn faulty() -> String {
    let fault = |kind| format!("[[simulation.fault]]\nkind = \"{kind}\"\nfraction = 0.1\n");
    format!("{}[simulation]\nsample_count = 16384\n{}{}", short_scan(60), fault("double_hit"), fault("neighbour"))
}

/// Number of taps with each flag in the archive.
fn flags(sandbox: &Sandbox, archive: &str) -> BTreeMap<String, u32> {
    let mut counts = BTreeMap::new();
    for row in csv_rows(&sandbox.run(&format!("export {archive} discriminators")).expect(0).out) {
        for flag in row["quality"].split('|').filter(|flag| !flag.is_empty()) {
            *counts.entry(flag.to_owned()).or_default() += 1;
        }
    }
    counts
}

/// Catches an unusable record that is archived while retakes are left, endless retakes, an attempt that the archive
/// does not record, and a policy that is ignored.
#[test]
fn unusable_taps_are_taken_again() {
    let sandbox = Sandbox::new();
    sandbox.write("faulty.toml", &format!("[acquire]\nretakes = 4\n{}", faulty()));
    let summary = sandbox.run("run --config faulty.toml --out faulty --json").json(0);
    let taken_again = summary["pace"]["taken_again"].as_u64().unwrap();
    assert!((10..60).contains(&taken_again), "{summary:#}");
    assert_eq!(summary["archived"], 122);
    assert_eq!(summary["flags"].as_array().unwrap().len(), 0, "{summary:#}");
    let found = flags(&sandbox, "faulty/SIM-0001.h5");
    assert!(!["double_hit", "neighbour", "retake"].iter().any(|flag| found.contains_key(*flag)), "{found:?}");
    let ledger = csv_rows(&sandbox.run("export faulty/SIM-0001.h5 ledger").expect(0).out);
    let attempts: u64 = ledger.iter().map(|row| row["attempt"].parse::<u64>().unwrap()).sum();
    assert_eq!(attempts, taken_again);
    sandbox.run("verify faulty/SIM-0001.h5").expect(0);

    // Without retakes, the first record is archived with its flags.
    sandbox.write("once.toml", &format!("[acquire]\nretakes = 0\n{}", faulty()));
    let summary = sandbox.run("run --config once.toml --out once --json").json(0);
    assert_eq!(summary["pace"]["taken_again"], 0);
    let found = flags(&sandbox, "once/SIM-0001.h5");
    let summed = summary["flags"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| (f[0].as_str().unwrap().to_owned(), f[1].as_u64().unwrap()));
    let counted = found.iter().map(|(name, &count)| (name.clone(), u64::from(count)));
    assert_eq!(summed.collect::<BTreeMap<_, _>>(), counted.collect(), "what the run says and what the archive has");
    assert!(found["double_hit"] >= 4 && found["neighbour"] >= 4 && !found.contains_key("retake"), "{found:?}");
    for row in csv_rows(&sandbox.run("export once/SIM-0001.h5 discriminators").expect(0).out) {
        assert!(!row["quality"].contains("double_hit") || (row["f_max"].is_empty() && row["pr"].is_empty()), "{row:?}");
    }

    sandbox
        .write("keep.toml", &format!("[process.quality]\ndouble_hit = \"keep\"\nneighbour = \"drop\"\n{}", faulty()));
    let summary = sandbox.run("run --config keep.toml --out keep --json").json(0);
    assert_eq!(summary["pace"]["taken_again"], 0);
    let found = flags(&sandbox, "keep/SIM-0001.h5");
    assert!(found["double_hit"] >= 4 && found["neighbour"] >= 4, "{found:?}");
    for row in csv_rows(&sandbox.run("export keep/SIM-0001.h5 discriminators").expect(0).out) {
        assert!(row["quality"] != "double_hit" || (!row["f_max"].is_empty() && !row["pr"].is_empty()), "{row:?}");
        assert!(row["quality"] != "neighbour" || (!row["f_max"].is_empty() && row["pr"].is_empty()), "{row:?}");
    }
}

/// Catches an attempt that is forgotten with the stage that knew it: whichever stage is killed, the archive is the
/// same.
#[test]
fn attempts_outlive_the_stages() {
    let sandbox = Sandbox::new();
    sandbox.write("quick.toml", &faulty());
    sandbox.run("run --config quick.toml --out quick").expect(0);
    let expected = contents(&sandbox.path("quick/SIM-0001.h5"));
    sandbox.write("paced.toml", &format!("[acquire]\ntaps_per_s = 60.0\n{}", faulty()));
    let line = sandbox.start("run --config paced.toml --out paced --json");
    for victim in ["process", "acquire-0", "store"] {
        std::thread::sleep(std::time::Duration::from_millis(500));
        signal(stage(&line, victim), Signal::KILL);
    }
    let summary = Done::from(line.wait_with_output().unwrap()).json(0);
    assert_eq!(summary["pace"]["restarts"], 3);
    assert_same(&contents(&sandbox.path("paced/SIM-0001.h5")), &expected);
    sandbox.run("verify paced/SIM-0001.h5").expect(0);
}
