//! A second network on this host, whose cable can be pulled.

use std::fs;
use std::process::Stdio;

use tapline_testing::network::{Host, at, ip};
use tapline_testing::skip;

use crate::cluster::{Cluster, Process};
use crate::kills::{SLEEP_S, begin, wait_for_results};
use crate::sandbox::{CASINGS, Sandbox, contents};

/// A network namespace with a link to this one's; both go with it.
struct Network {
    far: Host,
}

impl Network {
    const HERE: &'static str = "10.231.77.1";
    const THERE: &'static str = "10.231.77.2";

    /// `None`, and a skip, where this user may not make one.
    fn new() -> Option<Self> {
        let name = format!("tq{}", std::process::id());
        let network = Self { far: Host::new(name.clone())? };
        for step in [
            format!("link add {name}a type veth peer name {name}b netns {name}"),
            format!("address add {}/24 dev {name}a", Self::HERE),
            format!("link set {name}a up"),
            format!("-n {name} address add {}/24 dev {name}b", Self::THERE),
            format!("-n {name} link set {name}b up"),
            format!("-n {name} link set lo up"),
        ] {
            if !ip(&step) {
                skip(&format!("this user cannot make a network: ip {step}"));
                return None;
            }
        }
        Some(network)
    }

    fn cut(&self) {
        assert!(ip(&format!("link set {}a down", self.far.0)));
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        ip(&format!("link delete {}a", self.far.0));
    }
}

/// Catches work that is lost behind a cut link, and a host that continues behind it and spoils what is committed.
#[test]
fn a_job_survives_a_link_that_is_cut() {
    let Some(sandbox) = Sandbox::new() else { return };
    let Some(network) = Network::new() else { return };
    let slow = sandbox.slow_tapline(SLEEP_S);
    let mut cluster = Cluster::start_at(&sandbox, &slow, Network::HERE, 1);
    let mut far = at(&network.far.0);
    far.args([env!("CARGO_BIN_EXE_tapline-query"), "executor", &cluster.engine]);
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
