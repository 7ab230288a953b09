//! What the program generates: completions, manual pages, the example of a configuration.

use std::fs;

use crate::sandbox::Sandbox;

/// Catches completions without a verb or an option.
#[test]
fn every_shell_has_completions() {
    let sandbox = Sandbox::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let text = sandbox.run(&format!("completions {shell}")).expect(0).out;
        for word in ["reprocess", "from-samples", "quiet"] {
            assert!(text.contains(word), "{word} is not in the completions for {shell}");
        }
    }
}

/// Catches a verb without a page, and a page that is no manual page.
#[test]
fn every_verb_has_a_manual_page() {
    let sandbox = Sandbox::new();
    sandbox.run("man pages").expect(0);
    let page = |name: &str| fs::read_to_string(sandbox.path(&format!("pages/{name}.1"))).unwrap();
    let help = sandbox.run("--help").expect(0).out;
    let verbs = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    // The description of a verb may continue on a line that is indented more.
    let begins = |line: &&str| line.starts_with("  ") && !line.starts_with("   ");
    let verbs: Vec<&str> = verbs.lines().filter(begins).filter_map(|line| line.split_whitespace().next()).collect();
    assert!(verbs.contains(&"line") && verbs.len() > 15, "{verbs:?}");
    for verb in verbs.into_iter().filter(|&verb| verb != "help") {
        assert!(page(&format!("tapline-{verb}")).contains(".TH"), "{verb}");
    }
    assert!(page("tapline-model-contact").contains("tapline model contact"));
    assert!(page("tapline-verify").contains("quiet"), "an option that every verb has");
    assert!(!sandbox.path("pages/tapline-help.1").exists() && !sandbox.path("pages/tapline-model-help.1").exists());
    assert!(!sandbox.path("pages/tapline-stage.1").exists(), "nobody starts a stage");
}

/// Catches an example that no run accepts, and a wrong one that is accepted, or refused without naming what is
/// wrong.
#[test]
fn the_example_of_a_configuration_is_one() {
    const PLACE: &str = "wrong.toml is not a configuration: TOML parse error at line";
    let sandbox = Sandbox::new();
    sandbox.write("example.toml", &sandbox.run("config --example").expect(0).out);
    let needs = ["`tapline line` needs at least one [[station]]\n", "`tapline line` needs a [fuse] reference\n"];
    let said = sandbox.run("config --check example.toml").expect(0).out;
    assert_eq!(said, format!("example.toml is a configuration\n{}{}", needs[0], needs[1]));
    let station = "[[station]]\nnumber = 1\nsource = \"simulated\"\n";
    let reference = "[fuse]\nreference = \"self\"\n";
    for (config, lacking) in
        [(station.to_owned(), needs[1]), (reference.to_owned(), needs[0]), (format!("{station}{reference}"), "")]
    {
        sandbox.write("some.toml", &config);
        let said = sandbox.run("config --check some.toml").expect(0).out;
        assert_eq!(said, format!("some.toml is a configuration\n{lacking}"));
    }
    sandbox.write("none.json", "{}");
    for (wrong, named) in [
        ("[fuse]\nre_inspect_rate = 2.0\n", &["re_inspect_rate"][..]),
        ("[fuse]\nreference = \"nowhere.json\"\n", &["cannot read the reference nowhere.json"]),
        ("[fuse]\nreference = \"none.json\"\n", &["cannot use the reference none.json"]),
        ("[process]\nf_c_hz = -1.0\n", &["wrong.toml", "process.f_c_hz = -1 Hz"]),
        ("[scan]\nlocations = 0\n", &["scan.locations is 0"]),
        ("[scan]\nrepetitions = 0\n", &["scan.repetitions is 0"]),
        ("[acquire]\ntaps_per_s = 0.0\n", &["acquire.taps_per_s is 0"]),
        ("[simulation]\nsample_count = 1\n", &["sample_count"]),
        ("[capture]\nbits = 20\n", &["capture.bits is 20"]),
        ("[line]\non_verdict = \"\"\n", &["line.on_verdict = \"\""]),
        ("[[station]]\nnumber = 1\nsource = \"simulated\"\ncasings = 0\n", &["station 1: casings is 0"]),
        ("[[scan.tyre]]\nserial = \"S\"\nstation = 1\ncrack = [{ depth_mm = 900.0 }]\n", &["crack 1: depth_mm is 900"]),
        // For these the place in the file is shown, in several lines.
        ("[fuse]\nindex = \"fusde\"\n", &[PLACE, "unknown variant `fusde`", "`fused`"]),
        ("[process.quality]\nsnr_least = 1.0\n", &[PLACE, "unknown field `snr_least`", "snr_min"]),
        ("[scam]\n", &[PLACE, "scam"]),
        ("[scan\n", &[PLACE, "[scan"]),
    ] {
        sandbox.write("wrong.toml", wrong);
        for verb in ["config --check wrong.toml", "run --config wrong.toml --out none"] {
            let done = sandbox.run(verb).expect(1);
            assert!(named.iter().all(|part| done.err.contains(part)), "{verb}: {}", done.err);
            assert!(done.err.lines().count() == 1 || named[0] == PLACE, "{verb}: {}", done.err);
            assert!(!sandbox.path("none").exists(), "{verb}: {wrong}");
        }
    }
    let done = sandbox.run("run --config gone.toml --out none").expect(1);
    assert!(done.err.contains("gone.toml") && !sandbox.path("none").exists(), "{done:?}");
    // A tyre at a station that does not exist yet: `--stations` may add it.
    sandbox.write("two.toml", "[[scan.tyre]]\nserial = \"S\"\nstation = 2\n");
    let said = sandbox.run("config --check two.toml").expect(0).out;
    assert!(said.contains("`tapline run` needs --stations 2\n"), "{said}");
    // Recorded tyres may have what simulated ones do not.
    sandbox.write("other.toml", "[fuse]\nreference = \"A-17/1\"\n");
    let said = sandbox.run("config --check other.toml").expect(0).out;
    assert!(said.contains("`tapline run` takes it only for recorded taps: the reference is A-17/1"), "{said}");
    let done = sandbox.run("run --config other.toml --out none").expect(1);
    assert!(done.err.contains("the reference is A-17/1") && !sandbox.path("none").exists(), "{done:?}");
    // The stations of a line are in its configuration.
    sandbox.write("plant.toml", &format!("{station}{reference}[[scan.tyre]]\nserial = \"S\"\nstation = 2\n"));
    let said = sandbox.run("config --check plant.toml").expect(0).out;
    assert_eq!(said, "plant.toml is a configuration\n");
    // A line may be given its reference later; the rest is checked all the same.
    sandbox.write("other.toml", &format!("{station}[process]\nf_top_hz = 50000.0\n"));
    let said = sandbox.run("config --check other.toml").expect(0);
    assert!(said.err.contains("f_top_hz = 50000 Hz: the band ends at 20480 Hz"), "{said:?}");
    sandbox.write("other.toml", &format!("{station}[line.mqtt]\nbroker = \"127.0.0.1:1\"\nca_file = \"none.pem\"\n"));
    let done = sandbox.run("config --check other.toml").expect(1);
    assert!(done.err.contains("none.pem"), "{done:?}");
    sandbox.write("other.toml", &format!("{station}[scan]\noffsets_mm = [5.0]\n"));
    let said = sandbox.run("config --check other.toml").expect(0);
    assert!(said.err.contains("nothing is tapped at the belt edge"), "{said:?}");
    // Results would be tap sets of the station.
    sandbox.write("other.toml", &format!("[[station]]\nnumber = 3\nsource = \"folder\"\nfolder = \"in\"\n{reference}"));
    let done = sandbox.run("line --config other.toml --out in/results").expect(1);
    assert!(done.err.contains("--out in/results is within the folder that station 3 watches"), "{done:?}");
    assert!(!sandbox.path("in").exists(), "nothing was made");
    // A line finds the same problems before it begins.
    sandbox.write("other.toml", &format!("{station}[fuse]\nreference = \"A-17/1\"\n"));
    for verb in ["config --check other.toml", "line --config other.toml --out none"] {
        let done = sandbox.run(verb).expect(1);
        assert!(done.err.contains("the reference is A-17/1"), "{verb}: {}", done.err);
    }
    sandbox.run("config").expect(2);
    sandbox.run("config --check two.toml --example").expect(2);
}
