//! The services of a line in shared memory: one per topic.

use std::fmt::Debug;

use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as TopicService;

use crate::stream::cleanup::Svc;
use crate::stream::error::LineError;
use crate::stream::line::Line;
use crate::stream::topic::{
    AskTopic, CasingTopic, DamageTopic, DiscriminatorTopic, ProposalTopic, Role, SettledTopic, TapTopic, Topic,
    WaitTopic, port_limits, receivers,
};

pub(crate) type Service<T> = TopicService<Svc, [<T as Topic>::Element], <T as Topic>::Header>;

/// Opens the service of a topic, or creates it: its sizes follow from the line's limits, so that all participants agree.
/// An addressed topic has one for each `receiver`.
pub(crate) fn open<T: Topic>(line: &Line, receiver: Option<Role>) -> Result<Service<T>, LineError> {
    let name = match receiver {
        Some(role) => format!("{}/{}", T::NAME, role.name()),
        None => T::NAME.to_owned(),
    };
    let name = ServiceName::new(&name).map_err(|e| LineError::shared(format!("naming {}", T::NAME), e))?;
    let (publishers, subscribers, nodes) = port_limits::<T>(line.limits());
    line.node()
        .service_builder(&name)
        .publish_subscribe::<[T::Element]>()
        .user_header::<T::Header>()
        .enable_safe_overflow(false)
        .history_size(0)
        .subscriber_max_buffer_size(T::BUFFER)
        .subscriber_max_borrowed_samples(T::BORROWED)
        .max_publishers(publishers)
        .max_subscribers(subscribers)
        .max_nodes(nodes)
        .open_or_create()
        .map_err(|e| failed::<T>(line, "opening", e))
}

/// The error of a failed operation on `T`: [`LineError::Stopped`] if the process was asked to end, because a signal interrupts
/// operations too.
pub(crate) fn failed<T: Topic>(line: &Line, doing: &str, reason: impl Debug) -> LineError {
    match line.is_stopped() {
        true => LineError::Stopped { topic: T::NAME },
        false => LineError::shared(format!("{doing} {}", T::NAME), reason),
    }
}

/// Holds every service of a line open, so that no stage ever creates one: a stage that is killed while it creates a service
/// leaves an incomplete one that nobody can open.
#[derive(Debug)]
pub struct Services {
    _topics: Vec<Box<dyn Debug>>,
}

impl Services {
    /// Opens the services of the line, or creates them.
    ///
    /// # Errors
    /// [`LineError::Shared`] when the shared-memory layer refuses.
    pub fn open(line: &Line) -> Result<Self, LineError> {
        let mut topics = vec![
            held::<TapTopic>(line, None)?,
            held::<DiscriminatorTopic>(line, None)?,
            held::<ProposalTopic>(line, None)?,
            held::<WaitTopic>(line, None)?,
            held::<SettledTopic>(line, None)?,
            held::<DamageTopic>(line, None)?,
            held::<AskTopic>(line, None)?,
        ];
        for role in receivers(line.limits()) {
            topics.push(held::<CasingTopic>(line, Some(role))?);
        }
        Ok(Self { _topics: topics })
    }
}

/// As [`open`], only to be held.
fn held<T: Topic + 'static>(line: &Line, receiver: Option<Role>) -> Result<Box<dyn Debug>, LineError> {
    Ok(Box::new(open::<T>(line, receiver)?))
}
