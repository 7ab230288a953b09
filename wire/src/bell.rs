//! The bell of each process: what wakes it, and who may ring.

use std::sync::Arc;

use iceoryx2::node::Node;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event::PortFactory as BellService;

use crate::line::Svc;
use crate::{LineError, Role};

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

    pub(crate) fn event(self) -> EventId {
        EventId::new(self.number())
    }

    pub(crate) fn bit(self) -> u64 {
        1 << self.number()
    }
}

/// Signals that a bell tells apart.
const SIGNALS: usize = 2 + 4 * GREETINGS as usize;
const _: () = assert!(SIGNALS <= u64::BITS as usize);

/// Rings the bell of the process it was made in, from any of its threads.
#[derive(Debug, Clone)]
pub struct Rope(pub(crate) Arc<Notifier<Svc>>);

impl Rope {
    /// Wakes the thread that waits on the line.
    pub fn pull(&self) {
        if let Err(error) = self.0.notify_with_custom_event_id(Signal::Data.event()) {
            tracing::debug!(?error, "a worker could not ring the bell");
        }
    }
}

/// The service of the bell of `role`, opened or created.
pub(crate) fn bell_service(node: &Node<Svc>, role: Role, station_count: usize) -> Result<BellService<Svc>, LineError> {
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
