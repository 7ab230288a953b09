//! One process on a line: its node, its mailbox, and the one place where it waits.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::prelude::*;

use crate::stream::cleanup::{Svc, reap};
use crate::stream::mailbox::{Mailbox, Waker};
use crate::{Limits, LineAddress, LineError, Role};

/// Longest wait before checking whether the process is to end: the request may come just before the wait begins.
const WAIT_MAX: Duration = Duration::from_secs(1);

/// One process on a line. It is owned by one thread; received records may be used in others.
#[derive(Debug)]
pub struct Line {
    role: Role,
    limits: Limits,
    address: LineAddress,
    config: Config,
    node: Node<Svc>,
    mailbox: Arc<Mailbox>,
    /// Number of notifications before the last wait ended.
    seen: Cell<u32>,
    /// Those of the roles that were notified.
    mailboxes: RefCell<HashMap<Role, Mailbox>>,
    stop: Arc<AtomicBool>,
    next_handshake: Cell<u64>,
    epoch_ns: i64,
}

impl Line {
    /// Joins the line at `address` as `role`; all its processes are given the same `limits`.
    ///
    /// Setting `stop` ends the process: every wait ends.
    ///
    /// # Errors
    /// [`LineError`] when the address is not usable or the shared-memory layer refuses.
    pub fn join(address: &LineAddress, role: Role, limits: &Limits, stop: Arc<AtomicBool>) -> Result<Self, LineError> {
        set_log_level(LogLevel::Fatal); // its returned errors report the same
        let mut config = address.config()?;
        // Only the process that started the others looks for dead ones; see `clear_dead`.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let name = role.name();
        let node_name =
            NodeName::new(&name).map_err(|e| LineError::shared(format!("naming the participant {name}"), e))?;
        let node = NodeBuilder::new()
            .name(&node_name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Svc>()
            .map_err(|e| LineError::shared(format!("joining the line {} as {name}", address.prefix()), e))?;
        let mailbox = Arc::new(Mailbox::open(address, role, limits)?);
        let epoch_ns = crate::now_ns();
        Ok(Self {
            role,
            limits: limits.clone(),
            address: address.clone(),
            config,
            node,
            // The first wait ends at once: something may have come already.
            seen: Cell::new(mailbox.count().wrapping_sub(1)),
            mailbox,
            mailboxes: RefCell::default(),
            stop,
            // A later run of this process starts at another number.
            next_handshake: Cell::new(epoch_ns.unsigned_abs() >> 20),
            epoch_ns,
        })
    }

    /// The role joined as.
    pub fn role(&self) -> Role {
        self.role
    }

    /// The limits of the line.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Whether the process has been asked to end.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(crate) fn address(&self) -> &LineAddress {
        &self.address
    }

    pub(crate) fn node(&self) -> &Node<Svc> {
        &self.node
    }

    pub(crate) fn stop(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    pub(crate) fn epoch_ns(&self) -> i64 {
        self.epoch_ns
    }

    pub(crate) fn next_handshake(&self) -> u64 {
        let number = self.next_handshake.get();
        self.next_handshake.set(number + 1);
        number
    }

    /// Waits until something is notified or `timeout` passes, a second at most. Returns whether it went to sleep: not if a
    /// notification came before this call, or `timeout` is zero.
    ///
    /// # Errors
    /// [`LineError::File`] when the system refuses.
    pub fn wait(&self, timeout: Duration) -> Result<bool, LineError> {
        self.beat();
        let is_quiet = !timeout.is_zero() && self.mailbox.count() == self.seen.get();
        if is_quiet {
            self.mailbox.sleep(self.seen.get(), timeout.min(WAIT_MAX))?;
        }
        self.seen.set(self.mailbox.count());
        Ok(is_quiet)
    }

    /// Shows that this process is not held up: it looks for work.
    pub(crate) fn beat(&self) {
        self.mailbox.beat();
    }

    /// How often the process in `role` has looked for work; one that does so less than once in some seconds is held up. 0 if nobody
    /// has been in this role.
    pub fn beats(&self, role: Role) -> u32 {
        self.to(role, Mailbox::beats).unwrap_or(0)
    }

    /// Lets the next wait end at once: an earlier wait for something else may have consumed its notification.
    pub(crate) fn look_again(&self) {
        self.seen.set(self.mailbox.count().wrapping_sub(1));
    }

    /// Notifies `role` that there is something to do: a record, a subscriber that has joined, a request to end. One that has
    /// not joined yet looks when it does.
    pub fn notify(&self, role: Role) {
        self.to(role, Mailbox::notify).unwrap_or_default();
    }

    /// Informs `role` that this process is READY, in answer to the handshake with this number.
    pub(crate) fn answer(&self, role: Role, handshake: u64) {
        self.to(role, |mailbox| mailbox.answer(self.role, handshake)).unwrap_or_default();
    }

    /// Whether `role` has answered the handshake with this number; each answer is returned once.
    pub(crate) fn take_answer(&self, role: Role, handshake: u64) -> bool {
        self.mailbox.take_answer(role, handshake)
    }

    /// What `act` returns of the mailbox of `role`; `None` if that cannot be opened.
    fn to<R>(&self, role: Role, act: impl FnOnce(&Mailbox) -> R) -> Option<R> {
        let mut mailboxes = self.mailboxes.borrow_mut();
        let mailbox = match mailboxes.entry(role) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => match Mailbox::open(&self.address, role, &self.limits) {
                Ok(mailbox) => entry.insert(mailbox),
                Err(error) => {
                    tracing::warn!(%error, "cannot notify {}", role.name());
                    return None;
                }
            },
        };
        Some(act(mailbox))
    }

    /// A handle with which worker threads wake this process.
    pub fn waker(&self) -> Waker {
        Waker(self.mailbox.clone())
    }

    /// Removes what dead participants have left, so that nobody waits for them any more.
    ///
    /// Called when a participant has died, by the process that knows of it. Others
    /// must not call it, because its cost grows with the number of participants.
    pub fn clear_dead(&self) {
        reap(&self.config);
    }
}
