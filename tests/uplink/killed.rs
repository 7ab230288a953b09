//! Servers, senders and collectors that are killed, and a server that loses all it had.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use crate::sandbox::Sandbox;
use crate::sandbox::cut::Cut;
use crate::sandbox::nats::NatsServer;
use crate::sandbox::running::{Running, until};
use crate::uplink::{files, made};

/// Catches a file that is lost, comes twice, or is not the same to the last bit, whoever is killed, at whatever moment; a receipt for a file
/// that is not there; and a draft that stays.
#[test]
fn every_file_is_at_the_centre_once_whoever_is_killed() {
    let sandbox = Sandbox::new();
    let Some(mut server) = NatsServer::start(&sandbox, "") else { return };
    let made = made(&sandbox, 6);
    // Many casings of three sites; what differs is their names.
    for site in ["a", "b", "c"] {
        for day in 1..=4 {
            let day = sandbox.path(&format!("{site}/2026-11-0{day}"));
            fs::create_dir_all(&day).unwrap();
            made.iter().for_each(|(name, bytes)| fs::write(day.join(name), bytes).unwrap());
        }
    }
    let sent: BTreeMap<PathBuf, Vec<u8>> = ["a", "b", "c"]
        .iter()
        .flat_map(|site| {
            files(&sandbox.path(site)).into_iter().map(move |(path, bytes)| (PathBuf::from(site).join(path), bytes))
        })
        .collect();
    assert_eq!(sent.len(), 72);
    let uplink =
        |site: &str| Running::start(&sandbox, &format!("uplink {site} --to {} --site {site} --json", server.address));
    let collect =
        |folder: &str| Running::start(&sandbox, &format!("collect {folder} --from {} --json", server.address));
    let mut senders = ["a", "b", "c"].map(|site| Some(uplink(site)));
    let mut collectors = ["centre-1", "centre-2"].map(|folder| Some(collect(folder)));
    let there = || files(&sandbox.path("centre-1")).len() + files(&sandbox.path("centre-2")).len();
    for turn in 0..6 {
        let before = there();
        until("more have come", || there() > before || there() >= 72);
        let (collector, sender) = (turn % 2, turn % 3);
        drop(collectors[collector].take().unwrap().kill());
        collectors[collector] = Some(collect(["centre-1", "centre-2"][collector]));
        drop(senders[sender].take().unwrap().kill());
        senders[sender] = Some(uplink(["a", "b", "c"][sender]));
    }
    for _ in 0..2 {
        server.kill();
        std::thread::sleep(Duration::from_millis(300));
        server.restart();
        std::thread::sleep(Duration::from_millis(700));
    }
    until("all are at the centre", || {
        let centre = [files(&sandbox.path("centre-1")), files(&sandbox.path("centre-2"))];
        centre.iter().map(BTreeMap::len).sum::<usize>() == 72
            && centre.iter().all(|files| files.keys().all(|path| !path.starts_with(".incoming")))
    });
    for site in ["a", "b", "c"] {
        let done = sandbox.run(&format!("uplink {site} --to {} --site {site} --once", server.address)).expect(0);
        assert_eq!(done.out, "", "nothing is sent again");
        assert!(done.err.contains(&format!("24 of 24 finished files of {site} are at the centre")), "{}", done.err);
    }
    senders.into_iter().chain(collectors).flatten().for_each(|running| drop(running.interrupt().expect(0)));
    let [mut one, two] = [files(&sandbox.path("centre-1")), files(&sandbox.path("centre-2"))];
    assert!(!one.is_empty() && !two.is_empty(), "both have worked: {} and {}", one.len(), two.len());
    assert!(two.keys().all(|path| !one.contains_key(path)), "a file is in both");
    one.extend(two);
    assert!(one == sent, "what is there differs from what was sent");
    assert_eq!(
        sandbox.run("verify centre-1 centre-2 --json").expect(0).out.matches("\"is_complete\":true").count(),
        73
    );
}

/// Catches a file that is thrown away because its own receipt, whose acknowledgement was lost, is taken for another's.
#[test]
fn a_receipt_whose_acknowledgement_is_lost_counts() {
    let sandbox = Sandbox::new();
    let Some(server) = NatsServer::start(&sandbox, "") else { return };
    let made = made(&sandbox, 1);
    let cut = Cut::at(&server.address, "HPUB $KV.tapline-receipts.");
    let collector = Running::start(&sandbox, &format!("collect centre --from {}", cut.address));
    let sender = Running::start(&sandbox, &format!("uplink made --to {} --site a --once", server.address));
    assert_eq!(sender.finish().expect(0).out.matches("delivered ").count(), 1);
    until("the file is in its place", || files(&sandbox.path("centre/a")) == made);
    assert!(cut.is_done());
    assert_eq!(collector.interrupt().expect(0).out.matches("received ").count(), 1);
}

/// Catches a draft that cannot be put in its place, and for which no other file is taken; and one that is lost for it.
#[test]
fn a_draft_without_a_place_keeps_no_other_file_back() {
    let sandbox = Sandbox::new();
    let Some(server) = NatsServer::start(&sandbox, "") else { return };
    let made = made(&sandbox, 2);
    fs::rename(sandbox.path("made/C2.h5"), sandbox.path("C2.later")).unwrap();
    let send = format!("uplink made --to {} --site a --once", server.address);
    let collect = || Running::start(&sandbox, &format!("collect centre --from {}", server.address));
    let collector = collect();
    assert_eq!(sandbox.run(&send).expect(0).out.matches("delivered ").count(), 1);
    drop(collector.interrupt().expect(0));
    // As a collector leaves it that is killed between receipt and place; something else is there by now.
    let (place, draft) = (sandbox.path("centre/a/C1.h5"), sandbox.path("centre/.incoming/a/C1.h5"));
    fs::rename(&place, &draft).unwrap();
    fs::create_dir(&place).unwrap();
    fs::rename(sandbox.path("C2.later"), sandbox.path("made/C2.h5")).unwrap();
    let collector = collect();
    assert_eq!(sandbox.run(&send).expect(0).out.matches("delivered ").count(), 1);
    let done = collector.interrupt().expect(0);
    assert!(done.err.contains("ERROR cannot put ") && draft.exists(), "{}", done.err);
    fs::remove_dir(&place).unwrap();
    let collector = collect();
    until("it is in its place", || files(&sandbox.path("centre/a")) == made);
    drop(collector.interrupt().expect(0));
}

/// Catches a sender that relies on what a server has said: a server that loses everything, also what it had acknowledged, costs nothing
/// but time; and files that a centre has and takes again.
#[test]
fn what_a_server_has_lost_is_sent_again() {
    let sandbox = Sandbox::new();
    let Some(mut server) = NatsServer::start(&sandbox, "") else { return };
    let made = made(&sandbox, 4);
    let first = sandbox.path("made/C1.h5");
    fs::rename(&first, sandbox.path("C1.later")).unwrap();
    let (to, from) =
        (format!("uplink made --to {} --site a", server.address), format!("collect centre --from {}", server.address));
    let mut sender = Running::start(&sandbox, &format!("{to} -v"));
    (0..3).for_each(|_| sender.wait_for_log(&["sent a/C"]));
    server.kill();
    server.lose_all();
    server.restart();
    let collector = Running::start(&sandbox, &from);
    let centre = || files(&sandbox.path("centre/a"));
    until("three are there", || centre().len() == 3);
    assert_eq!(collector.interrupt().expect(0).out.matches("received ").count(), 3);

    // The receipts too: all are sent again, and those that are there are not taken again.
    let written = |name: &str| fs::metadata(sandbox.path("centre/a").join(name)).unwrap().modified().unwrap();
    let before = written("C2.h5");
    fs::rename(sandbox.path("C1.later"), &first).unwrap();
    drop(sender.interrupt());
    server.kill();
    server.lose_all();
    server.restart();
    let sender = Running::start(&sandbox, &format!("{to} --once"));
    let collector = Running::start(&sandbox, &from);
    assert_eq!(sender.finish().expect(0).out.matches("delivered ").count(), 4);
    drop(collector.interrupt().expect(0));
    assert!(centre() == made);
    assert_eq!(written("C2.h5"), before);
}
