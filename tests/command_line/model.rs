//! `model contact`: the ladder of contact models on the command line.

use serde_json::Value;

use crate::sandbox::Sandbox;

const SCENE: &str = "model contact --velocity-m-per-s 1.85 --depth-mm 12.7 --length-mm 25.4 --restitution 0.5 --json";

fn number(answer: &Value, name: &str) -> f64 {
    answer[name].as_f64().unwrap_or_else(|| panic!("no number {name} in {answer:#}"))
}

fn names(answer: &Value) -> Vec<&str> {
    answer["flags"].as_array().unwrap().iter().map(|flag| flag["name"].as_str().unwrap()).collect()
}

/// Catches a rung, a unit or a scene that is mixed up between command line and model; the plate's numbers are scipy's.
#[test]
fn each_rung_answers() {
    let sandbox = Sandbox::new();
    let ask = |rung: &str| sandbox.run(&format!("{SCENE} --rung {rung}")).json(0);
    for (rung, f_max_n) in [("closed", 30.7), ("integral", 31.748), ("plate", 24.023_355), ("full", 22.909_271)] {
        let answer = ask(rung);
        assert_eq!(answer["rung"], rung);
        assert!(
            (number(&answer, "f_max_n") / f_max_n - 1.0).abs() < if rung == "closed" { 2e-3 } else { 1e-5 },
            "{answer:#}"
        );
    }
    let plate = ask("plate");
    for (name, value) in
        [("contact_time_s", 1.084_701_526e-3), ("d_max_m", 4.931_825_283e-4), ("restitution", 0.591_708_555)]
    {
        assert!((number(&plate, name) / value - 1.0).abs() < 1e-6, "{name} in {plate:#}");
    }
    assert_eq!(names(&plate), ["h_per_l"]);
    assert_eq!(names(&ask("full")), [""; 0]);
    assert_eq!(names(&ask("closed")), ["h_per_l", "restitution"]);
    assert_ne!(ask("full"), sandbox.run(&format!("{SCENE} --rung full --damping flores")).json(0));
    assert_ne!(ask("full"), sandbox.run(&format!("{SCENE} --rung full --mass-g 5 --e2-mpa 12")).json(0));
}

/// Catches a tolerance that is exceeded, and a choice that does not name its rung and the reason.
#[test]
fn a_tolerance_takes_the_cheapest_rung_that_keeps_it() {
    let sandbox = Sandbox::new();
    for (scene, tolerance, rung) in [
        ("--depth-mm 80 --length-mm 20", 0.1, "integral"),
        ("--depth-mm 80 --length-mm 20", 1e-3, "full"),
        ("--depth-mm 80 --length-mm 20 --restitution 1", 0.3, "closed"),
        ("--depth-mm 5 --length-mm 25 --velocity-m-per-s 0.5", 0.2, "plate"),
        ("--depth-mm 12.7 --length-mm 25.4", 1e-3, "full"),
    ] {
        let chosen = sandbox.run(&format!("model contact {scene} --tolerance {tolerance} --json")).json(0);
        let full = sandbox.run(&format!("model contact {scene} --rung full --json")).json(0);
        assert_eq!(chosen["rung"], rung, "{chosen:#}");
        assert!(chosen["why"].as_str().unwrap().starts_with(rung), "{chosen:#}");
        assert!(number(&chosen, "error") <= tolerance, "{chosen:#}");
        for name in ["f_max_n", "contact_time_s", "d_max_m", "restitution"] {
            let error = (number(&chosen, name) / number(&full, name) - 1.0).abs();
            assert!(error <= number(&chosen, "error"), "{name} is off by {error}: {chosen:#}");
        }
    }
    let text = sandbox.run("model contact --depth-mm 80 --tolerance 0.1").expect(0).out;
    assert!(text.contains("rung            integral") && text.contains("why             integral is within"), "{text}");
}

/// Catches an error that does not name the option as it was written, its value and its bound.
#[test]
fn bad_input_is_named() {
    let sandbox = Sandbox::new();
    for (option, value, bounds) in [
        ("--restitution", "0.05", "0.1 to 1"),
        ("--restitution", "1.01", "0.1 to 1"),
        ("--restitution", "NaN", "0.1 to 1"),
        ("--depth-mm", "-12.7", "1e-9 to 1e18"),
        ("--length-mm", "0", "1e-9 to 1e18"),
        ("--velocity-m-per-s", "0", "1e-12 to 1e15"),
        ("--velocity-m-per-s", "NaN", "1e-12 to 1e15"),
        ("--mass-g", "-4.5", "1e-9 to 1e18"),
        ("--e2-mpa", "inf", "1e-18 to 1e9"),
    ] {
        for rung in ["--rung closed", "--rung integral", "--rung plate", "--rung full", "--tolerance 0.01"] {
            let done = sandbox.run(&format!("model contact {option} {value} {rung}")).expect(1);
            let wanted = format!("{option} is {value}; it must lie in {bounds}");
            assert!(done.err.contains(&wanted) && done.out.is_empty(), "{wanted:?} is not in {done:?}");
        }
    }
    let done = sandbox.run("model contact --tolerance -1").expect(1);
    assert!(done.err.contains("--tolerance is -1; it must lie in 0 to 1"), "{done:?}");
    assert_eq!(sandbox.run("model contact --depth-mm 3 --json").json(0)["tolerance"], 0.05);
    sandbox.run("model contact --rung full --tolerance 0.1").expect(2);
    sandbox.run("model contact --rung best").expect(2);
    sandbox.run("model contact --depth-mm three --rung full").expect(2);
}
