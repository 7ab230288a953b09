//! The topics: who publishes what to whom, and how much of it may wait.

use iceoryx2::prelude::ZeroCopySend;

use crate::plan::casing::{REASON_BYTES_MAX, opened_bytes_max, proposal_bytes_max};
use crate::{CasingHeader, DamageCell, Discriminators, Judgement, Lane, Limits, Stamp, Stamped, TapHeader, lanes_for};

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
    /// Starts the others, heals them, and tells people of verdicts.
    Supervisor,
    /// Looks on: takes no part, and nobody waits for it. The process with this number.
    Viewer(u32),
}

impl Role {
    /// Roles before those of the processes that acquire.
    const STAGES: usize = 4;

    /// The role's name: that of its node, its ports and its events.
    pub fn name(self) -> String {
        match self {
            Self::Acquire(number) => format!("acquire-{number}"),
            Self::Process => "process".to_owned(),
            Self::Fuse => "fuse".to_owned(),
            Self::Store => "store".to_owned(),
            Self::Supervisor => "supervisor".to_owned(),
            Self::Viewer(number) => format!("viewer-{number}"),
        }
    }

    /// The role's number among those that handshakes tell apart.
    pub(crate) fn number(self) -> usize {
        match self {
            Self::Process => 0,
            Self::Fuse => 1,
            Self::Store => 2,
            Self::Supervisor | Self::Viewer(_) => 3,
            Self::Acquire(number) => Self::STAGES + usize::from(number),
        }
    }

    /// How many roles a line with these limits has, viewers aside.
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
    /// To whoever looks on; only the newest record matters, and older ones may be lost.
    Newest,
}

/// A stream of records of one kind.
pub trait Topic: std::fmt::Debug + 'static {
    /// What precedes the elements of each record.
    type Header: Stamped + Clone + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static;
    /// What a record is a slice of.
    type Element: Clone + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static;
    /// Name of the topic's service.
    const NAME: &'static str;
    /// Who receives it.
    const DELIVERY: Delivery;
    /// Records that may wait at one subscriber.
    const BUFFER: usize;
    /// Records that one subscriber may hold at once.
    const BORROWED: usize;
    /// After so many records of data a subscriber is woken, and at every record of another kind. More than one for subscribers
    /// that look by themselves soon enough, so that they are not woken for every tap; below [`Topic::BUFFER`].
    const WAKE_EVERY: u64 = 1;

    /// Who sent a record with this stamp.
    fn sender(stamp: &Stamp) -> Role;
    /// Of `subscribers`, who is woken by every record of data whatever [`Topic::WAKE_EVERY`] says.
    fn wakes_always(_: Role) -> bool {
        false
    }
    /// How many processes publish on the topic.
    fn publishers(limits: &Limits) -> usize;
    /// Elements of the longest record, to `receiver` where the topic is addressed.
    fn elements_max(limits: &Limits, receiver: Option<Role>) -> usize;
}

/// Taps, with their samples: `acquire` to `process` and `store`.
#[derive(Debug)]
pub struct TapTopic;

impl Topic for TapTopic {
    type Header = TapHeader;
    type Element = Lane;
    const NAME: &'static str = "tapline/tap";
    const DELIVERY: Delivery = Delivery::All(&[Role::Process, Role::Store]);
    // 16 against 8: a station rides out one flush of the archive, and what waits of two still fits a cache of 2 MiB.
    const BUFFER: usize = 16;
    // `store` packs as many taps together as it may hold, and each batch wakes its helpers anew: with 16 in a batch the disk
    // stood still for a tenth of the time. A station of 64 KiB a tap may need 12.9 MB for it, 8.6 MB with 16.
    const BORROWED: usize = 32;
    const WAKE_EVERY: u64 = 8;

    fn sender(stamp: &Stamp) -> Role {
        Role::Acquire(u16::try_from(stamp.source).unwrap_or(u16::MAX))
    }
    fn wakes_always(subscriber: Role) -> bool {
        subscriber == Role::Process
    }
    fn publishers(limits: &Limits) -> usize {
        limits.acquire_count.into()
    }
    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        lanes_for(limits.casing.record_bytes).max(lanes_for(REASON_BYTES_MAX))
    }
}

/// Discriminators: `process` to `store`.
#[derive(Debug)]
pub struct DiscriminatorTopic;

impl Topic for DiscriminatorTopic {
    type Header = Stamp;
    type Element = Discriminators;
    const NAME: &'static str = "tapline/discriminators";
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 64;
    const BORROWED: usize = 2;
    const WAKE_EVERY: u64 = 32;

    fn sender(_: &Stamp) -> Role {
        Role::Process
    }
    fn publishers(_: &Limits) -> usize {
        1
    }
    fn elements_max(_: &Limits, _: Option<Role>) -> usize {
        1
    }
}

/// Plans that stations propose, and casings that they give up: `acquire` to `store`.
#[derive(Debug)]
pub struct ProposalTopic;

impl Topic for ProposalTopic {
    type Header = Stamp;
    type Element = u8;
    const NAME: &'static str = "tapline/proposal";
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn sender(stamp: &Stamp) -> Role {
        TapTopic::sender(stamp)
    }
    fn publishers(limits: &Limits) -> usize {
        limits.acquire_count.into()
    }
    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        proposal_bytes_max(limits)
    }
}

/// Longest text that says what a station waits for, in bytes.
pub const WAIT_BYTES_MAX: usize = 256;

/// What stations wait for, as text for people, and, as refusals, alarms: `acquire` to the supervisor. The mark of a record is
/// its station.
#[derive(Debug)]
pub struct WaitTopic;

impl Topic for WaitTopic {
    type Header = Stamp;
    type Element = u8;
    const NAME: &'static str = "tapline/wait";
    const DELIVERY: Delivery = Delivery::All(&[Role::Supervisor]);
    const BUFFER: usize = 32;
    const BORROWED: usize = 1;
    // The supervisor looks several times a second.
    const WAKE_EVERY: u64 = 31;

    fn sender(stamp: &Stamp) -> Role {
        TapTopic::sender(stamp)
    }
    fn publishers(limits: &Limits) -> usize {
        limits.acquire_count.into()
    }
    fn elements_max(_: &Limits, _: Option<Role>) -> usize {
        WAIT_BYTES_MAX
    }
}

/// What is open and how far it is: `store` to each `acquire`, to `fuse` and to the supervisor, each what concerns it.
#[derive(Debug)]
pub struct CasingTopic;

impl Topic for CasingTopic {
    type Header = CasingHeader;
    type Element = u8;
    const NAME: &'static str = "tapline/casing";
    const DELIVERY: Delivery = Delivery::Addressed;
    const BUFFER: usize = 8;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Store
    }
    fn publishers(_: &Limits) -> usize {
        1
    }
    fn elements_max(limits: &Limits, receiver: Option<Role>) -> usize {
        opened_bytes_max(limits, receiver == Some(Role::Fuse))
    }
}

/// Most discriminators that one record of [`SettledTopic`] carries.
pub const SETTLED_RECORDS_MAX: usize = 256;

/// Discriminators that are safe in the archive: `store` to `fuse`. The mark of a record is how many taps its casing's plan has.
#[derive(Debug)]
pub struct SettledTopic;

impl Topic for SettledTopic {
    type Header = Stamp;
    type Element = Discriminators;
    const NAME: &'static str = "tapline/settled";
    const DELIVERY: Delivery = Delivery::All(&[Role::Fuse]);
    const BUFFER: usize = 8;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Store
    }
    fn publishers(_: &Limits) -> usize {
        1
    }
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
    const DELIVERY: Delivery = Delivery::All(&[Role::Store]);
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Fuse
    }
    fn publishers(_: &Limits) -> usize {
        1
    }
    fn elements_max(limits: &Limits, _: Option<Role>) -> usize {
        limits.casing.locations.max(1)
    }
}

/// Longest status of a line, in bytes.
pub const STATUS_BYTES_MAX: usize = 256 * 1024;

/// How the line is, as text for whoever looks on: the supervisor to viewers, who may freeze or die as they like.
#[derive(Debug)]
pub struct StatusTopic;

impl Topic for StatusTopic {
    type Header = Stamp;
    type Element = u8;
    const NAME: &'static str = "tapline/status";
    const DELIVERY: Delivery = Delivery::Newest;
    const BUFFER: usize = 1;
    // One is held while it is looked whether there is a newer one.
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Supervisor
    }
    fn publishers(_: &Limits) -> usize {
        1
    }
    fn elements_max(_: &Limits, _: Option<Role>) -> usize {
        STATUS_BYTES_MAX
    }
}

/// Viewers that may look on at once.
const VIEWERS_MAX: usize = 8;

/// Places for ports whose processes died and have not been cleared away yet.
const SPARE_PORTS: usize = 1;

/// Those to whom each receiver's service of an addressed topic belongs.
pub(crate) fn receivers(limits: &Limits) -> impl Iterator<Item = Role> {
    [Role::Fuse, Role::Supervisor].into_iter().chain((0..limits.acquire_count).map(Role::Acquire))
}

/// Limits of a topic's service: publishers, subscribers and nodes, the dead among them included.
pub(crate) fn port_limits<T: Topic>(limits: &Limits) -> (usize, usize, usize) {
    let subscribers = match T::DELIVERY {
        Delivery::All(roles) => roles.len(),
        Delivery::Addressed => 1,
        Delivery::Newest => VIEWERS_MAX,
    };
    let ports = (T::publishers(limits) + SPARE_PORTS, subscribers + SPARE_PORTS);
    // A viewer's node stays until the supervisor looks for dead ones.
    (ports.0, ports.1, ports.0 + ports.1 + 2 * VIEWERS_MAX)
}

/// Shared memory that one publisher of `T` to `receiver` may come to need, in bytes.
pub(crate) fn publisher_bytes<T: Topic>(limits: &Limits, receiver: Option<Role>) -> usize {
    let (_, subscribers, _) = port_limits::<T>(limits);
    let slots = subscribers * (T::BUFFER + T::BORROWED) + LOANED;
    // A record's management header and the padding to its alignment are below a kilobyte.
    slots * (T::elements_max(limits, receiver) * size_of::<T::Element>() + size_of::<T::Header>() + 512)
}

/// Records a publisher may have on loan: the one being written, and one in hand.
pub(crate) const LOANED: usize = 2;

/// Shared memory that a whole line may come to need, in bytes.
pub fn line_bytes(limits: &Limits) -> usize {
    fn of<T: Topic>(limits: &Limits) -> usize {
        publisher_bytes::<T>(limits, None) * T::publishers(limits)
    }
    let to_each: usize = receivers(limits).map(|role| publisher_bytes::<CasingTopic>(limits, Some(role))).sum();
    of::<TapTopic>(limits)
        + of::<DiscriminatorTopic>(limits)
        + of::<ProposalTopic>(limits)
        + of::<WaitTopic>(limits)
        + of::<SettledTopic>(limits)
        + of::<DamageTopic>(limits)
        + of::<StatusTopic>(limits)
        + to_each
}
