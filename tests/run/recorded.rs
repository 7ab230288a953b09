//! Recorded slabs with known or inferred cracks, scanned through the whole line with the configurations that ship.

use std::path::Path;

use crate::sandbox::Sandbox;

fn auc_of_index(set: &str) -> Option<f64> {
    let taps = tapline_testing::shared(set)?;
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(format!("{set}.toml"));
    let sandbox = Sandbox::new();
    let arguments =
        format!("run --taps {} --config {} --stations 2 --out slab --json", taps.display(), config.display());
    let summary = sandbox.run(&arguments).json(0);
    assert_eq!(summary["pace"]["gaps"], 0);
    summary["auc"]["index"].as_f64()
}

/// Its truth is inferred from a map published beside the data.
#[test]
fn fhwa_slab_with_inferred_truth() {
    let Some(auc) = auc_of_index("fhwa-slab-bj") else { return };
    assert!(auc >= 0.97, "{auc}");
}

#[test]
fn ntu_slab_with_a_crack_at_6_cm() {
    let Some(auc) = auc_of_index("ntu-slab-06cm") else { return };
    assert!(auc >= 0.99, "{auc}");
}

#[test]
fn ntu_slab_with_a_crack_at_10_cm() {
    let Some(auc) = auc_of_index("ntu-slab-10cm") else { return };
    assert!(auc >= 0.97, "{auc}");
}
