//! Recorded slabs with known or inferred cracks, scanned by a whole line with the configurations that ship.

use std::collections::BTreeMap;
use std::path::Path;

use tapline_testing::documents::csv_rows;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::finished;

/// Number of lines on a slab by verdict.
#[derive(Debug, Default)]
struct Slab {
    auc: f64,
    cracked: BTreeMap<String, usize>,
    sound: BTreeMap<String, usize>,
}

impl Slab {
    /// The verdicts of the shipped configuration on the slab; `None` without its recordings.
    fn scanned(set: &str) -> Option<Self> {
        let taps = tapline_testing::shared(set)?;
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(format!("{set}.toml"));
        let sandbox = Sandbox::new();
        let arguments =
            format!("run --taps {} --config {} --stations 2 --out slab --json", taps.display(), config.display());
        let summary = sandbox.run(&arguments).json(0);
        assert_eq!(summary["pace"]["gaps"], 0);
        let mut slab = Self { auc: summary["auc"]["index"].as_f64()?, ..Self::default() };
        for path in finished(&sandbox.path("slab")).into_values() {
            let truth = tapline_store::Reader::open(&path).unwrap().plan().truth().clone();
            for row in csv_rows(&sandbox.run(&format!("export {} verdicts", path.display())).expect(0).out) {
                let shoulder: u16 = row["shoulder"].parse().unwrap();
                let is_cracked = truth
                    .iter()
                    .any(|((tyre, of, _), &label)| tyre.as_str() == row["tyre"] && *of == shoulder && label);
                let counts = if is_cracked { &mut slab.cracked } else { &mut slab.sound };
                *counts.entry(row["verdict"].clone()).or_default() += 1;
            }
        }
        Some(slab)
    }

    fn cracked(&self, verdict: &str) -> usize {
        self.cracked.get(verdict).copied().unwrap_or(0)
    }

    fn sound(&self, verdict: &str) -> usize {
        self.sound.get(verdict).copied().unwrap_or(0)
    }
}

/// Catches cracked lines that pass, and sound ones that do not. The truth is inferred from a map published with the
/// data.
#[test]
fn fhwa_slab_with_inferred_truth() {
    let Some(slab) = Slab::scanned("fhwa-slab-bj") else { return };
    assert!(slab.auc >= 0.97, "{slab:?}");
    assert!(slab.cracked.values().sum::<usize>() == 2 && slab.cracked("PASS") == 0, "{slab:?}");
    assert!(slab.sound("REJECT") == 0 && slab.sound("RE-INSPECT") <= 1, "{slab:?}");
}

/// Catches the same on a slab with a crack at 6 cm.
#[test]
fn ntu_slab_with_a_crack_at_6_cm() {
    let Some(slab) = Slab::scanned("ntu-slab-06cm") else { return };
    assert!(slab.auc >= 0.99, "{slab:?}");
    assert!(slab.cracked.values().sum::<usize>() == 9 && slab.cracked("PASS") <= 1, "{slab:?}");
    assert_eq!(slab.sound("REJECT"), 0, "{slab:?}");
}

/// Catches the same on a slab with a crack at 10 cm.
#[test]
fn ntu_slab_with_a_crack_at_10_cm() {
    let Some(slab) = Slab::scanned("ntu-slab-10cm") else { return };
    assert!(slab.auc >= 0.97, "{slab:?}");
    assert!(slab.cracked.values().sum::<usize>() == 9 && slab.cracked("PASS") == 0, "{slab:?}");
    assert!(slab.sound("REJECT") == 0 && slab.sound("RE-INSPECT") <= 1, "{slab:?}");
}
