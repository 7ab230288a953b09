//! How many stations a host carries.

use serde_json::Value;

use crate::sandbox::Sandbox;

/// Catches a value out of its bounds that is measured with, and a refusal that does not name it.
#[test]
fn bad_values_are_named() {
    let sandbox = Sandbox::new();
    for (argument, named) in [
        ("--seconds 1", "--seconds is 1; it must be from 5"),
        ("--taps-per-s 0", "--taps-per-s is 0; it must be from 0.01"),
        ("--listening-percent 101", "--listening-percent is 101"),
        ("--folder nowhere", "--folder nowhere"),
        ("--stations 1", "--stations"),
    ] {
        let refused = sandbox.run(&format!("headroom {argument}"));
        assert!(refused.code != Some(0) && refused.err.contains(named), "{argument}: {refused:?}");
    }
}

/// Catches a resource that is left out or not measured, and one named that is not the scarcest.
#[test]
fn the_scarcest_resource_binds() {
    let sandbox = Sandbox::new();
    if !std::path::Path::new(env!("CARGO_BIN_EXE_tapline-lab")).with_file_name("tapline").is_file() {
        return tapline_testing::skip("the program tapline is not built");
    }
    let printed = sandbox.run("headroom --stations 2 --taps-per-s 20 --seconds 5 --json").expect(0).out;
    let found: Value = serde_json::from_str(&printed).unwrap();
    let number = |of: &Value, key: &str| of[key].as_f64().filter(|value| value.is_finite() && *value > 0.0).unwrap();
    let resources = found["resources"].as_array().unwrap();
    assert_eq!(resources.len(), 4, "{printed}");
    let least = resources.iter().min_by(|a, b| number(a, "stations").total_cmp(&number(b, "stations"))).unwrap();
    assert_eq!((&least["resource"], number(least, "stations")), (&found["binds"], number(&found, "stations")));
    for of in resources {
        let of_line = of["of_line"].as_f64().unwrap();
        assert!(of_line > 0.0 || of["resource"] != "memory", "four processes take none: {of}");
        let stations = ((number(of, "total") - of_line) / number(of, "of_station")).floor();
        assert!((stations - number(of, "stations")).abs() < 1.0, "{of}");
    }
    assert!(number(&found, "cpu_us_per_tap") > 1.0);
}
