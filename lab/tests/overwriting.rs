//! Existing files stay, unless `--force` is given.

use std::fs;

use serde_json::Value;

use crate::sandbox::Sandbox;

/// Catches a figure that is overwritten without having been asked for, an error that does not name it, and a file that is not
/// printed.
#[test]
fn figures_are_overwritten_only_by_force() {
    let sandbox = Sandbox::new();
    sandbox.run("figures --figure 26 --out drawn").expect(0);
    let path = sandbox.path("drawn/fig26.csv");
    fs::write(&path, "kept").unwrap();
    let refused = sandbox.run("figures --figure 26 --out drawn").expect(1);
    assert!(refused.err.contains("drawn/fig26") && refused.err.contains("--force"), "{refused:?}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "kept");
    let printed = sandbox.run("figures --figure 26 --out drawn --force --json").expect(0).out;
    let files: Vec<Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(files[1]["file"], "drawn/fig26.csv", "{printed}");
    assert_ne!(fs::read_to_string(&path).unwrap(), "kept");
}
