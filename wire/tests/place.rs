//! What a line takes of the machine, and what of it others can reach: nothing.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fmt::Debug;
use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use tapline_wire::{
    AskTopic, CasingTopic, DamageTopic, DiscriminatorTopic, Limits, Line, LineAddress, ProposalTopic, Publisher, Role,
    Services, SettledTopic, Subscriber, TapTopic, Topic, line_bytes, shm,
};

fn limits(acquires: u16) -> Limits {
    Limits { acquire_count: acquires, stations: (1..=acquires).collect(), ..Limits::default() }
}

const CHILD: &str = "TAPLINE_TEST_PLACE";

/// Not a test of its own: one participant, which takes its place, says so, and keeps it until its input ends.
#[test]
fn participant() {
    let Ok(given) = std::env::var(CHILD) else { return };
    let words: Vec<&str> = given.split(' ').collect();
    let (address, limits) = (LineAddress::at(Path::new(words[0])).unwrap(), limits(words[1].parse().unwrap()));
    let role = match words[2] {
        "process" => Role::Process,
        "fuse" => Role::Fuse,
        "store" => Role::Store,
        number => Role::Acquire(number.parse().unwrap()),
    };
    let line = Line::join(&address, role, &limits, Arc::default()).unwrap();
    // What each holds is what the stage of that name holds.
    let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
    let mut notices = Vec::new();
    match role {
        Role::Acquire(_) => {
            inputs.push(input::<CasingTopic>(&line));
            outputs.extend([output::<TapTopic>(&line), output::<ProposalTopic>(&line)]);
        }
        Role::Process => {
            inputs.push(input::<TapTopic>(&line));
            outputs.push(output::<DiscriminatorTopic>(&line));
        }
        Role::Fuse => {
            inputs.extend([input::<CasingTopic>(&line), input::<SettledTopic>(&line)]);
            outputs.extend([output::<DamageTopic>(&line), output::<AskTopic>(&line)]);
        }
        Role::Store => {
            inputs.extend([input::<TapTopic>(&line), input::<DiscriminatorTopic>(&line)]);
            inputs.extend([input::<DamageTopic>(&line), input::<AskTopic>(&line), input::<ProposalTopic>(&line)]);
            outputs.push(output::<SettledTopic>(&line));
            let acquires = (0..limits.acquire_count).map(Role::Acquire);
            let receivers = acquires.chain([Role::Fuse, Role::Supervisor]);
            notices.extend(receivers.map(|to| Publisher::<CasingTopic>::open_to(&line, to).unwrap()));
        }
        _ => {}
    }
    println!("in place");
    let (go, end) = std::sync::mpsc::sync_channel::<()>(1);
    std::thread::Builder::new()
        .name("input".to_owned())
        .spawn(move || {
            let ended = std::io::stdin().lines().next();
            drop((ended, go));
        })
        .unwrap();
    while end.try_recv() != Err(std::sync::mpsc::TryRecvError::Disconnected) {
        line.wait(Duration::from_millis(50)).unwrap();
        // A look at each input connects it to those who send by now.
        for look in &inputs {
            look();
        }
    }
    drop((outputs, notices));
}

/// A look at what comes in on a topic.
fn input<T: Topic>(line: &Line) -> Box<dyn Fn() + '_> {
    let subscriber = Subscriber::<T>::open(line).unwrap();
    Box::new(move || drop(subscriber.receive()))
}

/// The sending end of a topic, only to be held.
fn output<T: Topic>(line: &Line) -> Box<dyn Debug + '_> {
    Box::new(Publisher::<T>::open(line).unwrap())
}

struct Participant(Child);

impl Participant {
    fn start(address: &LineAddress, stations: u16, role: &str) -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "participant", "--nocapture"])
            .env(CHILD, format!("{} {stations} {role}", address.root().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(said.any(|line| line.unwrap().ends_with("in place")), "{role} did not come");
        std::thread::Builder::new().name("said".to_owned()).spawn(move || said.for_each(drop)).unwrap();
        Self(child)
    }
}

impl Drop for Participant {
    fn drop(&mut self) {
        if let Some(mut input) = self.0.stdin.take() {
            drop(writeln!(input));
        }
        assert!(self.0.wait().unwrap().success() || std::thread::panicking());
    }
}

/// Every file of the line, folders apart.
fn files(address: &LineAddress) -> Vec<PathBuf> {
    let shm = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let shm = shm.filter(|file| file.file_name().to_string_lossy().starts_with(address.prefix()));
    let mut found: Vec<PathBuf> = shm.map(|file| file.path()).collect();
    let mut folders = vec![address.root().to_owned()];
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path()) {
            if path.is_dir() { folders.push(path) } else { found.push(path) }
        }
    }
    found
}

/// Bytes of shared memory that the line has promised, and that it really has.
fn shared_bytes(address: &LineAddress) -> (u64, u64) {
    let shm = files(address).into_iter().filter(|path| path.starts_with("/dev/shm"));
    shm.filter_map(|path| path.metadata().ok())
        .fold((0, 0), |(promised, there), file| (promised + file.len(), there + file.blocks() * 512))
}

fn with_line(stations: u16, look: impl FnOnce(&LineAddress)) {
    let address = LineAddress::fresh().unwrap();
    {
        let supervisor = Line::join(&address, Role::Supervisor, &limits(stations), Arc::default()).unwrap();
        let _services = Services::open(&supervisor).unwrap();
        let roles = ["store", "fuse", "process"].into_iter().map(ToOwned::to_owned);
        let roles = roles.chain((0..stations).map(|number| number.to_string()));
        let _participants: Vec<Participant> = roles.map(|role| Participant::start(&address, stations, &role)).collect();
        std::thread::sleep(Duration::from_millis(300)); // they have seen each other
        look(&address);
    }
    assert!(address.clear().unwrap());
    assert!(!address.root().exists());
}

/// Catches a file of a line that others can read or write, and memory that is promised and not there.
#[test]
fn a_line_is_its_users_alone_and_all_its_memory_is_there() {
    with_line(2, |address| {
        let there = files(address);
        assert!(there.len() > 20, "{there:#?}");
        for path in &there {
            let file = path.metadata().unwrap();
            assert_eq!(file.mode() & 0o077, 0, "{} has mode {:03o}", path.display(), file.mode());
        }
        assert_eq!(address.root().metadata().unwrap().mode() & 0o777, 0o700);
        address.verify().unwrap();
        shm::reserve("the line", address).unwrap();
        let (promised, there) = shared_bytes(address);
        assert!(there >= promised, "{there} of {promised}");
        let most = line_bytes(&limits(2)) as u64;
        assert!(there < most + (2 << 20), "{there} bytes are reserved where {most} were foreseen");
    });
}
