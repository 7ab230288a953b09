//! Verdicts over OPC UA, with an independent client.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::line::wires::{address_of, by_id, client, status, unreported};
use crate::line::{ROOM, slow_plant, tap_sets};
use crate::sandbox::Sandbox;
use crate::sandbox::running::{Running, until};

const TABLE: &str = "[line.opcua]\nlisten = \"127.0.0.1:0\"\n";

/// The next line of a client that has `key`.
fn next(client: &mut Running, key: &str) -> Value {
    loop {
        let line: Value = serde_json::from_str(&client.line()).unwrap();
        assert!(line.get("lost").is_none() || key == "lost", "{line}");
        if line.get(key).is_some() {
            return line;
        }
    }
}

/// Catches a result that differs from the verdict that is printed, or that is not offered until it is acknowledged, also by the next
/// line; an event without its result; and what stands at a station that is not cleared.
#[test]
fn results_are_offered_until_they_are_acknowledged() {
    let Some(python) = tapline_testing::python_with("asyncua") else { return };
    let sandbox = Sandbox::new();
    tap_sets(&sandbox);
    let station = |n: u32| format!("[[station]]\nnumber = {n}\nsource = \"folder\"\nfolder = \"inbox/{n}\"\n");
    let head = format!("[acquire]\ntaps_per_s = 50\n{ROOM}{TABLE}");
    sandbox.write("plant.toml", &format!("{head}{}{}", station(1), station(2)));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let address = address_of(&mut line, "OPC UA");
    let mut forgetful = client(&python, "opcua.py", &[&address, "--no-acknowledge"]);
    assert_eq!(next(&mut forgetful, "connected")["connected"], serde_json::json!(["Station1", "Station2"]));
    for (set, inbox) in [("A", "inbox/1"), ("B", "inbox/2")] {
        fs::rename(sandbox.path("sets").join(set), sandbox.path(inbox).join(set)).unwrap();
    }
    let printed = line.verdicts(2);
    let (mut results, mut events, mut states) = (Vec::new(), Vec::new(), Vec::new());
    while results.len() < 2 || events.len() < 2 {
        let said: Value = serde_json::from_str(&forgetful.line()).unwrap();
        if said.get("result").is_some() {
            results.push(said);
        } else if said.get("event").is_some() {
            events.push(said["event"].clone());
        } else if said["station"] == "Station1" {
            states.push(said);
        }
    }
    let printed = by_id(&printed);
    assert_eq!(events.iter().map(|id| id.as_str().unwrap()).collect::<std::collections::BTreeSet<_>>().len(), 2);
    for result in &results {
        let (meta, verdict) = (&result["result"], &result["verdict"]);
        assert_eq!(*verdict, printed[meta["id"].as_str().unwrap()]);
        assert_eq!(meta["casing"], verdict["casing"]);
        assert_eq!(meta["at_ms"].as_i64().unwrap(), verdict["at_ns"].as_i64().unwrap() / 1_000_000);
        let code = ["PASS", "RE-INSPECT", "REJECT"].iter().position(|word| verdict["verdict"] == *word).unwrap() + 1;
        assert_eq!(meta["code"], code);
        assert_eq!(meta["evaluation"], [1, 3, 2][code - 1]);
    }
    // Nothing but a judged casing has an evaluation or a result.
    for state in &states {
        let is_judged = state["state"] == "judged";
        assert_eq!(is_judged, state["evaluation"] != 0, "{state}");
        assert_eq!(is_judged, state["shows"] != "BadNoData", "{state}");
    }
    assert!(states.iter().any(|state| state["state"] == "busy"), "{states:?}");
    assert_eq!(unreported(&sandbox).len(), 2, "nobody has acknowledged them");
    drop(line.kill());
    next(&mut forgetful, "lost");

    // The next line offers the same results, and shows none as the last.
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let address = address_of(&mut line, "OPC UA");
    let mut client = client(&python, "opcua.py", &[&address]);
    let reported = [(); 2].map(|()| {
        let result = next(&mut client, "result");
        let answers = next(&mut client, "acknowledged");
        let id = &result["result"]["id"];
        assert_eq!(answers["first"], serde_json::json!([[], 0]), "{answers}");
        assert_eq!(answers["second"], serde_json::json!([[-1], -1]), "{answers}");
        assert_eq!(*id, answers["acknowledged"]);
        result["verdict"].clone()
    });
    assert_eq!(by_id(&reported), printed);
    assert_eq!(next(&mut client, "latest")["latest"], Value::Null, "the line has just started");
    until("nothing is left to report", || unreported(&sandbox).is_empty());
    until("nothing waits", || status(&sandbox)["receivers"][0]["waiting"] == 0);
    line.interrupt().expect(0);
}

/// Catches an endpoint that is not encrypted, a client that is let in without being trusted, and one without the password.
#[test]
fn who_is_let_in_is_trusted_and_has_the_password() {
    let Some(python) = tapline_testing::python_with("asyncua") else { return };
    let sandbox = Sandbox::new();
    sandbox.write_secret("user", "plant\nsecret\n");
    slow_plant(&sandbox, 1, 200.0, &format!("{TABLE}pki_folder = \"pki\"\ncredentials_file = \"user\"\n"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let address = address_of(&mut line, "OPC UA");
    let mut plain = client(&python, "opcua.py", &[&address, "--user", "plant", "secret"]);
    next(&mut plain, "lost");
    drop(plain.finish());
    let folder = sandbox.path("").display().to_string();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/line/wires/opcua.py");
    let start = |password: &str, is_trusted: bool| {
        let mut command = Command::new(&python);
        command.arg("-u").arg(&script).args([&address, "--user", "plant", password, "--pki", &folder]);
        let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = child.unwrap();
        let mut input = child.stdin.take().unwrap();
        let mut client = Running::of(child);
        next(&mut client, "certificate");
        if is_trusted {
            // As a person would, after the client was refused.
            for entry in fs::read_dir(sandbox.path("pki/rejected")).unwrap() {
                let entry = entry.unwrap();
                fs::rename(entry.path(), sandbox.path("pki/trusted").join(entry.file_name())).unwrap();
            }
        }
        writeln!(input, "go on").unwrap();
        client
    };
    for (password, is_trusted) in [("secret", false), ("wrong", true)] {
        let mut client = start(password, is_trusted);
        next(&mut client, "lost");
        drop(client.finish());
    }
    let mut client = start("secret", true);
    let reported = [(); 2].map(|()| next(&mut client, "result")["verdict"].clone());
    assert_eq!(by_id(&reported), by_id(&line.verdicts(2)));
    line.interrupt().expect(0);
}
