//! Verdicts over MQTT, with a real broker.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;
use tapline_testing::program::Done;

use crate::line::page::{address_of, ask};
use crate::line::wires::{by_id, status, unreported};
use crate::line::{INBOX, ROOM, slow_plant, tap_sets};
use crate::sandbox::Sandbox;
use crate::sandbox::broker::{Broker, Heard, Subscriber, free_port};
use crate::sandbox::running::{Running, until};

/// Catches a verdict that is lost with a broker, reported under another id, or differs from the one that is printed; a line that waits
/// for a broker, or does not report one that is away; and a payload that is not what the schema says.
#[test]
fn every_verdict_arrives_although_the_broker_is_killed() {
    let sandbox = Sandbox::new();
    let Some(mut broker) = Broker::start(&sandbox, "allow_anonymous true") else { return };
    let subscriber = Subscriber::start(broker.port, &[]);
    let config = format!("[line.mqtt]\nbroker = \"127.0.0.1:{}\"\ntopic = \"plant/line 1\"\n", broker.port);
    slow_plant(&sandbox, 1000, 60.0, &config);
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let mut printed = Vec::new();
    for round in 1..=3 {
        printed.push(line.verdict());
        broker.kill();
        printed.extend(line.verdicts(2));
        until("it is reported", || {
            let status = status(&sandbox);
            status["troubles"].to_string().contains("mqtt: no connection to") && status["receivers"][0]["waiting"] != 0
        });
        assert!(!unreported(&sandbox).is_empty());
        broker.restart();
        until("it is connected again", || status(&sandbox)["receivers"][0]["trouble"].is_null());
        until("its alarms are over", || {
            let alarms = status(&sandbox)["alarms"].clone();
            let is_over = |alarm: &Value| alarm["text"].as_str().unwrap().starts_with("over: mqtt: no connection");
            let alarms = alarms.as_array().unwrap();
            // What the broker or the system said last does not matter: the alarm that began it is the one that is over.
            let stands = |alarm: &Value| alarm["text"].as_str().unwrap().starts_with("mqtt: no connection");
            alarms.iter().filter(|alarm| is_over(alarm)).count() == round && !alarms.iter().any(stands)
        });
    }
    let done = line.interrupt().expect(0);
    let logged =
        ["WARN mqtt: no connection", "WARN over: mqtt: no connection"].map(|text| done.err.matches(text).count());
    assert_eq!(logged, [3, 3], "each time once: {}", done.err);
    printed.extend(done.out.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()));
    assert_eq!(unreported(&sandbox), Vec::<String>::new(), "the last ones are reported before the line ends");
    let mut heard = BTreeMap::<String, Heard>::new();
    let mut messages = Vec::new();
    while heard.len() < printed.len() {
        let message = subscriber.next();
        messages.push(message.payload.clone());
        if message.topic.ends_with("/verdict") {
            assert!(!message.is_retained, "{message:?}");
            let id = message.payload["id"].as_str().unwrap().to_owned();
            let before = heard.insert(id, message.clone());
            assert!(before.is_none_or(|before| before.payload == message.payload), "{message:?}");
        }
    }
    for (id, verdict) in by_id(&printed) {
        let heard = &heard[&id];
        assert_eq!(heard.payload, verdict);
        assert_eq!(heard.topic, format!("plant/line 1/station/{}/verdict", verdict["station"]));
    }
    // What the line says last.
    messages.push(subscriber.wait_for(|message| message.payload["state"] == "no_signal").payload);
    check_schema(&messages);
}

/// Catches payloads that the published schema does not describe, and a schema that allows anything.
fn check_schema(messages: &[Value]) {
    let Some(python) = tapline_testing::python_with("jsonschema") else { return };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut child = Command::new(python)
        .arg(root.join("tests/line/wires/schema.py"))
        .arg(root.join("docs/verdict.schema.json"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    messages.iter().for_each(|message| writeln!(input, "{message}").unwrap());
    drop(input);
    let done = Done::from(child.wait_with_output().unwrap()).expect(0);
    assert_eq!(done.out.trim(), format!("{} messages", messages.len()));
}

/// Catches a last verdict that stays when the next casing has come or was refused, when the line ends, is killed or hangs, and after its next start.
#[test]
fn what_stands_at_a_station_is_cleared_when_it_is_in_doubt() {
    let sandbox = Sandbox::new();
    let Some(broker) = Broker::start(&sandbox, "allow_anonymous true") else { return };
    tap_sets(&sandbox);
    let mqtt = format!("{ROOM}[line.mqtt]\nbroker = \"127.0.0.1:{}\"\n", broker.port);
    sandbox.write("plant.toml", &format!("[acquire]\ntaps_per_s = 100\n{mqtt}{INBOX}"));
    let arrives = |set: &str| fs::rename(sandbox.path("sets").join(set), sandbox.path("inbox").join(set)).unwrap();
    let topic = ["-t", "tapline/station/1/now"];
    let follower = Subscriber::start(broker.port, &[]);
    let state =
        |message: &Heard, state: &str| message.topic.ends_with("station/1/now") && message.payload["state"] == state;
    let wait = |wanted: &str| follower.wait_for(|message| state(message, wanted));
    // One who subscribes now gets what is retained.
    let retained = || {
        Subscriber::start(broker.port, &topic)
            .wait_for(|heard| heard.topic.ends_with("station/1/now") && heard.is_retained)
    };

    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    assert_eq!(wait("ready").payload["verdict"], Value::Null);
    until("the inbox is made", || sandbox.path("inbox/failed").is_dir());
    arrives("A");
    assert_eq!(wait("busy").payload["verdict"], Value::Null);
    assert_eq!(wait("judged").payload["verdict"]["casing"], "A");
    assert_eq!(retained().payload["verdict"]["casing"], "A", "nothing else has come: it stands");
    arrives("B");
    assert_eq!(wait("busy").payload["verdict"], Value::Null, "the next casing has come");
    assert_eq!(wait("judged").payload["verdict"]["casing"], "B");
    until("the page shows it", || status(&sandbox)["stations"][0]["last"]["name"] == "B");
    fs::create_dir(sandbox.path("sets/bad")).unwrap();
    sandbox.write("sets/bad/scan.toml", "geometry = \"ring\"\n");
    sandbox.write("sets/bad/taps.csv", "file\n");
    let arrived = Instant::now();
    arrives("bad");
    assert_eq!(wait("ready").payload["verdict"], Value::Null, "the next casing is refused");
    assert!(arrived.elapsed() < Duration::from_secs(60), "not only when the verdict is too old");
    until("the page shows it no more", || status(&sandbox)["stations"][0]["last"].is_null());
    drop(line.kill());
    assert_eq!(wait("no_signal").payload["verdict"], Value::Null);
    assert_eq!(retained().payload["state"], "no_signal", "the last will is kept");

    // After a start the last verdict of the line before is not shown, although the station has no casing.
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    assert_eq!(wait("ready").payload["verdict"], Value::Null);
    line.signal(Signal::STOP);
    assert_eq!(wait("no_signal").payload["verdict"], Value::Null, "it hangs");
    line.signal(Signal::CONT);
    wait("ready");
    line.interrupt().expect(0);
    assert_eq!(wait("no_signal").payload["verdict"], Value::Null);
    assert_eq!(retained().payload["state"], "no_signal", "it said so as it ended");
}

/// Catches a broker that takes no verdict and is connected to several times a second, each time with an alarm.
#[test]
fn a_broker_that_refuses_a_verdict_is_one_trouble() {
    let sandbox = Sandbox::new();
    sandbox.write("acl", "topic write tapline/station/+/now\n");
    let rules = format!("allow_anonymous true\nacl_file {}", sandbox.path("acl").display());
    let Some(broker) = Broker::start(&sandbox, &rules) else { return };
    slow_plant(&sandbox, 1, 200.0, &format!("[line.mqtt]\nbroker = \"127.0.0.1:{}\"\n", broker.port));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    line.verdict();
    until("it is refused", || status(&sandbox)["troubles"].to_string().contains("it refuses what is published to"));
    for _ in 0..20 {
        assert!(status(&sandbox)["troubles"].to_string().contains("it refuses what is published to"));
        std::thread::sleep(Duration::from_millis(100));
    }
    let done = line.interrupt().expect(0);
    assert_eq!(done.err.matches("WARN mqtt: no connection").count(), 1, "{}", done.err);
}

/// Catches a connection that is not encrypted, one to a broker for which nobody vouches, and a password that is not sent.
#[test]
fn the_broker_must_be_vouched_for_and_is_acknowledged_who_connects() {
    let Some(sandbox) = Sandbox::with_certificates() else { return };
    let file = |name: &str| sandbox.path(name).display().to_string();
    sandbox.write_secret("user", "line-1\nsecret word\n");
    let hashed =
        Command::new("mosquitto_passwd").args(["-b", "-c", &file("passwords"), "line-1", "secret word"]).output();
    if hashed.is_err() {
        tapline_testing::skip("no mosquitto_passwd here");
        return;
    }
    let tls = format!(
        "allow_anonymous false\npassword_file {}\ncertfile {}\nkeyfile {}",
        file("passwords"),
        file("server.pem"),
        file("server.key")
    );
    let Some(broker) = Broker::start(&sandbox, &tls) else { return };
    let trusted = ["--cafile", &file("ca.pem"), "-u", "line-1", "-P", "secret word"];
    let subscriber = Subscriber::start(broker.port, &trusted);
    let config = |ca: &str, user: &str| {
        let port = broker.port;
        let user = if user.is_empty() { String::new() } else { format!("credentials_file = \"{user}\"\n") };
        slow_plant(
            &sandbox,
            1,
            200.0,
            &format!("[line.mqtt]\nbroker = \"127.0.0.1:{port}\"\nca_file = \"{ca}\"\n{user}"),
        );
    };
    let refused = |words: &str| {
        let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
        until(words, || status(&sandbox)["troubles"].to_string().contains(words));
        line.interrupt().expect(0);
    };
    config("other.pem", "user");
    refused("certificate");
    config("ca.pem", "");
    refused("refuse");
    config("ca.pem", "user");
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let reported = [(); 2].map(|()| subscriber.wait_for(|message| message.topic.ends_with("/verdict")).payload);
    assert_eq!(by_id(&reported).len(), 2);
    line.interrupt().expect(0);
}

/// Catches a verdict that counts as reported although nobody has subscribed to it, one that is kept where nobody has to, and monitoring
/// that does not show that verdicts wait.
#[test]
fn a_verdict_waits_for_a_subscriber() {
    let sandbox = Sandbox::new();
    let Some(broker) = Broker::start(&sandbox, "allow_anonymous true") else { return };
    let table = format!("[line.mqtt]\nbroker = \"127.0.0.1:{}\"\n", broker.port);
    slow_plant(&sandbox, 1, 400.0, &table);
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    let printed = line.verdicts(2);
    let word = "nobody subscribes to tapline/station/";
    until("it is reported", || status(&sandbox)["troubles"].to_string().contains(word));
    assert_eq!(unreported(&sandbox).len(), 2);
    let health = ask(&address, "/healthz", "");
    assert!(health.code == 503 && health.body.contains(word), "{health:?}");
    let is_counted = || ask(&address, "/metrics", "").body.contains("\ntapline_verdicts_waiting{receiver=\"mqtt\"} 2");
    until("both wait", is_counted);
    assert!(sandbox.run("status --out out").expect(0).out.contains("wait to be acknowledged: mqtt 2"));
    // Two more attempts, of which the log says nothing.
    std::thread::sleep(Duration::from_millis(2500));
    let done = line.interrupt().expect(0);
    assert_eq!(done.err.matches("nobody subscribes").count(), 1, "{}", done.err);
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let subscriber = Subscriber::start(broker.port, &[]);
    let reported = [(); 2].map(|()| subscriber.wait_for(|message| message.topic.ends_with("/verdict")).payload);
    assert_eq!(by_id(&reported), by_id(&printed));
    until("nothing is left to report", || unreported(&sandbox).is_empty());
    line.assert_runs();
    line.interrupt().expect(0);
    drop(subscriber);

    let other = Sandbox::new();
    slow_plant(&other, 1, 400.0, &format!("{table}needs_subscriber = false\n"));
    let mut line = Running::start(&other, "line --config plant.toml --out out --json");
    line.verdicts(2);
    until("nothing is left to report", || unreported(&other).is_empty());
    line.interrupt().expect(0);
}

/// Catches a line that does not start, or does not end, because nobody listens where its broker should be.
#[test]
fn a_broker_that_is_not_there_changes_nothing() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 200.0, &format!("[line.mqtt]\nbroker = \"127.0.0.1:{}\"\n", free_port()));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 4");
    line.verdicts(4);
    line.finish().expect(0);
    assert_eq!(unreported(&sandbox).len(), 4);
}
