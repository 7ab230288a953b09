//! The topics: who publishes what to whom, and how many records may wait.

use iceoryx2::prelude::ZeroCopySend;

use crate::plan::casing::{REASON_BYTES_MAX, opened_bytes_max, proposal_bytes_max};
use crate::plan::codec::TAP_BYTES;
use crate::{
    CacheLine, CasingHeader, DamageCell, Discriminators, Judgement, Limits, Plan, Stamp, Stamped, TapHeader,
    cache_lines_for,
};

/// A participant of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Turns taps into records, for some of the stations; the process with this number, from 0.
    Acquire(u16),
    /// Turns records into discriminators.
    Process,
    /// Turns discriminators into damage maps and verdicts.
    Fuse,
    /// Keeps everything.
    Store,
    /// Starts the others, restarts dead ones, and reports verdicts to people.
    Supervisor,
}

impl Role {
    /// Roles before those of the processes that acquire.
    const STAGES: usize = 4;

    /// The role's name: that of its node, its ports and its mailbox.
    pub fn name(self) -> String {
        match self {
            Self::Acquire(number) => format!("acquire-{number}"),
            Self::Process => "process".to_owned(),
            Self::Fuse => "fuse".to_owned(),
            Self::Store => "store".to_owned(),
            Self::Supervisor => "supervisor".to_owned(),
        }
    }

    /// The stage with this [`name`](Self::name); `None` if there is none.
    pub fn of_stage(name: &str) -> Option<Self> {
        match name.split_once('-') {
            Some(("acquire", number)) => number.parse().ok().map(Self::Acquire),
            _ => [Self::Process, Self::Fuse, Self::Store].into_iter().find(|role| role.name() == name),
        }
    }

    /// The role's number in handshakes.
    pub(crate) fn number(self) -> usize {
        match self {
            Self::Process => 0,
            Self::Fuse => 1,
            Self::Store => 2,
            Self::Supervisor => 3,
            Self::Acquire(number) => Self::STAGES + usize::from(number),
        }
    }

    /// How many roles a line with these limits has.
    pub(crate) fn count(limits: &Limits) -> usize {
        Self::STAGES + usize::from(limits.acquire_count)
    }
}

/// Who receives the records of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Every record, to each of these.
    All(&'static [Role]),
    /// Every record, to the one role that it is addressed to: each receiver has a service of its own.
    Addressed,
}

/// A stream of records of one kind.
pub trait Topic: std::fmt::Debug + 'static {
    /// What precedes the elements of each record.
    type Header: Stamped + Clone + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static;
    /// What a record is a slice of.
    type Element: Clone + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static;
    /// Name of the topic's service.
    const NAME: &'static str;
    /// Who publishes on it; `None` if every `acquire` process does.
    const SENDER: Option<Role>;
    /// Who receives it.
    const DELIVERY: Delivery;
    /// Records that may wait at one subscriber.
    const BUFFER: usize;
    /// Records that one subscriber may hold at once.
    const BORROWED: usize;
    /// A subscriber is notified after this many data records, and at any record of another kind. Above one for subscribers that
    /// poll often enough by themselves; always below [`Topic::BUFFER`].
    const WAKE_EVERY: u64 = 1;

    /// Whether a subscriber in this role is notified of every data record, regardless of [`Topic::WAKE_EVERY`].
    fn wakes_always(_: Role) -> bool {
        false
    }
    /// Elements of the longest record, to `receiver` where the topic is addressed.
    fn elements_max(limits: &Limits, receiver: Option<Role>) -> usize;
}

/// Taps, with their samples: `acquire` to `process` and `store`.
#[derive(Debug)]
pub struct TapTopic;

impl Topic for TapTopic {
    type Header = TapHeader;
    type Element = CacheLine;
    const NAME: &'static str = "tapline/tap";
    const SENDER: Option<Role> = None;
    const DELIVERY: Delivery = Delivery::All(&[Role::Process, Role::Store]);
    // 16 rather than 8: a station is not held up by one flush of the archive, and the waiting records of two stations still fit a
    // cache of 2 MiB.
    const BUFFER: usize = 16;
    // `store` packs as many taps together as it may hold, and each batch wakes its workers again: with batches of 16 the disk was
    // idle for a tenth of the time. A station with 64 KiB a tap (0.4 s) needs up to 12.9 MB, with 16 it would be 8.6 MB.
    const BORROWED: usize = 32;
    const WAKE_EVERY: u64 = 8;

    fn wakes_always(subscriber: Role) -> bool {
        subscriber == Role::Process
    }
    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        cache_lines_for(limits.casing.record_bytes).max(cache_lines_for(REASON_BYTES_MAX))
    }
}

/// Discriminators: `process` to `store`.
#[derive(Debug)]
pub struct DiscriminatorTopic;

impl Topic for DiscriminatorTopic {
    type Header = Stamp;
    type Element = Discriminators;
    const NAME: &'static str = "tapline/discriminators";
    const SENDER: Option<Role> = Some(Role::Process);
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 64;
    const BORROWED: usize = 2;
    const WAKE_EVERY: u64 = 32;

    fn elements_max(_: &Limits, _: Option<Role>) -> usize {
        1
    }
}

/// Plans that stations propose, and casings that stations give up: `acquire` to `store`.
#[derive(Debug)]
pub struct ProposalTopic;

impl Topic for ProposalTopic {
    type Header = Stamp;
    type Element = u8;
    const NAME: &'static str = "tapline/proposal";
    const SENDER: Option<Role> = None;
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        proposal_bytes_max(limits)
    }
}

/// What stations wait for, their faults and alarms, and, as refusals, casings that are not judged: `acquire` to the supervisor. The mark of a
/// record is its station.
#[derive(Debug)]
pub struct WaitTopic;

impl Topic for WaitTopic {
    type Header = Stamp;
    type Element = u8;
    const NAME: &'static str = "tapline/wait";
    const SENDER: Option<Role> = None;
    const DELIVERY: Delivery = Delivery::All(&[Role::Supervisor]);
    const BUFFER: usize = 32;
    const BORROWED: usize = 1;
    // The supervisor looks several times a second.
    const WAKE_EVERY: u64 = 31;

    fn elements_max(_: &Limits, _: Option<Role>) -> usize {
        REASON_BYTES_MAX
    }
}

/// Open casings and their ledgers, as far as each needs them: `store` to each `acquire`, `fuse` and the supervisor.
#[derive(Debug)]
pub struct CasingTopic;

impl Topic for CasingTopic {
    type Header = CasingHeader;
    type Element = u8;
    const NAME: &'static str = "tapline/casing";
    const SENDER: Option<Role> = Some(Role::Store);
    const DELIVERY: Delivery = Delivery::Addressed;
    const BUFFER: usize = 8;
    const BORROWED: usize = 2;

    fn elements_max(limits: &Limits, receiver: Option<Role>) -> usize {
        let casing = &limits.casing;
        match receiver {
            Some(Role::Fuse) => opened_bytes_max(limits, 0).max(Plan::encoded_bytes_max(casing)),
            Some(Role::Supervisor) => opened_bytes_max(limits, casing.taps),
            _ => opened_bytes_max(limits, casing.room),
        }
    }
}

/// Most discriminators that one record of [`SettledTopic`] carries.
pub const SETTLED_RECORDS_MAX: usize = 256;

/// Discriminators that are safe in the archive: `store` to `fuse`. The mark of a record is the tap count of its casing's plan.
#[derive(Debug)]
pub struct SettledTopic;

impl Topic for SettledTopic {
    type Header = Stamp;
    type Element = Discriminators;
    const NAME: &'static str = "tapline/settled";
    const SENDER: Option<Role> = Some(Role::Store);
    const DELIVERY: Delivery = Delivery::All(&[Role::Fuse]);
    const BUFFER: usize = 8;
    const BORROWED: usize = 2;

    fn elements_max(_: &Limits, _: Option<Role>) -> usize {
        SETTLED_RECORDS_MAX
    }
}

/// Damage maps and verdicts: `fuse` to `store`.
#[derive(Debug)]
pub struct DamageTopic;

impl Topic for DamageTopic {
    type Header = Judgement;
    type Element = DamageCell;
    const NAME: &'static str = "tapline/damage";
    const SENDER: Option<Role> = Some(Role::Fuse);
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        limits.casing.locations.max(1)
    }
}

/// Additional taps, requested because of what others showed: `fuse` to `store`, which adds them to the casing's plan. The
/// mark of a record is the number of taps in the plan that it is based on; [`crate::encode_taps`] wrote its bytes.
#[derive(Debug)]
pub struct AskTopic;

impl Topic for AskTopic {
    type Header = Stamp;
    type Element = u8;
    const NAME: &'static str = "tapline/ask";
    const SENDER: Option<Role> = Some(Role::Fuse);
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        (limits.casing.room * TAP_BYTES).max(1)
    }
}

/// Ports of dead processes that are not removed yet.
const SPARE_PORTS: usize = 1;

/// The receivers of an addressed topic.
pub(crate) fn receivers(limits: &Limits) -> impl Iterator<Item = Role> {
    [Role::Fuse, Role::Supervisor].into_iter().chain((0..limits.acquire_count).map(Role::Acquire))
}

/// How many processes publish on a topic.
fn publishers<T: Topic>(limits: &Limits) -> usize {
    if T::SENDER.is_some() { 1 } else { limits.acquire_count.into() }
}

/// Limits of a topic's service: publishers, subscribers and nodes, dead ones included.
pub(crate) fn port_limits<T: Topic>(limits: &Limits) -> (usize, usize, usize) {
    let subscribers = match T::DELIVERY {
        Delivery::All(roles) => roles.len(),
        Delivery::Addressed => 1,
    };
    let ports = (publishers::<T>(limits) + SPARE_PORTS, subscribers + SPARE_PORTS);
    (ports.0, ports.1, ports.0 + ports.1)
}

/// Most shared memory that one publisher of `T` to `receiver` may need, in bytes.
pub(crate) fn publisher_bytes<T: Topic>(limits: &Limits, receiver: Option<Role>) -> usize {
    let (_, subscribers, _) = port_limits::<T>(limits);
    let slots = subscribers * (T::BUFFER + T::BORROWED) + LOANED;
    // A record's management header and the padding to its alignment are below a kilobyte.
    slots * (T::elements_max(limits, receiver) * size_of::<T::Element>() + size_of::<T::Header>() + 512)
}

/// Records that a publisher may have on loan at once.
pub(crate) const LOANED: usize = 2;

/// Most shared memory that a whole line may need, in bytes.
pub fn line_bytes(limits: &Limits) -> usize {
    fn of<T: Topic>(limits: &Limits) -> usize {
        publisher_bytes::<T>(limits, None) * publishers::<T>(limits)
    }
    let to_each: usize = receivers(limits).map(|role| publisher_bytes::<CasingTopic>(limits, Some(role))).sum();
    of::<TapTopic>(limits)
        + of::<DiscriminatorTopic>(limits)
        + of::<ProposalTopic>(limits)
        + of::<WaitTopic>(limits)
        + of::<SettledTopic>(limits)
        + of::<DamageTopic>(limits)
        + of::<AskTopic>(limits)
        + to_each
}
