//! Receiving records in place, in order, with every gap noticed.

use std::cell::RefCell;
use std::collections::HashMap;
use std::ops::Deref;

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::subscriber::Subscriber as Port;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::stream::cleanup::Svc;
use crate::stream::service::{Service, failed, open};
use crate::{Delivery, Line, LineError, RecordKind, Role, Stamped, Topic};

/// Counts lost records by the gaps in sequence numbers.
#[derive(Debug)]
struct GapCounter<K> {
    next: HashMap<K, u64>,
    lost: u64,
}

impl<K: std::hash::Hash + Eq> GapCounter<K> {
    /// Notes the record numbered `sequence` of `sender`. `taken` is 1, or 0 for a record that only gives the number
    /// of the next. Returns how many before it are missing.
    fn note(&mut self, sender: K, sequence: u64, taken: u64) -> u64 {
        let expected = self.next.insert(sender, sequence + taken).unwrap_or(sequence);
        let missing = sequence.saturating_sub(expected);
        self.lost += missing;
        missing
    }
}

/// The receiving end of a topic.
#[derive(Debug)]
pub struct Subscriber<'l, T: Topic> {
    line: &'l Line,
    port: Port<Svc, [T::Element], T::Header>,
    // The service must outlive the subscriber, or publishers would lose it first.
    _service: Service<T>,
    gaps: RefCell<GapCounter<UniquePublisherId>>,
}

impl<'l, T: Topic> Subscriber<'l, T> {
    /// Opens the receiving end of topic `T`; for an addressed topic, that for records addressed to this process.
    ///
    /// # Errors
    /// [`LineError::Shared`] when the shared-memory layer refuses.
    pub fn open(line: &'l Line) -> Result<Self, LineError> {
        let service = open::<T>(line, (T::DELIVERY == Delivery::Addressed).then(|| line.role()))?;
        let name = line.role().name();
        let port_name = PortName::new(&name).map_err(|e| LineError::shared(format!("naming the port of {name}"), e))?;
        let port = service.subscriber_builder().name(&port_name);
        let port = port.create().map_err(|e| failed::<T>(line, "subscribing to", e))?;
        // Senders may have records for this process from before it joined: they are notified that it has.
        let senders = match line.role() {
            Role::Acquire(_) | Role::Fuse | Role::Supervisor => vec![Role::Store],
            Role::Process | Role::Store => Vec::new(),
        };
        senders.into_iter().for_each(|role| line.notify(role));
        Ok(Self { line, port, _service: service, gaps: RefCell::new(GapCounter { next: HashMap::new(), lost: 0 }) })
    }

    /// The next record, `None` if there is none now. Handshakes are answered here and not returned.
    ///
    /// # Errors
    /// [`LineError::Shared`] when receiving fails.
    pub fn receive(&self) -> Result<Option<Received<T>>, LineError> {
        loop {
            let sample = self.port.receive().map_err(|e| LineError::shared(format!("receiving on {}", T::NAME), e))?;
            let Some(sample) = sample else {
                self.line.beat();
                return Ok(None);
            };
            let stamp = *sample.user_header().stamp();
            let is_handshake = stamp.kind() == Some(RecordKind::Handshake);
            self.count(sample.origin(), stamp.sequence, is_handshake);
            if !is_handshake {
                return Ok(Some(Received { sample }));
            }
            let sender = T::SENDER.unwrap_or(Role::Acquire(u16::try_from(stamp.source).unwrap_or(u16::MAX)));
            self.line.answer(sender, stamp.mark);
        }
    }

    /// Records lost on the way here so far.
    pub fn lost(&self) -> u64 {
        self.gaps.borrow().lost
    }

    fn count(&self, origin: UniquePublisherId, sequence: u64, is_handshake: bool) {
        let mut gaps = self.gaps.borrow_mut();
        let missing = gaps.note(origin, sequence, u64::from(!is_handshake));
        if missing > 0 {
            tracing::error!(topic = T::NAME, missing, sequence, "records were lost");
        }
    }
}

/// A record in shared memory. It stays valid until this is dropped, even if its sender ends.
pub struct Received<T: Topic> {
    sample: Sample<Svc, [T::Element], T::Header>,
}

impl<T: Topic> Received<T> {
    /// The record's header.
    pub fn header(&self) -> &T::Header {
        self.sample.user_header()
    }

    /// The record's kind; `None` for an unknown one, such as a newer version may send.
    pub fn kind(&self) -> Option<RecordKind> {
        self.header().stamp().kind()
    }
}

impl<T: Topic> Deref for Received<T> {
    type Target = [T::Element];
    fn deref(&self) -> &Self::Target {
        self.sample.payload()
    }
}

impl<T: Topic> std::fmt::Debug for Received<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Received").field("topic", &T::NAME).field("header", self.header()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Law 2. Catches a gap that is counted twice, not at all, or against the wrong sender.
    #[test]
    fn a_gap_is_counted_once() {
        let mut gaps = GapCounter { next: HashMap::new(), lost: 0 };
        assert_eq!((gaps.note("a", 7, 1), gaps.note("a", 8, 1)), (0, 0), "the first record of a sender shows no gap");
        assert_eq!(gaps.note("b", 0, 1), 0);
        assert_eq!(gaps.note("a", 11, 1), 2);
        assert_eq!(gaps.note("a", 12, 1), 0);
        assert_eq!(gaps.note("b", 3, 0), 2, "a handshake names the next number");
        assert_eq!(gaps.note("b", 3, 1), 0);
        assert_eq!(gaps.lost, 4);
    }
}
