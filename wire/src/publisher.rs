//! Sending records: a loan is filled in place and sent once, to everyone who must have it.

use std::cell::{Cell, RefCell};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueSubscriberId;
use iceoryx2::port::publisher::Publisher as Port;
use iceoryx2::port::{BackpressureAction, SendError};
use iceoryx2::prelude::*;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as Service_;

use crate::address::reap;
use crate::line::Svc;
use crate::topic::{LOANED, port_limits, publisher_bytes};
use crate::{
    DamageTopic, DiscriminatorTopic, LedgerTopic, Line, LineError, Plan, RecordKind, ReplayTopic, Role, Signal,
    Stamped, TapTopic, Topic, monotonic_ns, room,
};

pub(crate) type Service<T> = Service_<Svc, [<T as Topic>::Element], <T as Topic>::Header>;

/// Opens the service of a topic, or creates it: the limits follow from the plan, so that all participants agree.
pub(crate) fn open<T: Topic>(line: &Line, plan: &Plan) -> Result<Service<T>, LineError> {
    let name = ServiceName::new(T::NAME).map_err(|e| LineError::shared(format!("naming {}", T::NAME), e))?;
    let (publishers, subscribers, nodes) = port_limits::<T>(plan);
    line.node()
        .service_builder(&name)
        .publish_subscribe::<[T::Element]>()
        .user_header::<T::Header>()
        .enable_safe_overflow(T::SUBSCRIBERS.is_empty())
        .history_size(0)
        .subscriber_max_buffer_size(T::BUFFER)
        .subscriber_max_borrowed_samples(T::BORROWED)
        .max_publishers(publishers)
        .max_subscribers(subscribers)
        .max_nodes(nodes)
        .open_or_create()
        .map_err(|e| failed::<T>(line, "opening", e))
}

/// What an operation on `T` that failed is: the end, when the process was told to end, as a signal interrupts it.
pub(crate) fn failed<T: Topic>(line: &Line, doing: &str, reason: impl std::fmt::Debug) -> LineError {
    match line.is_stopped() {
        true => LineError::Stopped { topic: T::NAME },
        false => LineError::shared(format!("{doing} {}", T::NAME), reason),
    }
}

/// The services of all topics, held open.
pub(crate) type AllTopics =
    (Service<TapTopic>, Service<DiscriminatorTopic>, Service<DamageTopic>, Service<LedgerTopic>, Service<ReplayTopic>);

pub(crate) fn open_all(line: &Line, plan: &Plan) -> Result<AllTopics, LineError> {
    Ok((
        open::<TapTopic>(line, plan)?,
        open::<DiscriminatorTopic>(line, plan)?,
        open::<DamageTopic>(line, plan)?,
        open::<LedgerTopic>(line, plan)?,
        open::<ReplayTopic>(line, plan)?,
    ))
}

/// The sending end of a topic.
///
/// Before a record is sent, every subscriber that must have it has said READY to a greeting that came over the very
/// connection the record will take; a subscriber that joins later is greeted before the next record.
#[derive(Debug)]
pub struct Publisher<'l, T: Topic> {
    line: &'l Line,
    service: Service<T>,
    port: Port<Svc, [T::Element], T::Header>,
    elements_max: usize,
    next_sequence: Cell<u64>,
    /// Subscribers that have said READY; records go out only while these are exactly the ones there are.
    greeted: RefCell<Vec<UniqueSubscriberId>>,
    /// Number of the newest greeting.
    greeting_number: Cell<u64>,
    /// When an outstanding greeting was sent, and to whom.
    greeting: RefCell<Option<(Instant, Vec<UniqueSubscriberId>)>>,
    ready: Cell<u32>,
    may_block: Arc<AtomicBool>,
}

/// How long one may be kept waiting before the dead are looked for, and how often then.
const REAP_AFTER: Duration = Duration::from_millis(20);
const REAP_MS: i64 = 50;

/// How long a greeting may go unanswered before it is sent again.
const GREET_AGAIN: Duration = Duration::from_secs(1);

/// How long a wait may last before it is told of.
const TELL_AFTER: Duration = Duration::from_secs(5);

impl<'l, T: Topic> Publisher<'l, T> {
    /// Opens the sending end of topic `T` for `plan`.
    ///
    /// # Errors
    /// [`LineError::NoRoom`] when the shared memory it may need is not free; [`LineError::Shared`] otherwise.
    pub fn open(line: &'l Line, plan: &Plan) -> Result<Self, LineError> {
        room::check(&format!("{} from {}", T::NAME, line.role().name()), publisher_bytes::<T>(plan))?;
        let service = open::<T>(line, plan)?;
        let elements_max = T::elements_max(plan);
        let may_block = Arc::new(AtomicBool::new(true));
        let reaped_ms = AtomicI64::new(0);
        let (handler_may_block, stop, config) = (may_block.clone(), line.stop().clone(), line.config().clone());
        let port = service
            .publisher_builder()
            .initial_max_slice_len(elements_max)
            .max_loaned_samples(LOANED)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(move |info| {
                if stop.load(Ordering::Relaxed) || !handler_may_block.load(Ordering::Relaxed) {
                    return BackpressureAction::DiscardDataAndFail;
                }
                // Who blocks us may be dead, and then only a reaper lets us go on.
                let now_ms = monotonic_ns() / 1_000_000;
                if info.elapsed_time > REAP_AFTER && now_ms - reaped_ms.load(Ordering::Relaxed) > REAP_MS {
                    reap(&config);
                    reaped_ms.store(now_ms, Ordering::Relaxed);
                }
                std::thread::sleep(Duration::from_micros(if info.retries < 16 { 100 } else { 400 }));
                BackpressureAction::Retry
            })
            .create()
            .map_err(|e| failed::<T>(line, "publishing on", e))?;
        Ok(Self {
            line,
            service,
            port,
            elements_max,
            next_sequence: Cell::new(0),
            greeted: RefCell::default(),
            greeting: RefCell::default(),
            // Another life of this publisher counts from elsewhere.
            greeting_number: Cell::new(line.epoch_ns().unsigned_abs() >> 20),
            ready: Cell::new(0),
            may_block,
        })
    }

    /// Shared memory for a record of `element_count` elements, zeroed.
    ///
    /// # Errors
    /// [`LineError::TooLong`] past the longest record of the plan; [`LineError::Shared`] when none can be had.
    pub fn loan(&self, element_count: usize) -> Result<Loan<'_, 'l, T>, LineError> {
        if element_count > self.elements_max {
            return Err(LineError::TooLong { topic: T::NAME, got: element_count, most: self.elements_max });
        }
        let sample =
            self.port.loan_slice(element_count).map_err(|e| LineError::shared(format!("a loan on {}", T::NAME), e))?;
        Ok(Loan { publisher: self, sample })
    }

    /// Sends one copy of `elements` behind `header`, waiting while a subscriber is slow, dead or not there yet.
    ///
    /// # Errors
    /// As [`Publisher::loan`] and [`Loan::send`].
    pub fn send(&self, kind: RecordKind, header: T::Header, elements: &[T::Element]) -> Result<(), LineError> {
        self.loan_copy(header, elements)?.send(kind)
    }

    /// As [`Publisher::send`], but gives up at once instead of waiting; whether it was sent.
    ///
    /// # Errors
    /// As [`Publisher::send`].
    pub fn try_send(&self, kind: RecordKind, header: T::Header, elements: &[T::Element]) -> Result<bool, LineError> {
        if !self.poll_ready()? {
            return Ok(false);
        }
        let loan = self.loan_copy(header, elements)?;
        self.may_block.store(false, Ordering::Relaxed);
        let sent = loan.deliver(kind);
        self.may_block.store(true, Ordering::Relaxed);
        match sent {
            Ok(()) => Ok(true),
            Err(LineError::Stopped { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Whether anyone but `role` subscribes to the topic.
    pub fn has_subscriber_other_than(&self, role: Role) -> bool {
        self.subscribers().1.iter().any(|name| *name != role.name())
    }

    fn loan_copy(&self, header: T::Header, elements: &[T::Element]) -> Result<Loan<'_, 'l, T>, LineError> {
        let mut loan = self.loan(elements.len())?;
        *loan.header_mut() = header;
        loan.elements_mut().copy_from_slice(elements);
        Ok(loan)
    }

    /// Waits until every subscriber that must have the records is READY for them.
    ///
    /// # Errors
    /// [`LineError::Stopped`] when the process is asked to end meanwhile.
    pub fn wait_ready(&self) -> Result<(), LineError> {
        let since = Instant::now();
        let mut told = since;
        while !self.poll_ready()? {
            if self.line.is_stopped() {
                return Err(LineError::Stopped { topic: T::NAME });
            }
            if told.elapsed() > TELL_AFTER {
                told = Instant::now();
                let needed: Vec<String> = T::SUBSCRIBERS.iter().map(|role| role.name()).collect();
                let (_, present) = self.subscribers();
                let waited_s = since.elapsed().as_secs();
                tracing::warn!(topic = T::NAME, waited_s, ?needed, ?present, "waiting for subscribers");
            }
            self.line.wait(Duration::from_millis(50))?;
        }
        Ok(())
    }

    /// Takes one step of the handshake, without waiting; whether all are READY.
    fn poll_ready(&self) -> Result<bool, LineError> {
        if T::SUBSCRIBERS.is_empty() {
            return Ok(true);
        }
        if self.are_as_greeted() {
            return Ok(true);
        }
        let (present, roles) = self.subscribers();
        self.line.listen()?;
        let is_complete =
            present.len() == T::SUBSCRIBERS.len() && T::SUBSCRIBERS.iter().all(|role| roles.contains(&role.name()));
        let is_asked =
            matches!(&*self.greeting.borrow(), Some((at, to)) if *to == present && at.elapsed() < GREET_AGAIN);
        if is_complete && !is_asked {
            self.greet(present)?;
        }
        for (bit, &role) in T::SUBSCRIBERS.iter().enumerate() {
            if self.line.take(Signal::Ready(role, self.greeting_number.get())) {
                self.ready.set(self.ready.get() | 1 << bit);
            }
        }
        if is_complete && is_asked && self.ready.get().count_ones() as usize == T::SUBSCRIBERS.len() {
            if let Some((_, to)) = self.greeting.take() {
                *self.greeted.borrow_mut() = to;
            }
            return Ok(true);
        }
        Ok(false)
    }

    fn greet(&self, present: Vec<UniqueSubscriberId>) -> Result<(), LineError> {
        let number = self.greeting_number.get() + 1;
        self.greeting_number.set(number);
        // What was said before, perhaps by one who has died since, does not count.
        for &role in T::SUBSCRIBERS {
            self.line.take(Signal::Ready(role, number));
        }
        self.ready.set(0);
        let mut loan = self.loan(0)?;
        loan.header_mut().stamp_mut().mark = number;
        self.may_block.store(false, Ordering::Relaxed);
        let sent = loan.deliver(RecordKind::Greeting);
        self.may_block.store(true, Ordering::Relaxed);
        match sent {
            Ok(()) => *self.greeting.borrow_mut() = Some((Instant::now(), present)),
            Err(LineError::Stopped { .. }) => {} // a full buffer: its owner is alive and slow, or will be reaped
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Whether those who subscribe now are exactly those who have said READY; asked before every record.
    fn are_as_greeted(&self) -> bool {
        let greeted = self.greeted.borrow();
        let (mut count, mut all_known) = (0, !greeted.is_empty());
        self.service.dynamic_config().list_subscribers(|details| {
            count += 1;
            all_known &= greeted.contains(&details.subscriber_id);
            CallbackProgression::Continue
        });
        all_known && count == greeted.len()
    }

    /// Those who subscribe to the topic now, and the names of their roles.
    fn subscribers(&self) -> (Vec<UniqueSubscriberId>, Vec<String>) {
        let (mut present, mut roles) = (Vec::new(), Vec::new());
        self.service.dynamic_config().list_subscribers(|details| {
            present.push(details.subscriber_id);
            roles.push(details.subscriber_name.as_str().to_owned());
            CallbackProgression::Continue
        });
        present.sort_unstable();
        (present, roles)
    }
}

/// A record being written, in shared memory.
#[derive(Debug)]
pub struct Loan<'p, 'l, T: Topic> {
    publisher: &'p Publisher<'l, T>,
    sample: SampleMut<Svc, [T::Element], T::Header>,
}

impl<T: Topic> Loan<'_, '_, T> {
    /// The header, to be filled in; its stamp is filled in when the record is sent, but for `mark`.
    pub fn header_mut(&mut self) -> &mut T::Header {
        self.sample.user_header_mut()
    }

    /// The elements, to be filled in.
    pub fn elements_mut(&mut self) -> &mut [T::Element] {
        self.sample.payload_mut()
    }

    /// Header and elements, to be filled in together.
    pub fn fill<R>(&mut self, fill: impl FnOnce(&mut T::Header, &mut [T::Element]) -> R) -> R {
        let mut header = *self.sample.user_header_mut();
        let result = fill(&mut header, self.sample.payload_mut());
        *self.sample.user_header_mut() = header;
        result
    }

    /// Sends the record to every subscriber, waiting while one is slow, dead or not there yet.
    ///
    /// # Errors
    /// [`LineError::Stopped`] when the process is asked to end meanwhile; [`LineError::Shared`] when sending fails.
    pub fn send(self, kind: RecordKind) -> Result<(), LineError> {
        self.publisher.wait_ready()?;
        self.deliver(kind)
    }

    fn deliver(mut self, kind: RecordKind) -> Result<(), LineError> {
        let publisher = self.publisher;
        let line = publisher.line;
        let sequence = publisher.next_sequence.get();
        let stamp = self.sample.user_header_mut().stamp_mut();
        stamp.kind = kind.code();
        stamp.sequence = sequence;
        stamp.epoch_ns = line.epoch_ns();
        stamp.plan_digest = line.plan_digest();
        if let Role::Acquire(station) = line.role() {
            stamp.source = u32::from(station);
        }
        match self.sample.send() {
            Ok(_) => {}
            Err(SendError::UnableToDeliver) => return Err(LineError::Stopped { topic: T::NAME }),
            Err(error) => return Err(LineError::shared(format!("sending on {}", T::NAME), error)),
        }
        if kind != RecordKind::Greeting {
            publisher.next_sequence.set(sequence + 1);
        }
        for &role in T::SUBSCRIBERS {
            line.ring(role, Signal::Data);
        }
        Ok(())
    }
}
