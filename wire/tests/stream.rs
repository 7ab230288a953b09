//! The laws of the stream that shared memory alone does not keep: late, restarted and killed participants.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tapline_testing::waiting::until;
use tapline_wire::{
    CasingHeader, CasingLimits, CasingTopic, Limits, Line, LineAddress, LineError, Publisher, RecordKind, Role, Stamp,
    Subscriber, TapHeader, TapTopic, Topic, bytes_of, i16_of_mut,
};

const SAMPLES: u32 = 1024;

/// Far longer than anything here takes.
const LONG: Duration = Duration::from_secs(30);

fn limits() -> Limits {
    let casing = CasingLimits {
        taps: 4,
        room: 0,
        scans: 1,
        locations: 4,
        known_locations: 0,
        record_bytes: SAMPLES as usize * 2,
    };
    Limits { casing, ..Limits::default() }
}

/// A separate address for each test, cleared when the test ends: then nothing of it is left.
struct Place(LineAddress);

impl Place {
    fn new() -> Self {
        Self(LineAddress::fresh().unwrap())
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let is_cleared = self.0.clear().unwrap() && shm_files(&self.0) == 0 && !self.0.root().exists();
        assert!(is_cleared || std::thread::panicking());
    }
}

fn join(address: &LineAddress, role: Role) -> Line {
    Line::join(address, role, &limits(), Arc::default()).unwrap()
}

/// Sends `count` taps; tap k has k as its plan index and in all its samples.
fn send_taps(publisher: &Publisher<'_, TapTopic>, from: u32, count: u32) -> Result<(), LineError> {
    for k in from..from + count {
        let mut loan = publisher.loan(SAMPLES as usize * 2 / 64)?;
        loan.fill(|header, buffer| {
            *header = TapHeader { plan_index: k, sample_count: SAMPLES, channel_count: 1, sample_format: 1, ..*header };
            i16_of_mut(buffer).fill(k as i16);
        });
        loan.send(RecordKind::Data)?;
    }
    Ok(())
}

/// Receives taps until one has the plan index `last`; returns their plan indices in order, and the number of lost
/// records. Calls `on_tap` after each tap.
fn receive_taps(
    line: &Line,
    subscriber: &Subscriber<'_, TapTopic>,
    last: u32,
    on_tap: impl Fn(u32),
) -> (Vec<u32>, u64) {
    let mut seen = Vec::new();
    let deadline = Instant::now() + LONG;
    while seen.last() != Some(&last) {
        assert!(Instant::now() < deadline, "only {} records came", seen.len());
        while let Some(tap) = subscriber.receive().unwrap() {
            let k = tap.header().plan_index;
            assert!(bytes_of(&tap).chunks(2).all(|b| i16::from_ne_bytes([b[0], b[1]]) == k as i16), "samples of {k}");
            seen.push(k);
            on_tap(k);
        }
        line.wait(Duration::from_millis(20)).unwrap();
    }
    (seen, subscriber.lost())
}

fn in_thread<R: Send + 'static>(name: &str, work: impl FnOnce() -> R + Send + 'static) -> JoinHandle<R> {
    std::thread::Builder::new().name(name.to_owned()).spawn(work).unwrap()
}

/// A subscriber in its own thread.
struct Receiving {
    /// Taps that it has received so far.
    count: Arc<AtomicU32>,
    thread: JoinHandle<(Vec<u32>, u64)>,
}

impl Receiving {
    /// Receives taps in `role` until `last`; calls `on_open` once it is subscribed.
    fn start(address: &LineAddress, role: Role, last: u32, on_open: impl FnOnce() + Send + 'static) -> Self {
        let (address, count) = (address.clone(), Arc::new(AtomicU32::new(0)));
        let received = Arc::clone(&count);
        let thread = in_thread(&role.name(), move || {
            let line = join(&address, role);
            let subscriber = Subscriber::open(&line).unwrap();
            on_open();
            receive_taps(&line, &subscriber, last, |_| {
                received.fetch_add(1, Ordering::Relaxed);
            })
        });
        Self { count, thread }
    }

    fn assert_got(self, expected: std::ops::Range<u32>) {
        assert_eq!(self.thread.join().unwrap(), (expected.collect(), 0));
    }
}

/// Law 2. Without the READY handshake, the publisher would fill the buffer of a subscriber that has not mapped it yet;
/// all further records would be dropped although `send` reports success.
#[test]
fn subscribers_that_come_late_lose_nothing() {
    let place = Place::new();
    let count = 600;
    let line = join(&place.0, Role::Acquire(0));
    let publisher = Publisher::<TapTopic>::open(&line).unwrap();
    assert!(!publisher.poll_ready().unwrap());
    let (opened, is_open) = sync_channel(1);
    let process = Receiving::start(&place.0, Role::Process, count - 1, move || opened.send(()).unwrap());
    is_open.recv_timeout(LONG).unwrap();
    assert!(!publisher.poll_ready().unwrap());
    let store = Receiving::start(&place.0, Role::Store, count - 1, || ());
    send_taps(&publisher, 0, count).unwrap();
    [process, store].into_iter().for_each(|subscriber| subscriber.assert_got(0..count));
}

/// Law 2. A publisher that restarts repeats the handshake, and its numbers start anew without looking like a gap.
#[test]
fn a_restarted_publisher_loses_nothing() {
    let place = Place::new();
    let subscribers = [Role::Process, Role::Store].map(|role| Receiving::start(&place.0, role, 599, || ()));
    for life in 0..3 {
        let line = join(&place.0, Role::Acquire(0));
        let publisher = Publisher::<TapTopic>::open(&line).unwrap();
        send_taps(&publisher, life * 200, 200).unwrap();
        // As acquire does, the sender waits until its records are received before it leaves.
        for subscriber in &subscribers {
            let has_all = || subscriber.count.load(Ordering::Relaxed) == (life + 1) * 200;
            until("a subscriber has received all records", has_all);
        }
    }
    subscribers.into_iter().for_each(|subscriber| subscriber.assert_got(0..600));
}

/// Law 2. While a role has no subscriber, the publisher waits; the next subscriber receives everything sent from then
/// on.
#[test]
fn a_publisher_waits_for_a_subscriber_that_restarts() {
    let place = Place::new();
    let store = Receiving::start(&place.0, Role::Store, 599, || ());
    let process = Receiving::start(&place.0, Role::Process, 299, || ());
    let line = join(&place.0, Role::Acquire(0));
    let publisher = Publisher::<TapTopic>::open(&line).unwrap();
    send_taps(&publisher, 0, 300).unwrap();
    process.assert_got(0..300);
    assert!(!publisher.poll_ready().unwrap());
    let process = Receiving::start(&place.0, Role::Process, 599, || ());
    send_taps(&publisher, 300, 300).unwrap();
    process.assert_got(300..600);
    store.assert_got(0..600);
}

/// A process that is asked to stop does not wait for ever for an absent subscriber.
#[test]
fn a_stopped_publisher_gives_up() {
    let place = Place::new();
    let stop = Arc::new(AtomicBool::new(false));
    let (ended, has_ended) = sync_channel(1);
    let (address, is_stopped) = (place.0.clone(), Arc::clone(&stop));
    let publisher = in_thread("acquire-1", move || {
        let line = Line::join(&address, Role::Acquire(0), &limits(), is_stopped).unwrap();
        let publisher = Publisher::<TapTopic>::open(&line).unwrap();
        ended.send(send_taps(&publisher, 0, 1)).unwrap();
    });
    assert_eq!(has_ended.recv_timeout(Duration::from_millis(200)).unwrap_err(), RecvTimeoutError::Timeout);
    stop.store(true, Ordering::Relaxed);
    assert!(matches!(has_ended.recv_timeout(LONG).unwrap(), Err(LineError::Stopped { .. })));
    publisher.join().unwrap();
}

/// Catches a record that reaches another role than its addressee, and a publisher that does not notice a new receiver.
#[test]
fn what_is_addressed_reaches_one() {
    let place = Place::new();
    let store = join(&place.0, Role::Store);
    let [to_fuse, to_acquire] =
        [Role::Fuse, Role::Acquire(0)].map(|role| Publisher::<CasingTopic>::open_to(&store, role).unwrap());
    let header = |casing| CasingHeader { stamp: Stamp { casing, ..Stamp::default() }, ..CasingHeader::default() };
    for life in 1..=2 {
        let (fuse, acquire) = (join(&place.0, Role::Fuse), join(&place.0, Role::Acquire(0)));
        let (at_fuse, at_acquire) =
            (Subscriber::<CasingTopic>::open(&fuse).unwrap(), Subscriber::<CasingTopic>::open(&acquire).unwrap());
        let deadline = Instant::now() + LONG;
        let (mut is_sent, mut got) = ([false; 2], [0; 2]);
        while got != [7, 8] {
            assert!(Instant::now() < deadline, "{is_sent:?} {got:?}");
            is_sent[0] = is_sent[0] || to_fuse.try_send(RecordKind::Ledger, header(7), &[]).unwrap();
            is_sent[1] = is_sent[1] || to_acquire.try_send(RecordKind::Ledger, header(8), &[]).unwrap();
            for (subscriber, got) in [&at_fuse, &at_acquire].into_iter().zip(&mut got) {
                if let Some(record) = subscriber.receive().unwrap() {
                    assert_eq!(std::mem::replace(got, record.header().stamp.casing), 0, "once");
                }
            }
        }
        assert_eq!([to_fuse.generation(), to_acquire.generation()], [life; 2]);
    }
}

const CHILD_LINE: &str = "TAPLINE_TEST_LINE";

/// What the child says once it is subscribed.
const CHILD_IS_OPEN: &str = "subscribed";

/// Not a test, but the subscriber process that other tests kill.
#[test]
fn child_subscriber() {
    let Ok(root) = std::env::var(CHILD_LINE) else { return };
    let line = join(&LineAddress::at(root.as_ref()).unwrap(), Role::Process);
    let pause = Duration::from_millis(std::env::var("TAPLINE_TEST_PAUSE_MS").unwrap().parse().unwrap());
    let subscriber = Subscriber::open(&line).unwrap();
    writeln!(std::io::stdout(), "{CHILD_IS_OPEN}").unwrap();
    receive_taps(&line, &subscriber, 399, |_| std::thread::sleep(pause));
}

/// A subscriber in its own process, which pauses after each tap. Returns once it is subscribed.
fn child(address: &LineAddress, pause_ms: u32) -> Child {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child_subscriber", "--nocapture"])
        .env(CHILD_LINE, address.root())
        .env("TAPLINE_TEST_PAUSE_MS", pause_ms.to_string())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let stdout = child.stdout.take().unwrap();
    let (opened, is_open) = sync_channel(1);
    // Reads to the end, because the child would fail if nobody read its output.
    in_thread("child's output", move || {
        for line in BufReader::new(stdout).lines().map_while(Result::ok) {
            if line.ends_with(CHILD_IS_OPEN) {
                opened.send(()).unwrap();
            }
        }
    });
    is_open.recv_timeout(LONG).unwrap();
    child
}

/// Laws 2 and 5 of faults: a subscriber that is killed while the publisher waits for it must not block the publisher
/// for ever.
#[test]
fn a_killed_subscriber_does_not_hold_its_publisher() {
    let place = Place::new();
    let store = Receiving::start(&place.0, Role::Store, 399, || ());
    let mut slow = child(&place.0, 60_000);
    let address = place.0.clone();
    let (opened, is_open) = sync_channel(1);
    let publisher = in_thread("acquire-1", move || {
        let line = join(&address, Role::Acquire(0));
        let publisher = Publisher::<TapTopic>::open(&line).unwrap();
        send_taps(&publisher, 0, 200).unwrap();
        is_open.recv().unwrap();
        send_taps(&publisher, 200, 200).unwrap();
    });
    // The slow one holds the first tap, and its buffer is full: one more may reach `store` before the publisher waits.
    let stored = || store.count.load(Ordering::Relaxed) as usize;
    until("the buffer is full", || stored() > TapTopic::BUFFER);
    assert!(stored() <= TapTopic::BUFFER + 2);
    assert!(!publisher.is_finished());
    slow.kill().unwrap();
    slow.wait().unwrap();
    // As the supervisor does when a process has died.
    join(&place.0, Role::Supervisor).clear_dead();
    // The layer closes the connection of a dead subscriber before it takes it off its list: what is sent between the two
    // reaches the others alone, which is why a new subscriber raises the generation.
    let mut quick = child(&place.0, 0);
    opened.send(()).unwrap();
    store.assert_got(0..400);
    assert!(quick.wait().unwrap().success());
    publisher.join().unwrap();
}

/// Catches a wait for READY that takes a notification which the wait after it is for: that one would sleep a second.
#[test]
fn a_wait_for_ready_lets_the_next_wait_look_again() {
    let place = Place::new();
    let line = join(&place.0, Role::Acquire(0));
    let publisher = Publisher::<TapTopic>::open(&line).unwrap();
    let stages = [Role::Process, Role::Store].map(|role| Receiving::start(&place.0, role, 0, || ()));
    publisher.wait_ready().unwrap();
    assert!(!line.wait(LONG).unwrap(), "it sleeps although it may have missed something");
    send_taps(&publisher, 0, 1).unwrap();
    stages.into_iter().for_each(|stage| stage.assert_got(0..1));
}

/// Catches a line that cannot be cleared, and waits for ever, because a participant was killed between creating a
/// segment of shared memory and setting its size.
#[test]
fn a_segment_without_a_size_is_cleared_away() {
    let place = LineAddress::fresh().unwrap();
    let mut child = child(&place, 0);
    child.kill().unwrap();
    child.wait().unwrap();
    let mut emptied = 0;
    for path in segments(&place).filter(|path| path.extension().is_some_and(|kind| kind == "dynamic")) {
        std::fs::OpenOptions::new().write(true).truncate(true).open(path).unwrap();
        emptied += 1;
    }
    assert!(emptied > 0, "the child made no segment");
    let address = place.clone();
    let clearing = in_thread("clear", move || assert!(address.clear().unwrap()));
    until("the line is cleared", || clearing.is_finished());
    clearing.join().unwrap();
    assert_eq!(shm_files(&place), 0);
}

fn shm_files(address: &LineAddress) -> usize {
    segments(address).count()
}

fn segments(address: &LineAddress) -> impl Iterator<Item = std::path::PathBuf> {
    let files = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let is_ours = |f: &std::fs::DirEntry| f.file_name().to_string_lossy().starts_with(address.prefix());
    files.filter(is_ours).map(|f| f.path()).collect::<Vec<_>>().into_iter()
}
