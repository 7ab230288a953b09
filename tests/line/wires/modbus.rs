//! Verdicts over Modbus TCP, with an independent client.

use serde_json::{Value, json};

use crate::line::slow_plant;
use crate::line::wires::{address_of, by_id, client, unreported};
use crate::sandbox::Sandbox;
use crate::sandbox::running::{Running, until};

const TABLE: &str = "[line.modbus]\nlisten = \"127.0.0.1:0\"\n";

fn said(client: &mut Running) -> Value {
    let line: Value = serde_json::from_str(&client.line()).unwrap();
    assert!(line.get("lost").is_none(), "{line}");
    line
}

/// Catches a verdict that is lost, changed, reported twice or again after it was acknowledged, and one that stands when the next casing
/// has come.
#[test]
fn a_controller_acknowledges_each_verdict() {
    let Some(python) = tapline_testing::python_with("pymodbus") else { return };
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 60.0, TABLE);
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let address = address_of(&mut line, "Modbus");
    let mut forgetful = client(&python, "modbus.py", &[&address, "2", "--no-acknowledge"]);
    let printed = line.verdicts(4);
    let (mut mails, mut states) = (Vec::new(), Vec::new());
    while mails.len() < 2 || !states.iter().any(|now: &Value| now["count"] == 2) {
        let said = said(&mut forgetful);
        match said.get("mail") {
            Some(mail) => mails.push(mail.clone()),
            None => states.extend(said.get("now").filter(|now| now["station"] == 1).cloned()),
        }
    }
    // The first of each station stays until it is acknowledged, whatever stands there.
    let first = |station: u64| printed.iter().find(|verdict| verdict["station"] == station).unwrap();
    let number = |station: u64| {
        let mail = mails.iter().find(|mail| mail["id"] == first(station)["id"]);
        mail.and_then(|mail| mail["number"].as_u64()).unwrap_or_else(|| panic!("{mails:?}"))
    };
    let numbers = [1, 2].map(number);
    assert!(numbers.iter().all(|&number| number > 0), "{mails:?}");
    assert!(states.iter().any(|now| now["busy"] == 1), "{states:?}");
    for now in &states {
        let marks = ["ok", "re_inspect", "not_ok"].map(|key| now[key].as_u64().unwrap());
        // At most one mark, and none while a casing is under way.
        assert!(marks.iter().sum::<u64>() <= now["ready"].as_u64().unwrap(), "{now}");
        assert_eq!(
            now["ready"].as_u64().unwrap() + now["busy"].as_u64().unwrap(),
            u64::from(now["beats"] == true),
            "{now}"
        );
    }
    let last = printed.iter().rev().find(|verdict| verdict["station"] == 1).unwrap();
    let mark = match last["verdict"].as_str().unwrap() {
        "PASS" => "ok",
        "REJECT" => "not_ok",
        _ => "re_inspect",
    };
    assert_eq!(states.last().unwrap()[mark], 1, "{states:?}");
    assert_eq!(unreported(&sandbox).len(), 4);
    drop(line.kill());

    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let address = address_of(&mut line, "Modbus");
    let mut client = client(&python, "modbus.py", &[&address, "2"]);
    let mut mails = Vec::new();
    while mails.len() < 4 {
        let said = said(&mut client);
        mails.extend(said.get("mail").cloned());
        // Verdicts of the earlier line are no longer current.
        if let Some(now) = said.get("now") {
            assert_eq!(
                [&now["ok"], &now["re_inspect"], &now["not_ok"], &now["count"]],
                [0, 0, 0, 0].map(|k| json!(k)).each_ref()
            );
        }
    }
    // A controller that repeats what it wrote to the earlier line acknowledges nothing of this one.
    assert!(mails.iter().all(|mail| numbers.iter().all(|&number| mail["number"] != number)), "{numbers:?} {mails:?}");
    let (mails, printed) = (by_id(&mails), by_id(&printed));
    assert!(mails.keys().eq(printed.keys()), "{mails:?}");
    for (id, mail) in &mails {
        let verdict = &printed[id];
        assert_eq!((&mail["verdict"], &mail["casing"]), (&verdict["verdict"], &verdict["casing"]));
        assert_eq!(mail["at_ms"].as_i64().unwrap(), verdict["at_ns"].as_i64().unwrap() / 1_000_000);
    }
    until("nothing is left to report", || unreported(&sandbox).is_empty());
    line.interrupt().expect(0);
}

/// Catches a heartbeat that goes on, and a state that stands, while the line itself hangs.
#[test]
fn a_line_that_hangs_has_no_heartbeat() {
    let Some(python) = tapline_testing::python_with("pymodbus") else { return };
    if !rustix::process::geteuid().is_root() {
        return tapline_testing::skip("only root may hold a thread of another process");
    }
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 100.0, TABLE);
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let address = address_of(&mut line, "Modbus");
    let mut controller = client(&python, "modbus.py", &[&address, "2"]);
    let mut wait_for = |wanted: &dyn Fn(&Value) -> bool| loop {
        if let Some(now) = said(&mut controller).get("now").filter(|now| wanted(now)) {
            return now.clone();
        }
    };
    wait_for(&|now| now["busy"] == 1);
    let mut holder = client(&python, "hold.py", &[&line.child().id().to_string()]);
    assert_eq!(holder.line(), "held");
    let hung = wait_for(&|now| now["beats"] == false);
    let none = ["ready", "busy", "ok", "re_inspect", "not_ok"].map(|key| hung[key].as_u64());
    assert_eq!(none, [Some(0); 5], "{hung}");
    drop(holder.kill());
    wait_for(&|now| now["beats"] == true);
    line.interrupt().expect(0);
}
