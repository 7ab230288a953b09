//! The topics: who publishes what to whom, and how much of it may wait.

use iceoryx2::prelude::ZeroCopySend;

use crate::{
    DamageCell, Discriminators, Judgement, Lane, Ledger, LedgerHeader, Plan, Stamp, Stamped, TapHeader, lanes_for,
};

/// A participant of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Turns taps into records; one a station, which is named.
    Acquire(u16),
    /// Turns records into discriminators.
    Process,
    /// Turns discriminators into damage maps and verdicts.
    Fuse,
    /// Keeps everything.
    Store,
    /// Looks on: shows progress, takes no part.
    Watch,
}

impl Role {
    /// The role's name: that of its node, its ports and its bell.
    pub fn name(self) -> String {
        match self {
            Self::Acquire(station) => format!("acquire-{station}"),
            Self::Process => "process".to_owned(),
            Self::Fuse => "fuse".to_owned(),
            Self::Store => "store".to_owned(),
            Self::Watch => "watch".to_owned(),
        }
    }
}

/// A stream of records of one kind.
pub trait Topic: std::fmt::Debug + 'static {
    /// What precedes the elements of each record.
    type Header: Stamped + Clone + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static;
    /// What a record is a slice of.
    type Element: Clone + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static;
    /// Name of the topic's service.
    const NAME: &'static str;
    /// Roles that must have every record; empty where only the newest record matters and older ones may be lost.
    const SUBSCRIBERS: &'static [Role];
    /// Records that may wait at one subscriber.
    const BUFFER: usize;
    /// Records that one subscriber may hold at once.
    const BORROWED: usize;

    /// Who sent a record with this stamp.
    fn sender(stamp: &Stamp) -> Role;
    /// How many processes publish on the topic, and how many subscribe to it.
    fn ports(plan: &Plan) -> (usize, usize);
    /// Elements of the longest record.
    fn elements_max(plan: &Plan) -> usize;
}

/// Places for ports whose processes died and have not been cleared away yet.
const SPARE_PORTS: usize = 2;

/// Longest reason a refusal can carry, in bytes.
pub const REASON_BYTES_MAX: usize = 1024;

/// Taps, with their samples: `acquire` to `process` and `store`.
#[derive(Debug)]
pub struct TapTopic;

impl Topic for TapTopic {
    type Header = TapHeader;
    type Element = Lane;
    const NAME: &'static str = "tapline/tap";
    const SUBSCRIBERS: &'static [Role] = &[Role::Process, Role::Store];
    // 16 against 8: a station rides out one flush of the archive, and what waits of two still fits a cache of 2 MiB.
    const BUFFER: usize = 16;
    // `store` packs as many taps together as it may hold, and each batch wakes its helpers anew: with 16 in a batch the disk
    // stood still for a tenth of the time. A station of 64 KiB a tap may need 12.9 MB for it, 8.6 MB with 16.
    const BORROWED: usize = 32;

    fn sender(stamp: &Stamp) -> Role {
        Role::Acquire(u16::try_from(stamp.source).unwrap_or(u16::MAX))
    }
    fn ports(plan: &Plan) -> (usize, usize) {
        (plan.stations().len(), 2)
    }
    fn elements_max(plan: &Plan) -> usize {
        let samples = lanes_for(plan.recording.payload_bytes_max());
        let reason = lanes_for(REASON_BYTES_MAX);
        if samples > reason { samples } else { reason }
    }
}

/// Discriminators: `process` to `fuse` and `store`.
#[derive(Debug)]
pub struct DiscriminatorTopic;

impl Topic for DiscriminatorTopic {
    type Header = Stamp;
    type Element = Discriminators;
    const NAME: &'static str = "tapline/discriminators";
    const SUBSCRIBERS: &'static [Role] = &[Role::Fuse, Role::Store];
    const BUFFER: usize = 64;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Process
    }
    fn ports(_: &Plan) -> (usize, usize) {
        (1, 2)
    }
    fn elements_max(_: &Plan) -> usize {
        1
    }
}

/// Damage maps and verdicts: `fuse` to `store`.
#[derive(Debug)]
pub struct DamageTopic;

impl Topic for DamageTopic {
    type Header = Judgement;
    type Element = DamageCell;
    const NAME: &'static str = "tapline/damage";
    const SUBSCRIBERS: &'static [Role] = &[Role::Store];
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Fuse
    }
    fn ports(_: &Plan) -> (usize, usize) {
        (1, 1)
    }
    fn elements_max(plan: &Plan) -> usize {
        plan.scans().iter().map(|s| s.locations.len()).fold(1, |most, n| if n > most { n } else { most })
    }
}

/// The ledger, from `store` to all: whole snapshots, of which only the newest matters.
#[derive(Debug)]
pub struct LedgerTopic;

impl Topic for LedgerTopic {
    type Header = LedgerHeader;
    type Element = u8;
    const NAME: &'static str = "tapline/ledger";
    const SUBSCRIBERS: &'static [Role] = &[];
    const BUFFER: usize = 2;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Store
    }
    fn ports(plan: &Plan) -> (usize, usize) {
        (1, plan.stations().len() + 3)
    }
    fn elements_max(plan: &Plan) -> usize {
        Ledger::encoded_bytes(plan.taps().len(), plan.scans().len(), plan.stations().len())
    }
}

/// Most discriminators that one record of a replay carries.
pub const REPLAY_RECORDS_MAX: usize = 256;

/// Discriminators that the archive has already, for a `fuse` that missed them: `store` to `fuse`.
#[derive(Debug)]
pub struct ReplayTopic;

impl Topic for ReplayTopic {
    type Header = Stamp;
    type Element = Discriminators;
    const NAME: &'static str = "tapline/replay";
    const SUBSCRIBERS: &'static [Role] = &[Role::Fuse];
    const BUFFER: usize = 4;
    const BORROWED: usize = 2;

    fn sender(_: &Stamp) -> Role {
        Role::Store
    }
    fn ports(_: &Plan) -> (usize, usize) {
        (1, 1)
    }
    fn elements_max(_: &Plan) -> usize {
        REPLAY_RECORDS_MAX
    }
}

/// Limits of a topic's service: publishers, subscribers and nodes, the dead among them included.
pub(crate) fn port_limits<T: Topic>(plan: &Plan) -> (usize, usize, usize) {
    let (publishers, subscribers) = T::ports(plan);
    let limits = (publishers + SPARE_PORTS, subscribers + SPARE_PORTS);
    (limits.0, limits.1, limits.0 + limits.1 + SPARE_PORTS)
}

/// Shared memory that one publisher of `T` may come to need, in bytes.
pub fn publisher_bytes<T: Topic>(plan: &Plan) -> usize {
    let (_, subscribers, _) = port_limits::<T>(plan);
    let slots = subscribers * (T::BUFFER + T::BORROWED) + LOANED;
    // A record's management header and the padding to its alignment are below a kilobyte.
    slots * (T::elements_max(plan) * size_of::<T::Element>() + size_of::<T::Header>() + 512)
}

/// Records a publisher may have on loan: the one being written, and one in hand.
pub(crate) const LOANED: usize = 2;

/// Shared memory that a whole line may come to need for `plan`, in bytes.
pub fn line_bytes(plan: &Plan) -> usize {
    fn of<T: Topic>(plan: &Plan) -> usize {
        publisher_bytes::<T>(plan) * T::ports(plan).0
    }
    of::<TapTopic>(plan)
        + of::<DiscriminatorTopic>(plan)
        + of::<DamageTopic>(plan)
        + of::<LedgerTopic>(plan)
        + of::<ReplayTopic>(plan)
}
