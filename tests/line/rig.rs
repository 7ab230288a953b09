//! What the casings of a station have in common points to its rig.

use crate::sandbox::Sandbox;
use crate::sandbox::running::{Running, until};

/// Catches a microphone that hears more noise than it did for the reference, unreported in the log, in the status, on
/// the page of the shift or at the end of a run; and an unchanged rig that is accused because casings are cracked.
#[test]
fn a_rig_that_has_changed_is_reported() {
    let sandbox = Sandbox::new();
    let run = |name: &str, simulation: &str, crack: &str, reference: &str| {
        let tyres = (1..=6).map(|k| format!("[[scan.tyre]]\nserial = \"A-{k}\"\n{crack}")).collect::<String>();
        sandbox.write(&format!("{name}.toml"), &format!("[simulation]\n{simulation}{tyres}"));
        sandbox.run(&format!("run --config {name}.toml --out {name} --reference {reference}")).expect(0).out
    };
    run("sound", "", "", "self");
    sandbox.run("reference sound --out sound.json").expect(0);
    let noise = "sound_noise_v = 0.016\n";
    let said = "station 1: scatter_off on 6 casings, A-1 to A-6: ";
    let noisy = run("noisy", noise, "", "sound.json");
    assert!(noisy.contains(said) && noisy.contains("check the rig"), "{noisy}");
    let crack =
        |shoulder| format!("{{ shoulder = {shoulder}, first_location = 30, location_count = 6, depth_mm = 5.0 }}");
    let cracked = run("cracked", "", &format!("crack = [{}, {}]\n", crack(1), crack(2)), "sound.json");
    assert!(cracked.matches("REJECT").count() >= 12 && !cracked.contains("check the rig"), "{cracked}");

    let station = "[[station]]\nnumber = 3\nsource = \"simulated\"\n";
    sandbox.write("plant.toml", &format!("[simulation]\n{noise}[fuse]\nreference = \"sound.json\"\n{station}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    // Every other casing of a simulated station is cracked.
    line.verdicts(8);
    line.wait_for_log(&["WARN", "scatter_off on 4 casings, S3-", "check the rig"]);
    until("the sign", || {
        let status = sandbox.run("status --out out --json").json(0);
        let station = &status["stations"][0];
        let names: Vec<&str> =
            station["signs"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
        names.contains(&"scatter_off") && station["whole"]["scatter"]["pr"].as_f64().unwrap() > 1.5
    });
    assert!(sandbox.run("status --out out").expect(0).out.contains("CHECK station 3: scatter_off on "));
    line.interrupt().expect(0);
    for (archives, is_off) in [("noisy", true), ("cracked", false)] {
        sandbox.run(&format!("report {archives} --out pages-{archives}")).expect(0);
        let page = std::fs::read_to_string(sandbox.path(&format!("pages-{archives}/shift.html"))).unwrap();
        assert_eq!(page.contains(said), is_off, "{archives}");
        assert!(page.contains(">Station 1: level<") && page.contains(">Station 1: scatter<"), "{archives}");
    }
}
