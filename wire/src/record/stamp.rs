//! What every record on every topic begins with.

use iceoryx2::prelude::ZeroCopySend;

/// What a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RecordKind {
    /// Opens a connection; carries nothing. A subscriber answers it with READY.
    Greeting,
    /// The data of the topic: a tap, its discriminators, a damage map.
    Data,
    /// A planned tap, or a whole casing, that will not come, with the reason as text.
    Refusal,
    /// Everything its source sent before it has been handled or lost.
    Barrier,
    /// The end of a scan, in band.
    End,
    /// A casing's plan: proposed by its station, or open for everyone.
    Plan,
    /// A snapshot of a casing's ledger.
    Ledger,
    /// A casing's file is closed and in its place, which follows as text.
    Closed,
}

impl RecordKind {
    const ALL: [Self; 8] =
        [Self::Greeting, Self::Data, Self::Refusal, Self::Barrier, Self::End, Self::Plan, Self::Ledger, Self::Closed];

    /// Number that stands for the kind in a [`Stamp`].
    pub fn code(self) -> u32 {
        self as u32 + 1
    }

    /// The kind that `code` stands for.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.code() == code)
    }
}

/// Identity of a record: who sent it, when that sender started, and its place in what was sent.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
pub struct Stamp {
    /// Rises by one from record to record of one sender's life; a gap is loss.
    pub sequence: u64,
    /// When the sender started, ns since the Unix epoch: tells its lives apart.
    pub epoch_ns: i64,
    /// Number of the casing that the record is about ([`crate::casing_number`]); 0 for one that is about none.
    pub casing: u64,
    /// [`RecordKind::code`].
    pub kind: u32,
    /// Number of the sender among its kind: of an `acquire`, the process's; 0 for a stage of which there is one.
    pub source: u32,
    /// For a barrier or an end: what it marks (a counter, or the number of the scan that ends). For a plan: its station.
    pub mark: u64,
}

impl Stamp {
    /// The record's kind, `None` for a code nobody knows.
    pub fn kind(&self) -> Option<RecordKind> {
        RecordKind::from_code(self.kind)
    }
}

/// Headers that carry a [`Stamp`].
pub trait Stamped {
    /// The record's stamp.
    fn stamp(&self) -> &Stamp;
    /// The record's stamp, writable: the publisher fills it in.
    fn stamp_mut(&mut self) -> &mut Stamp;
}

impl Stamped for Stamp {
    fn stamp(&self) -> &Stamp {
        self
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        self
    }
}
