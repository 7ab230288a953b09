//! A second network on this host, whose cable can be pulled.

use std::fs;
use std::process::{Command, Stdio};

use tapline_testing::skip;

use crate::cluster::{Cluster, Process};
use crate::kills::{SLEEP_S, begin, wait_for_results};
use crate::sandbox::{CASINGS, Sandbox, contents};

/// A network namespace with a link to this one's; both go with it.
struct Network {
    name: String,
}

impl Network {
    const HERE: &'static str = "10.231.77.1";
    const THERE: &'static str = "10.231.77.2";

    /// `None`, and a skip, where this user may not make one.
    fn new() -> Option<Self> {
        let name = format!("tq{}", std::process::id());
        let network = Self { name: name.clone() };
        let (here, there) = (format!("{name}a"), format!("{name}b"));
        let (at_here, at_there) = (format!("{}/24", Self::HERE), format!("{}/24", Self::THERE));
        let steps = [
            vec!["netns", "add", &name],
            vec!["link", "add", &here, "type", "veth", "peer", "name", &there, "netns", &name],
            vec!["address", "add", &at_here, "dev", &here],
            vec!["link", "set", &here, "up"],
            vec!["-n", &name, "address", "add", &at_there, "dev", &there],
            vec!["-n", &name, "link", "set", &there, "up"],
            vec!["-n", &name, "link", "set", "lo", "up"],
        ];
        for step in steps {
            if !ip(&step) {
                skip(&format!("this user cannot make a network: ip {}", step.join(" ")));
                return None;
            }
        }
        Some(network)
    }

    fn cut(&self) {
        assert!(ip(&["link", "set", &format!("{}a", self.name), "down"]));
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        ip(&["netns", "delete", &self.name]);
        ip(&["link", "delete", &format!("{}a", self.name)]);
    }
}

fn ip(arguments: &[&str]) -> bool {
    let mut command = Command::new("ip");
    command.args(arguments).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// Catches work that is lost behind a cut link, and a host that goes on behind it and spoils what is committed.
#[test]
fn a_job_survives_a_link_that_is_cut() {
    let Some(sandbox) = Sandbox::new() else { return };
    let Some(network) = Network::new() else { return };
    let slow = sandbox.slow_tapline(SLEEP_S);
    let mut cluster = Cluster::start_at(&sandbox, &slow, Network::HERE, 1);
    let mut far = Command::new("ip");
    far.args(["netns", "exec", &network.name, env!("CARGO_BIN_EXE_tapline-query"), "executor", &cluster.engine]);
    far.args(["--bind", Network::THERE]).env("TAPLINE", &slow).env("TMPDIR", sandbox.path(".")).stderr(Stdio::null());
    cluster.executors.push(Process::start(&mut far));
    let mut whole = begin(&sandbox, &cluster, &slow, "whole");
    assert_eq!(whole.end(), Some(0), "{}", fs::read_to_string(sandbox.path("errors")).unwrap());
    let expected = contents(&sandbox.only_job("whole"));

    let mut job = begin(&sandbox, &cluster, &slow, "cut");
    wait_for_results(&sandbox, "cut", CASINGS / 2);
    network.cut();
    assert_eq!(job.end(), Some(0), "{}", fs::read_to_string(sandbox.path("errors")).unwrap());
    std::thread::sleep(std::time::Duration::from_secs(1));
    assert!(contents(&sandbox.only_job("cut")) == expected);
}
