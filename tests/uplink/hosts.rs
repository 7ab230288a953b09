//! Three hosts with two stations each, a server and a centre, each in a network namespace of its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use serde_json::Value;
use tapline_testing::network::{Host, at, ip};

use crate::line::slow_plant;
use crate::sandbox::Sandbox;
use crate::sandbox::nats::NatsServer;
use crate::sandbox::running::{Running, until};
use crate::uplink::files;

/// Hosts on one network, as namespaces of this machine; they go when this is dropped.
struct Network {
    /// What their names begin with, so that tests do not meet.
    prefix: String,
    hosts: Vec<Host>,
}

impl Network {
    /// Makes a host for each of `names`, with the addresses 10.77.0.1, 10.77.0.2 ...; `None`, and a skip, where that is not allowed.
    fn new(names: &[&str]) -> Option<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let prefix = format!("tl{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let mut network = Self { prefix, hosts: Vec::new() };
        let switch = network.host("switch");
        network.hosts.push(Host::new(switch.clone())?);
        assert!(
            ip(&format!("-n {switch} link add bridge type bridge")) && ip(&format!("-n {switch} link set bridge up"))
        );
        for (n, name) in names.iter().enumerate() {
            let host = network.host(name);
            network.hosts.push(Host::new(host.clone()).unwrap());
            for does in [
                format!("link add net netns {host} type veth peer name {name} netns {switch}"),
                format!("-n {switch} link set {name} master bridge up"),
                format!("-n {host} addr add 10.77.0.{}/24 dev net", n + 1),
                format!("-n {host} link set net up"),
                format!("-n {host} link set lo up"),
            ] {
                assert!(ip(&does), "{does}");
            }
        }
        Some(network)
    }

    fn host(&self, name: &str) -> String {
        format!("{}-{name}", self.prefix)
    }

    /// Starts the program at the host `name`.
    fn start(&self, sandbox: &Sandbox, name: &str, arguments: &str) -> Running {
        self.start_by(sandbox, name, &[], arguments)
    }

    /// Starts the program at the host `name`, by the command `by`.
    fn start_by(&self, sandbox: &Sandbox, name: &str, by: &[&str], arguments: &str) -> Running {
        let program = sandbox.command(arguments);
        let mut command = at(&self.host(name));
        command.args(by).arg(program.get_program()).args(program.get_args());
        command.current_dir(program.get_current_dir().unwrap()).stdin(Stdio::null());
        command.envs(program.get_envs().filter_map(|(key, value)| Some((key, value?))));
        Running::of(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
    }

    /// Cuts the cable of the host `name`, or mends it.
    fn cable(&self, name: &str, state: &str) {
        assert!(ip(&format!("-n {} link set {name} {state}", self.host("switch"))));
    }
}

/// Catches a station that waits for the network; a file that is lost, comes twice or differs, although the server is killed while
/// files are published, a cable is cut, a collector is killed, and the centre's disk is full.
#[test]
fn three_hosts_lose_nothing_on_the_way_to_a_centre() {
    let hosts = ["host1", "host2", "host3"];
    let Some(network) = Network::new(&["host1", "host2", "host3", "server", "centre"]) else { return };
    let sandbox = Sandbox::new();
    let host = network.host("server");
    let Some(mut server) = NatsServer::start_at(&sandbox, "10.77.0.4:4222", Some(&host), "") else { return };
    slow_plant(&sandbox, 4, 15.0, "");
    let lines: Vec<Running> = hosts
        .iter()
        .map(|host| network.start(&sandbox, host, &format!("line --config plant.toml --out {host} --json --casings 8")))
        .collect();
    let over = format!("{} --allow-plain", server.address);
    hosts.iter().for_each(|host| until("the line runs", || sandbox.path(host).is_dir()));
    let senders: Vec<Running> = hosts
        .iter()
        .map(|host| network.start(&sandbox, host, &format!("uplink {host} --to {over} --site {host}")))
        .collect();
    // The centre's disk has room for two files.
    let collect = |mount: &str| {
        let script = format!("mount -t tmpfs -o size={mount} tmpfs small && exec \"$@\"");
        let by = ["unshare", "--mount", "sh", "-c", &script, "sh"];
        std::fs::create_dir_all(sandbox.path("small")).unwrap();
        network.start_by(&sandbox, "centre", &by, &format!("collect small --from {over}"))
    };
    let mut small = collect("640k");
    small.wait_for_log(&["no room for", "stay free"]);
    network.cable("host2", "down");
    server.kill();
    std::thread::sleep(Duration::from_secs(2));
    server.restart();
    // Its disk is lost with it: whatever it has said that it has is there, so that it may not be killed for that.
    let pid = i32::try_from(small.child().id()).unwrap();
    let root = PathBuf::from(format!("/proc/{pid}/root")).join(sandbox.path("small").strip_prefix("/").unwrap());
    let first = files(&root);
    assert!(
        (1..=2).contains(&first.keys().filter(|path| !path.starts_with(".incoming")).count()),
        "{:?}",
        first.keys()
    );

    // Another, with room, which is killed twice.
    let roomy = format!("collect centre --from {over}");
    for _ in 0..2 {
        let collector = network.start(&sandbox, "centre", &roomy);
        let before = files(&sandbox.path("centre")).len();
        until("more have come", || files(&sandbox.path("centre")).len() > before);
        drop(collector.kill());
    }
    let collector = network.start(&sandbox, "centre", &roomy);
    let mut casings = 0;
    for mut line in lines {
        let verdicts: Vec<Value> = line.verdicts(8);
        casings += verdicts.len();
        let done = line.finish().expect(0);
        assert!(!["ERROR", "lost", "again"].iter().any(|word| done.err.contains(word)), "{}", done.err);
    }
    // All stations have ended; the cable is still cut.
    assert!(files(&sandbox.path("centre/host2")).len() < 8);
    network.cable("host2", "up");
    let at_centre =
        || -> BTreeMap<PathBuf, Vec<u8>> { files(&sandbox.path("centre")).into_iter().chain(files(&root)).collect() };
    let sent: BTreeMap<PathBuf, Vec<u8>> = hosts
        .iter()
        .flat_map(|host| {
            files(&sandbox.path(host)).into_iter().map(move |(path, bytes)| (Path::new(host).join(path), bytes))
        })
        .collect();
    assert_eq!(sent.len(), casings);
    until("all are there, and nothing else", || at_centre() == sent);
    assert_eq!(files(&sandbox.path("centre")).len() + files(&root).len(), casings, "each once");
    senders.into_iter().for_each(|mut sender| {
        (0..8).for_each(|_| assert!(sender.line().starts_with("delivered ")));
        drop(sender.interrupt().expect(0));
    });
    drop((collector.interrupt().expect(0), small.interrupt()));
}
