//! One process's place on a line: its node, and the one wait that everything ends in.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event::PortFactory as BellService;

use crate::address::reap;
use crate::bell::{Rope, Signal, bell_service};
use crate::publisher::{AllTopics, open_all};
use crate::{LineAddress, LineError, Plan, Role};

pub(crate) type Svc = ipc_threadsafe::Service;

/// How often dead participants are looked for.
const REAP_EVERY: Duration = Duration::from_millis(100);

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

/// Holds every service of a line open, so that no stage ever creates one: a stage that is killed while it creates a
/// service leaves a half-made one that nobody can open.
#[derive(Debug)]
pub struct Services {
    _bells: Vec<BellService<Svc>>,
    _topics: AllTopics,
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
        Ok(Self { _bells: bells, _topics: open_all(line, plan)? })
    }
}
