//! The events that wake a process of a line.

use std::sync::Arc;

use iceoryx2::node::Node;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event::PortFactory as EventService;

use crate::stream::cleanup::Svc;
use crate::{Limits, LineError, Role};

/// A reason to wake up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// There is something to do: a record, a finished piece of work, a request to end.
    Data,
    /// A subscriber has joined that has received nothing yet.
    Joined,
    /// The subscriber in this role has answered the handshake with this number.
    Ready(Role, u64),
}

/// Handshakes that are distinguished: a READY to an older one does not count for the newest.
const HANDSHAKES: u64 = 16;

impl Signal {
    /// Number of the signal, below [`signal_count`].
    fn number(self) -> usize {
        match self {
            Self::Data => 0,
            Self::Joined => 1,
            Self::Ready(role, handshake) => 2 + role.number() * HANDSHAKES as usize + (handshake % HANDSHAKES) as usize,
        }
    }

    pub(crate) fn event(self) -> EventId {
        EventId::new(self.number())
    }
}

/// How many signals a process of a line with these limits distinguishes.
fn signal_count(limits: &Limits) -> usize {
    2 + Role::count(limits) * HANDSHAKES as usize
}

/// The signals that have come and were not taken.
#[derive(Debug)]
pub(crate) struct Pending(Vec<u64>);

impl Pending {
    pub(crate) fn new(limits: &Limits) -> Self {
        Self(vec![0; signal_count(limits).div_ceil(64)])
    }

    pub(crate) fn add(&mut self, number: usize) {
        if let Some(word) = self.0.get_mut(number / 64) {
            *word |= 1 << (number % 64);
        }
    }

    /// Whether `signal` has come since it was last taken.
    pub(crate) fn take(&mut self, signal: Signal) -> bool {
        let (number, bit) = (signal.number() / 64, 1 << (signal.number() % 64));
        let Some(word) = self.0.get_mut(number) else { return false };
        let has_come = *word & bit != 0;
        *word &= !bit;
        has_come
    }
}

/// Wakes the process it was made in, from any of its threads.
#[derive(Debug, Clone)]
pub struct Waker(pub(crate) Arc<Notifier<Svc>>);

impl Waker {
    /// Wakes the thread that waits on the line.
    pub fn wake(&self) {
        if let Err(error) = self.0.notify_with_custom_event_id(Signal::Data.event()) {
            tracing::debug!(?error, "a worker could not wake its process");
        }
    }
}

/// The service of the events of `role`, opened or created.
pub(crate) fn event_service(node: &Node<Svc>, role: Role, limits: &Limits) -> Result<EventService<Svc>, LineError> {
    // Every process may notify from two places, and as many dead ones may not be removed yet.
    let notifiers = 4 * Role::count(limits);
    let name = format!("tapline/event/{}", role.name());
    let service_name = ServiceName::new(&name).map_err(|e| LineError::shared(format!("naming {name}"), e))?;
    node.service_builder(&service_name)
        .event()
        .event_id_max_value(signal_count(limits) - 1)
        .max_listeners(4)
        .max_notifiers(notifiers)
        .max_nodes(notifiers + 4)
        .open_or_create()
        .map_err(|e| LineError::shared(format!("opening {name}"), e))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches two signals with one number, such as the READY of two participants.
    #[test]
    fn every_signal_has_a_number_of_its_own() {
        let limits = Limits { acquire_count: 3, ..Limits::default() };
        let roles = [Role::Process, Role::Fuse, Role::Store, Role::Supervisor, Role::Acquire(0), Role::Acquire(2)];
        let mut numbers: Vec<usize> = vec![Signal::Data.number(), Signal::Joined.number()];
        numbers.extend(roles.iter().flat_map(|&role| (0..HANDSHAKES).map(move |k| Signal::Ready(role, k).number())));
        let count = numbers.len();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), count);
        assert!(numbers.iter().all(|&number| number < signal_count(&limits)));
        let mut pending = Pending::new(&limits);
        pending.add(Signal::Ready(Role::Acquire(2), 5).number());
        assert!(!pending.take(Signal::Ready(Role::Acquire(1), 5)));
        assert!(pending.take(Signal::Ready(Role::Acquire(2), 5 + HANDSHAKES)));
        assert!(!pending.take(Signal::Ready(Role::Acquire(2), 5)), "it was taken");
    }
}
