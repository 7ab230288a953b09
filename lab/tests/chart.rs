//! `tapline-lab chart`: some of its panels, measured and drawn by the built program.

use std::collections::BTreeSet;

use tapline_testing::documents::csv_rows;

use crate::sandbox::{Sandbox, files};

/// Catches a page, picture or table that is not written, errors that do not follow from the seed, a default that is not marked,
/// progress without a time, and missing recordings without a notice. Costs differ from run to run.
#[test]
fn panels_are_measured_and_drawn() {
    let sandbox = Sandbox::new();
    let run = |out: &str| {
        let arguments =
            format!("chart --quick --panel spectrum,codecs,transport --recordings nowhere --seed 3 --out {out}");
        let done = sandbox.run(&arguments).expect(0);
        assert!(done.err.contains("expected") && done.err.contains("NOTICE: codecs: no recorded taps"), "{}", done.err);
        // In an unoptimised build packing may be off its front; the test only asks that this is printed.
        assert!(done.out.contains("codec = \"lz4\": o"), "{}", done.out);
        files(&sandbox.path(out))
    };
    let written = run("first");
    let names: BTreeSet<&str> = written.keys().map(String::as_str).collect();
    let panels = ["spectrum", "codecs", "transport"];
    let pictures = panels.iter().flat_map(|name| [format!("{name}.svg"), format!("{name}-narrow.svg")]);
    for name in pictures.chain(["index.html", "README.md", "points.csv", "codecs.csv"].map(str::to_owned)) {
        assert!(names.contains(name.as_str()), "{name} of {names:?}");
    }
    assert!(written["index.html"].contains("no recorded taps in nowhere"));

    let rows = csv_rows(&written["points.csv"]);
    for panel in panels {
        assert!(rows.iter().any(|row| row["panel"] == panel && row["is_default"] == "1"), "{panel} has no default");
        assert!(rows.iter().any(|row| row["panel"] == panel && row["on_front"] == "1"), "{panel} has no front");
    }
    for row in &rows {
        let at = |column: &str| row[column].parse::<f64>().unwrap_or_else(|_| panic!("{column}: {row:?}"));
        assert!(at("cost_low") <= at("cost") && at("cost") <= at("cost_high") && at("cost_low") > 0.0, "{row:?}");
    }
    let errors = |written: &std::collections::BTreeMap<String, String>| -> Vec<String> {
        let rows = csv_rows(&written["points.csv"]);
        rows.iter().filter(|row| row["panel"] != "transport").map(|row| row["error_by_seed"].clone()).collect()
    };
    assert_eq!(errors(&written), errors(&run("second")));
}

/// Catches a panel that is misspelt and silently left out, some panels that replace the whole atlas, and a folder of others that is
/// written into.
#[test]
fn a_part_of_the_panels_is_named_and_put_elsewhere() {
    let sandbox = Sandbox::new();
    let refused = sandbox.run("chart --quick --panel spectra --out here");
    assert!(refused.expect(1).err.contains("--panel is spectra; there are plans, recording,"));
    let refused = sandbox.run("chart --quick --panel spectrum");
    assert!(refused.expect(1).err.contains("only all panels together may replace docs/atlas"));
    assert!(!sandbox.path("docs").exists());
    std::fs::create_dir(sandbox.path("mine")).unwrap();
    std::fs::write(sandbox.path("mine/README.md"), "mine").unwrap();
    let refused = sandbox.run("chart --quick --panel spectrum --out mine");
    assert!(refused.expect(1).err.contains("mine exists already: give another name, or replace it with --force"));
}
