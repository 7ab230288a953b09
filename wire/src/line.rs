//! One process's place on a line: its node, its bell, and the reaper of those who died.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::node::NodeView as _;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;

use crate::{Plan, Role};

pub(crate) type Svc = ipc_threadsafe::Service;

/// How often dead participants are looked for.
const REAP_EVERY: Duration = Duration::from_millis(100);

/// Why a line cannot be joined, or a record not sent or received.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// Too little shared memory is free.
    #[error(
        "{what} may need {:.1} MB of shared memory, but /dev/shm has {:.1} MB free: enlarge it \
         (mount -o remount,size=..., or --shm-size for a container) or use fewer stations",
        *.need as f64 / 1e6, *.free as f64 / 1e6
    )]
    NoRoom {
        /// For what.
        what: String,
        /// Bytes needed at most.
        need: u64,
        /// Bytes free.
        free: u64,
    },
    /// Free shared memory cannot be determined.
    #[error("cannot ask how much of /dev/shm is free")]
    NoSharedMemory {
        /// The system's reason.
        source: std::io::Error,
    },
    /// An operation of the shared-memory layer failed.
    #[error("{operation}: {reason}")]
    Shared {
        /// What was tried.
        operation: String,
        /// What the layer says.
        reason: String,
    },
    /// A record was made from another plan than this process works from.
    #[error("a record on {topic} was made from plan {got:016x}, but this process works from plan {want:016x}")]
    OtherPlan {
        /// The topic.
        topic: &'static str,
        /// Digest of the record's plan.
        got: u64,
        /// Digest of this process's plan.
        want: u64,
    },
    /// The process was asked to stop while it waited.
    #[error("stopped while waiting to send on {topic}")]
    Stopped {
        /// The topic.
        topic: &'static str,
    },
    /// A record is longer than the plan allows.
    #[error("a record on {topic} has {got} elements; the plan allows {most}")]
    TooLong {
        /// The topic.
        topic: &'static str,
        /// Elements asked for.
        got: usize,
        /// Most elements a record can have.
        most: usize,
    },
}

impl LineError {
    pub(crate) fn shared(operation: impl Into<String>, reason: impl std::fmt::Debug) -> Self {
        Self::Shared { operation: operation.into(), reason: format!("{reason:?}") }
    }
}

/// Where the shared memory of one line is found: two lines with different addresses never meet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineAddress {
    /// Beginning of the names of its files in `/dev/shm`.
    pub prefix: String,
    /// Folder of its other files; short, since socket paths are.
    pub root: PathBuf,
}

impl LineAddress {
    /// The address of the line called `name`, in the system's folder for temporary files.
    pub fn new(name: &str) -> Self {
        Self { prefix: format!("tapline_{name}_"), root: std::env::temp_dir().join(format!("tapline-{name}")) }
    }

    fn config(&self) -> Result<Config, LineError> {
        let name = |e| LineError::shared(format!("using the line address {self:?}"), e);
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(name)?;
        config.global.set_root_path(&iceoryx2::prelude::Path::new(path_bytes(&self.root)).map_err(name)?);
        Ok(config)
    }

    /// Clears away what dead participants left, and everything when no one is alive; whether it is clear now.
    ///
    /// # Errors
    /// [`LineError`] when the address is not usable.
    pub fn clear(&self) -> Result<bool, LineError> {
        let config = self.config()?;
        let is_alive = reap(&config);
        if is_alive {
            return Ok(false);
        }
        // The layer leaves one management file a prefix by design; nobody is left to need it.
        let files = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        for file in files.filter(|f| f.file_name().to_string_lossy().starts_with(&self.prefix)) {
            remove(&file.path(), |path| std::fs::remove_file(path));
        }
        remove(&self.root, |path| std::fs::remove_dir_all(path));
        Ok(true)
    }
}

fn path_bytes(path: &Path) -> &[u8] {
    std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str())
}

fn remove(path: &Path, by: impl Fn(&Path) -> std::io::Result<()>) {
    if let Err(error) = by(path)
        && error.kind() != std::io::ErrorKind::NotFound
    {
        tracing::warn!(path = %path.display(), %error, "cannot remove what a line left behind");
    }
}

/// Clears the resources of dead participants; whether anyone is alive.
fn reap(config: &Config) -> bool {
    let mut is_alive = false;
    let listed = Node::<Svc>::list(config, |state| {
        match state {
            NodeState::Dead(view) => {
                let name = view.details().as_ref().map(|d| d.name().as_str().to_owned());
                match view.try_remove_stale_resources() {
                    Ok(()) => tracing::debug!(?name, "cleared away a dead participant"),
                    Err(error) => tracing::trace!(?name, ?error, "a dead participant is being cleared by another"),
                }
            }
            NodeState::Alive(_) | NodeState::Inaccessible(_) | NodeState::Undefined(_) => is_alive = true,
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        // Files vanish while others come and go; the next look sees a settled state.
        tracing::trace!(?error, "cannot list the participants just now");
        return true;
    }
    is_alive
}

/// A reason to wake up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// A record is there to be received.
    Data,
    /// `fuse` misses discriminators that the archive has.
    ReplayWanted,
    /// The named subscriber has mapped this process's publisher, as the greeting with this number tells.
    Ready(Role, u64),
}

/// Greetings told apart by a bell: a READY to an older one does not count for the newest.
const GREETINGS: u64 = 8;

impl Signal {
    /// Number of the signal at a bell, below [`SIGNALS`].
    fn number(self) -> usize {
        let ready = |role: usize, greeting: u64| 2 + role * GREETINGS as usize + (greeting % GREETINGS) as usize;
        match self {
            Self::Data => 0,
            Self::ReplayWanted => 1,
            Self::Ready(Role::Process, greeting) => ready(0, greeting),
            Self::Ready(Role::Fuse, greeting) => ready(1, greeting),
            Self::Ready(Role::Store, greeting) => ready(2, greeting),
            Self::Ready(Role::Acquire(_) | Role::Watch, greeting) => ready(3, greeting),
        }
    }

    fn event(self) -> EventId {
        EventId::new(self.number())
    }

    fn bit(self) -> u64 {
        1 << self.number()
    }
}

/// Signals that a bell tells apart.
const SIGNALS: usize = 2 + 4 * GREETINGS as usize;
const _: () = assert!(SIGNALS <= u64::BITS as usize);

/// One process's place on a line. Owned by one thread; what it receives may be used in others.
#[derive(Debug)]
pub struct Line {
    role: Role,
    config: Config,
    node: Node<Svc>,
    bell: Listener<Svc>,
    rung: Cell<u64>,
    bells: RefCell<HashMap<Role, Notifier<Svc>>>,
    reaped_at: Cell<Instant>,
    stop: Arc<AtomicBool>,
    plan_digest: u64,
    station_count: usize,
    epoch_ns: i64,
}

impl Line {
    /// Joins the line at `address` as `role`, working from `plan`.
    ///
    /// `stop` is set by whoever wants the process to end; every wait ends then.
    ///
    /// # Errors
    /// [`LineError`] when the address is not usable or the shared-memory layer refuses.
    pub fn join(address: &LineAddress, role: Role, plan: &Plan, stop: Arc<AtomicBool>) -> Result<Self, LineError> {
        set_log_level(LogLevel::Fatal); // what it reports is reported by the errors it returns
        let config = address.config()?;
        let name = role.name();
        let node_name =
            NodeName::new(&name).map_err(|e| LineError::shared(format!("naming the participant {name}"), e))?;
        let node = NodeBuilder::new()
            .name(&node_name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Svc>()
            .map_err(|e| LineError::shared(format!("joining the line {} as {name}", address.prefix), e))?;
        // The bell comes first: a ring before it exists reaches nobody.
        let station_count = plan.stations().len();
        let bell = bell_service(&node, role, station_count)?
            .listener_builder()
            .create()
            .map_err(|e| LineError::shared(format!("hanging up the bell of {name}"), e))?;
        Ok(Self {
            role,
            config,
            node,
            bell,
            rung: Cell::new(0),
            bells: RefCell::default(),
            reaped_at: Cell::new(Instant::now()),
            stop,
            plan_digest: plan.digest(),
            station_count,
            epoch_ns: crate::now_ns(),
        })
    }

    /// The role joined as.
    pub fn role(&self) -> Role {
        self.role
    }

    /// Whether the process has been asked to end.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(crate) fn node(&self) -> &Node<Svc> {
        &self.node
    }

    pub(crate) fn config(&self) -> &Config {
        &self.config
    }

    pub(crate) fn stop(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    pub(crate) fn plan_digest(&self) -> u64 {
        self.plan_digest
    }

    pub(crate) fn epoch_ns(&self) -> i64 {
        self.epoch_ns
    }

    /// Waits until the bell rings or `timeout` passes, and clears away the dead from time to time.
    ///
    /// # Errors
    /// [`LineError::Shared`] when the bell is broken.
    pub fn wait(&self, timeout: Duration) -> Result<(), LineError> {
        let until_reaping = REAP_EVERY.saturating_sub(self.reaped_at.get().elapsed());
        // What was rung while we did something else needs no waiting for; and the bell takes zero for "for ever".
        let timeout = if self.take(Signal::Data) { Duration::ZERO } else { timeout };
        let timeout =
            if timeout.is_zero() { timeout } else { timeout.min(until_reaping).max(Duration::from_millis(1)) };
        let note = |activation: EventActivation| self.rung.set(self.rung.get() | 1 << activation.id.as_value());
        let waited = if timeout.is_zero() { self.bell.try_wait(note) } else { self.bell.timed_wait(note, timeout) };
        self.take(Signal::Data);
        match waited {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
            Err(error) => {
                return Err(LineError::shared(format!("listening to the bell of {}", self.role.name()), error));
            }
        }
        if self.reaped_at.get().elapsed() >= REAP_EVERY {
            reap(&self.config);
            self.reaped_at.set(Instant::now());
        }
        Ok(())
    }

    /// Notes what has been rung until now, without waiting.
    pub(crate) fn listen(&self) -> Result<(), LineError> {
        let note = |activation: EventActivation| self.rung.set(self.rung.get() | 1 << activation.id.as_value());
        match self.bell.try_wait(note) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(LineError::shared(format!("listening to the bell of {}", self.role.name()), error)),
        }
    }

    /// Whether `signal` was rung since it was last asked for.
    pub fn take(&self, signal: Signal) -> bool {
        let rung = self.rung.get();
        self.rung.set(rung & !signal.bit());
        rung & signal.bit() != 0
    }

    /// Rings the bell of `role`; a role that is not there does not hear it, and need not.
    pub fn ring(&self, role: Role, signal: Signal) {
        let mut bells = self.bells.borrow_mut();
        let notifier = match bells.entry(role) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => match self.notifier(role) {
                Ok(notifier) => entry.insert(notifier),
                Err(error) => return tracing::warn!(%error, "cannot reach the bell of {}", role.name()),
            },
        };
        if let Err(error) = notifier.notify_with_custom_event_id(signal.event()) {
            tracing::debug!(?error, "the bell of {} did not ring", role.name());
        }
    }

    /// A bell rope to this process's own bell, for its worker threads.
    ///
    /// # Errors
    /// [`LineError::Shared`] when the bell cannot be reached.
    pub fn rope(&self) -> Result<Rope, LineError> {
        self.notifier(self.role).map(|notifier| Rope(Arc::new(notifier)))
    }

    fn notifier(&self, role: Role) -> Result<Notifier<Svc>, LineError> {
        bell_service(&self.node, role, self.station_count)?
            .notifier_builder()
            .create()
            .map_err(|e| LineError::shared(format!("reaching the bell of {}", role.name()), e))
    }
}

/// Rings the bell of the process it was made in, from any of its threads.
#[derive(Debug, Clone)]
pub struct Rope(Arc<Notifier<Svc>>);

impl Rope {
    /// Wakes the thread that waits on the line.
    pub fn pull(&self) {
        if let Err(error) = self.0.notify_with_custom_event_id(Signal::Data.event()) {
            tracing::debug!(?error, "a worker could not ring the bell");
        }
    }
}

fn bell_service(
    node: &Node<Svc>,
    role: Role,
    station_count: usize,
) -> Result<iceoryx2::service::port_factory::event::PortFactory<Svc>, LineError> {
    // Everyone may ring a bell, and as many again who died and are not cleared away yet.
    let ropes = 2 * (station_count + 4);
    let name = format!("tapline/bell/{}", role.name());
    let service_name = ServiceName::new(&name).map_err(|e| LineError::shared(format!("naming {name}"), e))?;
    node.service_builder(&service_name)
        .event()
        .event_id_max_value(SIGNALS - 1)
        .max_listeners(4)
        .max_notifiers(ropes)
        .max_nodes(ropes + 4)
        .open_or_create()
        .map_err(|e| LineError::shared(format!("opening {name}"), e))
}

/// Holds every service of a line open, so that no stage ever creates one: a stage that is killed while it creates a
/// service leaves a half-made one that nobody can open.
#[derive(Debug)]
pub struct Services {
    _bells: Vec<iceoryx2::service::port_factory::event::PortFactory<Svc>>,
    _topics: crate::publisher::AllTopics,
}

impl Services {
    /// Creates what a line for `plan` needs, or opens it.
    ///
    /// # Errors
    /// [`LineError::Shared`] when the shared-memory layer refuses.
    pub fn open(line: &Line, plan: &Plan) -> Result<Self, LineError> {
        let stations = plan.stations();
        let roles = [Role::Process, Role::Fuse, Role::Store].into_iter();
        let roles = roles.chain(stations.iter().map(|&station| Role::Acquire(station)));
        let bells = roles.map(|role| bell_service(&line.node, role, stations.len())).collect::<Result<_, _>>()?;
        Ok(Self { _bells: bells, _topics: crate::publisher::open_all(line, plan)? })
    }
}

pub(crate) fn reap_now(config: &Config) {
    reap(config);
}
