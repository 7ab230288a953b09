//! `docs/commands.md`: what each verb prints with `--json`.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use tapline_testing::documents::{docs, text};

use crate::command_line::small;
use crate::sandbox::Sandbox;
use crate::sandbox::nats::NatsServer;
use crate::sandbox::running::Running;

/// The rows of the page's table: verb and thing, and the keys of its value.
fn shapes() -> BTreeMap<String, BTreeSet<String>> {
    let page = text(&docs("commands.md"));
    let rows = page.lines().skip_while(|line| *line != "## JSON").filter(|line| line.starts_with("| `"));
    rows.map(|row| {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [verb, of, keys] = cells[..] else { panic!("{row}") };
        let keys = keys.split('`').skip(1).step_by(2).map(str::to_owned).collect();
        (format!("{}: {of}", verb.trim_matches('`')), keys)
    })
    .collect()
}

/// Catches a key that the page does not have, one that is not printed any more, and a verb whose output is not a JSON value a line.
#[test]
fn the_page_has_the_shapes_of_every_verb() {
    let (sandbox, mut shapes) = (Sandbox::new(), shapes());
    sandbox.write("c.toml", &small(1));
    let run = values(&sandbox.run("run --config c.toml --stations 2 --out x --json").expect(0).out);
    check(&mut shapes, "run: a casing", &run[0]);
    check(&mut shapes, "run: the end", run.last().unwrap());
    sandbox.run("import --example e").expect(0);
    sandbox.run("reprocess x/SIM-0002.h5").expect(0);
    for (of, command) in [
        ("export: a table", "export x verdicts --out v.csv --json"),
        ("export: taps", "export x taps --out taps --json"),
        ("import: the tap set", "import e/recordings/A-17_1_000.wav --config e/import.toml --out imported --json"),
        ("reference: the reference", "reference x --shoulder SIM-0002/1 --shoulder SIM-0002/2 --out r.json --json"),
        ("verify: an archive", "verify x/SIM-0001.h5 --json"),
        ("verify: the end, of many", "verify x --json"),
        ("reprocess: an archive", "reprocess x/SIM-0001.h5 --json"),
        ("repack: an archive", "repack x/SIM-0001.h5 --codec none --out y.h5 --json"),
        ("explain: an archive", "explain x/SIM-0001.h5 --shoulder SIM-0001/1 --location 3 --json"),
        ("diff: a pair", "diff x/SIM-0001.h5 x/SIM-0001.h5 --json"),
        ("diff: the end, of folders", "diff x x --json"),
        ("report: a page", "report x --out pages --json"),
        (
            "calibrate: a channel",
            "calibrate state --channel force --full-scale-v 5 --sensitivity-mv 22.5 --out k.toml --json",
        ),
        ("model contact: a contact", "model contact --rung closed --json"),
    ] {
        let printed = values(&sandbox.run(command).expect(0).out);
        check(&mut shapes, of, printed.last().unwrap_or_else(|| panic!("{command} prints nothing")));
    }
    let table = &values(&sandbox.run("model table 4 --json").expect(0).out)[0];
    assert!(table.as_array().unwrap().len() > 10, "{table}");

    let mut rig = Running::start(&sandbox, "rig --listen 127.0.0.1:0 --json");
    check(&mut shapes, "rig: the beginning", &serde_json::from_str(&rig.line()).unwrap());
    check(&mut shapes, "rig: the end", &values(&rig.interrupt().out)[0]);

    sandbox.write(
        "line.toml",
        "[[station]]\nnumber = 1\nsource = \"simulated\"\n[scan]\nvelocities_m_per_s = [1.0]\nlocations = 20\n",
    );
    let mut line = Running::start(&sandbox, "line --config line.toml --out results --json");
    check(&mut shapes, "line: a casing", &line.verdict());
    let status = &values(&sandbox.run("status --out results --json").expect(0).out)[0];
    check(&mut shapes, "status: the line", status);
    // Numbers whose place alone would say what they are.
    let [bounds, counts] = ["bounds_s", "counts"].map(|key| status["latency"][key].as_array().map(Vec::len));
    assert!(bounds.is_some_and(|bounds| counts == Some(bounds + 1)), "{status}");
    let by_verdict = &status["stations"][0]["tally"]["verdicts"];
    assert!(["pass", "re_inspect", "reject"].iter().all(|key| by_verdict[key].is_u64()), "{status}");
    drop(line.interrupt());
    match NatsServer::start(&sandbox, "") {
        Some(server) => {
            let mut collector = Running::start(&sandbox, &format!("collect centre --from {} --json", server.address));
            let sent = sandbox.run(&format!("uplink x --to {} --site s --once --json", server.address)).expect(0);
            check(&mut shapes, "uplink: a file", &values(&sent.out)[0]);
            check(&mut shapes, "collect: a file", &serde_json::from_str(&collector.line()).unwrap());
            drop(collector.interrupt().expect(0));
        }
        None => shapes.retain(|of, _| !["uplink: a file", "collect: a file"].contains(&of.as_str())),
    }
    // Whether there is a sound card depends on the machine.
    shapes.remove("devices: a device");
    assert!(shapes.is_empty(), "the page has {shapes:?}, which no verb printed");
}

fn values(text: &str) -> Vec<Value> {
    let of_line = |line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {text}"));
    text.lines().map(of_line).collect()
}

fn check(shapes: &mut BTreeMap<String, BTreeSet<String>>, of: &str, value: &Value) {
    let keys = value.as_object().unwrap().keys().cloned().collect();
    let documented = shapes.remove(of).unwrap_or_else(|| panic!("docs/commands.md has no row {of:?}"));
    assert_eq!(documented, keys, "{of}");
}
