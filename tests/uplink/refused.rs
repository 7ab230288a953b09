//! Files that a centre does not take, and connections that are not made.

use std::fs;
use std::path::Path;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::bend;
use crate::sandbox::nats::NatsServer;
use crate::sandbox::running::Running;
use crate::uplink::{files, made};

/// Catches a damaged file that counts as received, one that replaces another of its name, and a refusal that nobody hears of or that
/// cannot be taken back.
#[test]
fn a_file_that_is_not_whole_or_not_the_same_is_refused() {
    let sandbox = Sandbox::new();
    let Some(server) = NatsServer::start(&sandbox, "") else { return };
    let made = made(&sandbox, 3);
    bend(&sandbox.path("made/C2.h5"), "taps/header", 9 * 8);
    fs::create_dir_all(sandbox.path("centre/a")).unwrap();
    fs::copy(sandbox.path("made/C1.h5"), sandbox.path("centre/a/C3.h5")).unwrap();
    let to = format!("uplink made --to {} --site a --once --json", server.address);
    let collector = Running::start(&sandbox, &format!("collect centre --from {}", server.address));
    let done = sandbox.run(&to).expect(3);
    let lines: Vec<serde_json::Value> = done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |name: &str| lines.iter().find(|line| line["name"] == name).unwrap();
    assert_eq!((&of("a/C1.h5")["kind"], &of("a/C1.h5")["why"]), (&"received".into(), &serde_json::Value::Null));
    for (name, why) in [("a/C2.h5", "the seal does not match"), ("a/C3.h5", "another file of this name")] {
        assert_eq!(of(name)["kind"], "refused");
        assert!(of(name)["why"].as_str().unwrap().contains(why), "{}", of(name));
    }
    assert!(done.err.contains("ERROR made/C2.h5 is not taken by the centre"), "{}", done.err);

    // Reported again, but not sent again, unless it is asked for, or is another file by now.
    assert_eq!(sandbox.run(&to).expect(3).out.matches("\"refused\"").count(), 2);
    fs::write(sandbox.path("made/C2.h5"), &made[Path::new("C2.h5")]).unwrap();
    fs::remove_file(sandbox.path("centre/a/C3.h5")).unwrap();
    let done = sandbox.run(&to).expect(3);
    assert_eq!(["\"refused\"", "\"received\""].map(|kind| done.out.matches(kind).count()), [1, 1], "{}", done.out);
    assert_eq!(sandbox.run(&format!("{to} --again")).expect(0).out.matches("\"received\"").count(), 1);
    // A receipt for one file is none for another of its name, and is not taken back by it.
    fs::create_dir(sandbox.path("other")).unwrap();
    fs::copy(sandbox.path("made/C2.h5"), sandbox.path("other/C1.h5")).unwrap();
    let other = to.replace("made", "other");
    for again in ["", " --again"] {
        let done = sandbox.run(&format!("{other}{again}")).expect(3);
        assert!(done.out.contains("another file of this name"), "{}", done.out);
        sandbox.run(&to).expect(0);
    }
    assert!(files(&sandbox.path("centre/a")) == made);
    let done = collector.interrupt().expect(0);
    assert_eq!((done.out.matches("received ").count(), done.out.matches("REFUSED ").count()), (3, 2), "{}", done.out);
    let none = sandbox.run(&format!("uplink nowhere --to {} --site a", server.address)).expect(1);
    assert!(none.err.contains("nowhere is no folder"), "{}", none.err);
}

/// Catches a file that cannot be read, or files that were taken away while they waited, for which all others wait; and results of judging
/// again that are sent as casings.
#[test]
fn what_cannot_be_sent_keeps_no_other_file_back() {
    let sandbox = Sandbox::new();
    let Some(server) = NatsServer::start(&sandbox, "") else { return };
    let made = made(&sandbox, 1);
    let archive = &made[Path::new("C1.h5")];
    fs::create_dir_all(sandbox.path("line")).unwrap();
    let put = |name: &str| fs::write(sandbox.path("line").join(name), archive).unwrap();
    let waiting = ["A1.h5", "A2.h5", "A3.h5", "A4.h5", "A5.h5", "A6.h5", "A7.h5", "A8.h5"];
    waiting.into_iter().for_each(put);
    let mut sender = Running::start(&sandbox, &format!("uplink line --to {} --site a -v", server.address));
    waiting.iter().for_each(|_| sender.wait_for_log(&["sent a/A"]));
    waiting.iter().for_each(|name| fs::remove_file(sandbox.path("line").join(name)).unwrap());
    // Memory of a process at address 0, which is no file that can be read.
    std::os::unix::fs::symlink("/proc/self/mem", sandbox.path("line/B.h5")).unwrap();
    let printed = sandbox.run("reprocess made/C1.h5 --json").expect(0);
    let results = fs::read_dir(sandbox.path("made")).unwrap().flatten().map(|entry| entry.path());
    let results = results.filter(|path| path.to_string_lossy().matches('.').count() > 2).find(|path| path.is_file());
    let results = results.unwrap_or_else(|| panic!("{}", printed.out));
    fs::copy(&results, sandbox.path("line").join(results.file_name().unwrap())).unwrap();
    put("D.h5");
    sender.wait_for_log(&["ERROR not sent: cannot read line/B.h5"]);
    sender.wait_for_log(&["sent a/D.h5"]);
    let collector = Running::start(&sandbox, &format!("collect centre --from {} --once", server.address));
    assert_eq!(collector.finish().expect(0).out.matches("received ").count(), 9);
    assert_eq!(sender.interrupt().expect(0).out.matches("delivered ").count(), 1);
    let there = files(&sandbox.path("centre/a"));
    assert!(there.len() == 9 && there.values().all(|bytes| bytes == archive), "{:?}", there.keys());
}

/// Catches a connection that is not encrypted, one to a server for which nobody vouches, and a password that is not sent.
#[test]
fn the_server_must_be_vouched_for_and_knows_who_connects() {
    let Some(sandbox) = Sandbox::with_certificates() else { return };
    let file = |name: &str| sandbox.path(name).display().to_string();
    let more = format!(
        "tls {{ cert_file: \"{}\", key_file: \"{}\" }}\nauthorization {{ user: press-1, password: \"secret word\" }}",
        file("server.pem"),
        file("server.key")
    );
    let Some(server) = NatsServer::start(&sandbox, &more) else { return };
    let made = made(&sandbox, 1);
    for (name, text) in [("user", "press-1\nsecret word\n"), ("stranger", "press-1\nwrong\n")] {
        sandbox.write_secret(name, text);
    }
    let collect = |more: &str| Running::start(&sandbox, &format!("collect centre --from {} {more}", server.address));
    for (more, why) in [
        ("--ca-file other.pem --credentials-file user", "certificate"),
        ("--ca-file ca.pem --credentials-file stranger", "authorization violation"),
        ("--ca-file ca.pem", "authorization violation"),
    ] {
        let mut collector = collect(more);
        collector.wait_for_log(&["no connection to nats://127.0.0.1", why]);
        drop(collector.interrupt());
    }
    let access = "--ca-file ca.pem --credentials-file user";
    let collector = collect(access);
    sandbox.run(&format!("uplink made --to {} --site a --once {access}", server.address)).expect(0);
    assert!(files(&sandbox.path("centre/a")) == made);
    drop(collector.interrupt().expect(0));
    let plain = sandbox.run("uplink made --to nats://10.0.0.1:4222 --site a").expect(1);
    assert!(plain.err.contains("leaves this machine, unencrypted"), "{}", plain.err);
}
