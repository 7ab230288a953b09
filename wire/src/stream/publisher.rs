//! Sending records: a loan is filled in place and sent once, to every subscriber.

use std::cell::{Cell, RefCell};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueSubscriberId;
use iceoryx2::port::publisher::Publisher as Port;
use iceoryx2::port::{BackpressureAction, SendError};
use iceoryx2::prelude::*;
use iceoryx2::sample_mut::SampleMut;

use crate::stream::cleanup::Svc;
use crate::stream::service::{Service, failed, open};
use crate::stream::shm;
use crate::stream::topic::{LOANED, publisher_bytes};
use crate::{Delivery, Line, LineError, RecordKind, Role, Stamped, Topic};

/// The sending end of a topic.
///
/// Before a record is sent, every subscriber has answered READY to a handshake over the same connection. If a subscriber joins
/// later, the handshake is repeated before the next record.
#[derive(Debug)]
pub struct Publisher<'l, T: Topic> {
    line: &'l Line,
    service: Service<T>,
    port: Port<Svc, [T::Element], T::Header>,
    receivers: Vec<Role>,
    elements_max: usize,
    next_sequence: Cell<u64>,
    /// Subscribers that have answered READY; records are sent only while these are exactly the present ones.
    ready_subscribers: RefCell<Vec<UniqueSubscriberId>>,
    /// Number of completed handshakes.
    generation: Cell<u64>,
    handshake: RefCell<Option<Handshake>>,
    may_block: Arc<AtomicBool>,
}

/// A handshake that not all subscribers have answered yet.
#[derive(Debug)]
struct Handshake {
    number: u64,
    sent_at: Instant,
    to: Vec<UniqueSubscriberId>,
    /// For each receiver whether it has answered READY.
    are_ready: Vec<bool>,
}

/// How long a handshake may go unanswered before it is repeated.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(1);

/// How long a wait may last before it is logged.
const LOG_AFTER: Duration = Duration::from_secs(5);

impl<'l, T: Topic> Publisher<'l, T> {
    /// Opens the sending end of topic `T`.
    ///
    /// # Errors
    /// [`LineError::Stopped`] when the process is asked to end while it waits for room in shared memory; [`LineError::Shared`]
    /// otherwise.
    pub fn open(line: &'l Line) -> Result<Self, LineError> {
        let receivers = match T::DELIVERY {
            Delivery::All(roles) => roles.to_vec(),
            Delivery::Addressed => Vec::new(),
        };
        Self::open_for(line, None, receivers)
    }

    /// Opens the sending end of the addressed topic `T` to `receiver`.
    ///
    /// # Errors
    /// As [`Publisher::open`].
    pub fn open_to(line: &'l Line, receiver: Role) -> Result<Self, LineError> {
        Self::open_for(line, Some(receiver), vec![receiver])
    }

    fn open_for(line: &'l Line, receiver: Option<Role>, receivers: Vec<Role>) -> Result<Self, LineError> {
        let bytes = publisher_bytes::<T>(line.limits(), receiver);
        let what = format!("{} from {}", T::NAME, line.role().name());
        // The start of the line has checked that there is memory for all; what has filled it since will be freed.
        shm::retry_until_free(&|| line.is_stopped(), || shm::compare(&what, bytes as u64, shm::free_bytes()?))?;
        let service = open::<T>(line, receiver)?;
        let elements_max = T::elements_max(line.limits(), receiver);
        let may_block = Arc::new(AtomicBool::new(true));
        let (handler_may_block, stop, waker) = (may_block.clone(), line.stop().clone(), line.waker());
        let port = service
            .publisher_builder()
            .initial_max_slice_len(elements_max)
            .max_loaned_samples(LOANED)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(move |info| {
                if stop.load(Ordering::Relaxed) || !handler_may_block.load(Ordering::Relaxed) {
                    return BackpressureAction::DiscardDataAndFail;
                }
                // It is the subscriber that is held up.
                waker.beat();
                // The subscriber that blocks may be dead: the supervisor notices and removes it, which ends this wait.
                // One that runs frees a place before the shortest sleep ends: with sleeps alone 4 KiB took 10 us instead of 3.
                match info.retries {
                    0..32 => std::thread::yield_now(),
                    32..64 => std::thread::sleep(Duration::from_micros(100)),
                    64..96 => std::thread::sleep(Duration::from_micros(400)),
                    _ => std::thread::sleep(Duration::from_millis(2)),
                }
                BackpressureAction::Retry
            })
            .create()
            .map_err(|e| failed::<T>(line, "publishing on", e))?;
        // The layer only promises the memory; touching a page that is not there would kill the process.
        shm::retry_until_free(&|| line.is_stopped(), || shm::reserve(&what, line.address()))?;
        Ok(Self {
            line,
            service,
            port,
            receivers,
            elements_max,
            next_sequence: Cell::new(0),
            ready_subscribers: RefCell::default(),
            generation: Cell::new(0),
            handshake: RefCell::default(),
            may_block,
        })
    }

    /// Zeroed shared memory for a record of `element_count` elements.
    ///
    /// # Errors
    /// [`LineError::TooLong`] past the longest record of the line; [`LineError::Shared`] when none can be had.
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

    /// As [`Publisher::send`], but gives up instead of waiting; returns whether it was sent.
    ///
    /// # Errors
    /// As [`Publisher::send`].
    pub fn try_send(&self, kind: RecordKind, header: T::Header, elements: &[T::Element]) -> Result<bool, LineError> {
        if !self.poll_ready()? {
            return Ok(false);
        }
        let loan = self.loan_copy(header, elements)?;
        self.without_blocking(|| loan.deliver(kind))
    }

    /// Runs `deliver`, which gives up instead of waiting; returns whether it succeeded.
    fn without_blocking(&self, deliver: impl FnOnce() -> Result<(), LineError>) -> Result<bool, LineError> {
        self.may_block.store(false, Ordering::Relaxed);
        let sent = deliver();
        self.may_block.store(true, Ordering::Relaxed);
        match sent {
            Ok(()) => Ok(true),
            Err(LineError::Stopped { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    fn loan_copy(&self, header: T::Header, elements: &[T::Element]) -> Result<Loan<'_, 'l, T>, LineError> {
        let mut loan = self.loan(elements.len())?;
        *loan.sample.user_header_mut() = header;
        loan.sample.payload_mut().copy_from_slice(elements);
        Ok(loan)
    }

    /// Waits until every subscriber that must have the records is READY for them.
    ///
    /// # Errors
    /// [`LineError::Stopped`] when the process is asked to end meanwhile.
    pub fn wait_ready(&self) -> Result<(), LineError> {
        let since = Instant::now();
        let mut logged_at = since;
        let mut has_waited = false;
        while !self.poll_ready()? {
            if self.line.is_stopped() {
                return Err(LineError::Stopped { topic: T::NAME });
            }
            if logged_at.elapsed() > LOG_AFTER {
                logged_at = Instant::now();
                let (_, present) = self.subscribers();
                let (there, absent): (Vec<String>, Vec<String>) =
                    self.receivers.iter().map(|role| role.name()).partition(|name| present.contains(name));
                let waited_s = since.elapsed().as_secs();
                match absent.is_empty() {
                    true => {
                        tracing::warn!(topic = T::NAME, waited_s, "waiting for answers from {}", there.join(" and "))
                    }
                    false => tracing::warn!(topic = T::NAME, waited_s, "waiting for {} to start", absent.join(" and ")),
                }
            }
            self.line.wait(Duration::from_millis(50))?;
            has_waited = true;
        }
        if has_waited {
            self.line.look_again();
        }
        Ok(())
    }

    /// Number of completed handshakes: it rises when a subscriber has been replaced by one that has received nothing yet.
    pub fn generation(&self) -> u64 {
        self.generation.get()
    }

    /// Takes one step of the handshake without waiting; returns whether all are READY.
    ///
    /// # Errors
    /// [`LineError::Shared`] when the shared-memory layer refuses.
    pub fn poll_ready(&self) -> Result<bool, LineError> {
        if self.receivers.is_empty() || self.is_ready_for_all() {
            return Ok(true);
        }
        let (present, roles) = self.subscribers();
        let is_complete =
            present.len() == self.receivers.len() && self.receivers.iter().all(|role| roles.contains(&role.name()));
        if !is_complete {
            return Ok(false);
        }
        let mut handshake = self.handshake.borrow_mut();
        let under_way = handshake.as_mut().filter(|h| h.to == present && h.sent_at.elapsed() < HANDSHAKE_TIMEOUT);
        let Some(under_way) = under_way else {
            *handshake = self.start_handshake(present)?;
            return Ok(false);
        };
        for (is_ready, &role) in under_way.are_ready.iter_mut().zip(&self.receivers) {
            *is_ready |= self.line.take_answer(role, under_way.number);
        }
        if under_way.are_ready.iter().all(|&is_ready| is_ready) {
            *self.ready_subscribers.borrow_mut() = std::mem::take(&mut under_way.to);
            self.generation.set(self.generation.get() + 1);
            *handshake = None;
            return Ok(true);
        }
        Ok(false)
    }

    /// Sends a handshake to the subscribers `to`; `None` if the buffer of one is full: it is slow, or dead and will be removed.
    fn start_handshake(&self, to: Vec<UniqueSubscriberId>) -> Result<Option<Handshake>, LineError> {
        let number = self.line.next_handshake();
        // An earlier answer under this number, perhaps of a dead subscriber, does not count.
        for &role in &self.receivers {
            self.line.take_answer(role, number);
        }
        let mut loan = self.loan(0)?;
        loan.sample.user_header_mut().stamp_mut().mark = number;
        let is_sent = self.without_blocking(|| loan.deliver(RecordKind::Handshake))?;
        let are_ready = vec![false; self.receivers.len()];
        Ok(is_sent.then(|| Handshake { number, sent_at: Instant::now(), to, are_ready }))
    }

    /// Whether the present subscribers are exactly those that have answered READY; checked before every record.
    fn is_ready_for_all(&self) -> bool {
        let ready_subscribers = self.ready_subscribers.borrow();
        let (mut count, mut all_known) = (0, !ready_subscribers.is_empty());
        self.service.dynamic_config().list_subscribers(|details| {
            count += 1;
            all_known &= ready_subscribers.contains(&details.subscriber_id);
            CallbackProgression::Continue
        });
        all_known && count == ready_subscribers.len()
    }

    /// The present subscribers, and the names of their roles.
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
    /// Fills header and elements; sending fills in the stamp, except `casing` and `mark`.
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

    /// As [`Loan::send`], but gives up instead of waiting; returns whether it was sent.
    ///
    /// # Errors
    /// As [`Loan::send`].
    pub fn try_send(self, kind: RecordKind) -> Result<bool, LineError> {
        let publisher = self.publisher;
        if !publisher.poll_ready()? {
            return Ok(false);
        }
        publisher.without_blocking(|| self.deliver(kind))
    }

    fn deliver(mut self, kind: RecordKind) -> Result<(), LineError> {
        let publisher = self.publisher;
        let line = publisher.line;
        let sequence = publisher.next_sequence.get();
        let stamp = self.sample.user_header_mut().stamp_mut();
        stamp.kind = kind.code();
        stamp.sequence = sequence;
        stamp.epoch_ns = line.epoch_ns();
        if let Role::Acquire(number) = line.role() {
            stamp.source = number.into();
        }
        match self.sample.send() {
            Ok(_) => {}
            Err(SendError::UnableToDeliver) => return Err(LineError::Stopped { topic: T::NAME }),
            Err(error) => return Err(LineError::shared(format!("sending on {}", T::NAME), error)),
        }
        if kind != RecordKind::Handshake {
            publisher.next_sequence.set(sequence + 1);
        }
        let wakes_all = kind != RecordKind::Data || sequence % T::WAKE_EVERY == T::WAKE_EVERY - 1;
        for &role in publisher.receivers.iter().filter(|&&role| wakes_all || T::wakes_always(role)) {
            line.notify(role);
        }
        Ok(())
    }
}
