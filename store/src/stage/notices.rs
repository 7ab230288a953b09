//! Notices to the other stages about the open casings; a stage that has just started gets everything.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::{Duration, Instant};

use tapline_wire::{CasingHeader, CasingTopic, Line, LineError, Publisher, RecordKind, Role, Stamp, encode_opened};

use super::markers::Closed;
use super::open_casing::{Due, OpenCasing};
use super::{Result, RunError, StageLoop, markers};

/// Time between two reports to the supervisor of how far a casing is.
const SUPERVISOR_EVERY: Duration = Duration::from_millis(500);

/// A notice that is sent once: a file was closed, a proposal refused.
#[derive(Debug, Clone)]
struct Once {
    kind: RecordKind,
    header: CasingHeader,
    text: String,
    /// Marker that is removed when every receiver has the notice.
    marker: Option<Rc<PathBuf>>,
}

/// One receiver.
#[derive(Debug)]
struct Receiver<'a> {
    role: Role,
    publisher: Publisher<'a, CasingTopic>,
    generation: u64,
    /// Notices that are to be sent once.
    once: VecDeque<Once>,
}

/// All receivers.
#[derive(Debug)]
pub(super) struct Notices<'a> {
    receivers: Vec<Receiver<'a>>,
    /// Whether a notice could not be sent, because a buffer was full or a receiver not there.
    is_pending: bool,
}

impl<'a> Notices<'a> {
    pub(super) fn open(line: &'a Line) -> Result<Self, LineError> {
        let acquires = (0..line.limits().acquire_count).map(Role::Acquire);
        let roles = acquires.chain([Role::Fuse, Role::Supervisor]);
        let receivers = roles.map(|role| {
            let publisher = Publisher::open_to(line, role)?;
            Ok(Receiver { role, publisher, generation: 0, once: VecDeque::new() })
        });
        let mut notices = Self { receivers: receivers.collect::<Result<_, LineError>>()?, is_pending: false };
        // The process before this one may have been killed while it waited.
        notices.outage("");
        Ok(notices)
    }

    pub(super) fn are_pending(&self) -> bool {
        self.is_pending
    }

    /// Queues the notice that a file is closed for every stage that it concerns.
    pub(super) fn closed(&mut self, closed: Closed) {
        let to = closed.acquire.map(Role::Acquire);
        let concerns = |role| matches!(role, Role::Fuse | Role::Supervisor) || Some(role) == to;
        let (text, marker) = (closed.path.display().to_string(), Some(Rc::new(closed.marker)));
        self.queue(&Once { kind: RecordKind::Closed, header: closed.header, text, marker }, concerns);
    }

    /// Queues `once` for the receivers that it `concerns`.
    fn queue(&mut self, once: &Once, concerns: impl Fn(Role) -> bool) {
        for receiver in self.receivers.iter_mut().filter(|receiver| concerns(receiver.role)) {
            receiver.once.push_back(once.clone());
        }
    }

    /// Queues the notice that no casing of that number is open, for the sender of a barrier, which would wait for ever, and for
    /// the supervisor.
    pub(super) fn unknown(&mut self, stamp: &Stamp) {
        let mut header = CasingHeader::default();
        header.stamp.casing = stamp.casing;
        let acquire = u16::try_from(stamp.source).unwrap_or(u16::MAX);
        self.answer(acquire, RecordKind::Refusal, header, "its unfinished file no longer exists, or is damaged");
    }

    /// Queues for the supervisor why the archive cannot be written; empty when it can.
    pub(super) fn outage(&mut self, why: &str) {
        let once =
            Once { kind: RecordKind::Alarm, header: CasingHeader::default(), text: why.to_owned(), marker: None };
        self.queue(&once, |role| role == Role::Supervisor);
    }

    /// Queues for the supervisor why the casing of this number, which was half tapped, must be tapped again.
    pub(super) fn put_aside(&mut self, number: u64, why: &str) {
        let mut header = CasingHeader::default();
        header.stamp.casing = number;
        let once = Once { kind: RecordKind::Alarm, header, text: why.to_owned(), marker: None };
        self.queue(&once, |role| role == Role::Supervisor);
    }

    /// Queues the notice that a proposal is refused, or its casing finished already, for the station and the supervisor.
    pub(super) fn answer(&mut self, acquire: u16, kind: RecordKind, header: CasingHeader, text: &str) {
        let concerns = |role| role == Role::Acquire(acquire) || role == Role::Supervisor;
        self.queue(&Once { kind, header, text: text.to_owned(), marker: None }, concerns);
    }
}

impl StageLoop<'_> {
    /// Sends what is due. It must never wait, because a receiver may be waiting for this stage.
    pub(super) fn send_notices(&mut self) -> Result<(), RunError> {
        let (lost_count, is_held) = (self.lost_count(), self.is_held);
        let Self { notices, open, line, .. } = self;
        notices.is_pending = false;
        for receiver in &mut notices.receivers {
            let concerns = |casing: &OpenCasing| match receiver.role {
                Role::Acquire(number) => line.limits().acquire_of(casing.station) == Some(number),
                _ => true,
            };
            if !receiver.publisher.poll_ready()? {
                let has_news =
                    |casing: &mut OpenCasing| concerns(casing) && *due_of(casing, receiver.role) != Due::default();
                notices.is_pending |= !receiver.once.is_empty() || open.iter_mut().any(has_news);
                continue;
            }
            if std::mem::replace(&mut receiver.generation, receiver.publisher.generation())
                != receiver.publisher.generation()
            {
                open.iter_mut().for_each(|casing| *due_of(casing, receiver.role) = Due::ALL);
            }
            let mut is_pending = false;
            for casing in open.iter_mut().filter(|casing| concerns(casing)) {
                is_pending |= !send_due(receiver, casing, lost_count, is_held)?;
            }
            // Queued notices come after plans and ledgers.
            while let Some(once) = receiver.once.front() {
                if !receiver.publisher.try_send(once.kind, once.header, once.text.as_bytes())? {
                    is_pending = true;
                    break;
                }
                let marker = receiver.once.pop_front().and_then(|once| once.marker);
                if let Some(marker) = marker.filter(|marker| Rc::strong_count(marker) == 1) {
                    markers::remove(&marker);
                }
            }
            notices.is_pending |= is_pending;
        }
        Ok(())
    }
}

fn due_of(casing: &mut OpenCasing, role: Role) -> &mut Due {
    match role {
        Role::Fuse => &mut casing.fuse,
        Role::Supervisor => &mut casing.supervisor,
        _ => &mut casing.acquire,
    }
}

/// Sends `receiver` what is due of `casing`; returns whether all of it was sent.
fn send_due(
    receiver: &Receiver<'_>,
    casing: &mut OpenCasing,
    lost_count: u64,
    is_held: bool,
) -> Result<bool, LineError> {
    let due = *due_of(casing, receiver.role);
    if due.plan {
        let header = casing.header();
        let plan = match receiver.role {
            Role::Fuse => casing.writer.plan().encode(),
            Role::Supervisor => encode_opened(&casing.name, casing.writer.plan().taps()),
            _ => encode_opened(&casing.name, casing.writer.plan().added()),
        };
        if !receiver.publisher.try_send(RecordKind::Plan, header, &plan)? {
            return Ok(false);
        }
        due_of(casing, receiver.role).plan = false;
    }
    if due.ledger {
        if receiver.role == Role::Supervisor {
            // Reports to the supervisor are not sent at every flush.
            if casing.supervisor_sent_at.is_some_and(|at| at.elapsed() < SUPERVISOR_EVERY) {
                return Ok(true);
            }
            casing.supervisor_sent_at = Some(Instant::now());
        }
        let has_taps = receiver.role != Role::Fuse;
        let (mut header, ledger) = casing.ledger(lost_count, is_held);
        let mut loan = receiver.publisher.loan(ledger.encoded_bytes(has_taps, true))?;
        loan.fill(|to, bytes| {
            ledger.encode(&mut header, has_taps, true, bytes);
            *to = header;
        });
        if !loan.try_send(RecordKind::Ledger)? {
            return Ok(false);
        }
        due_of(casing, receiver.role).ledger = false;
    }
    Ok(true)
}
