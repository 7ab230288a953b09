//! What every record on every topic begins with.

use iceoryx2::prelude::ZeroCopySend;

/// What a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RecordKind {
    /// Opens a connection; has no elements. A subscriber answers it with READY.
    Handshake,
    /// The data of the topic: a tap, its discriminators, a damage map.
    Data,
    /// A planned tap or a whole casing will not come; the reason follows as text.
    Refusal,
    /// Once it has passed, everything that its source sent before it is handled or lost.
    Barrier,
    /// The end of a scan, in band.
    End,
    /// A casing's plan: proposed by its station, or open for everyone.
    Plan,
    /// A snapshot of a casing's ledger.
    Ledger,
    /// A casing's file is closed; its path follows as text.
    Closed,
    /// What people should know of a station or of a casing, or why the archive cannot be written; it follows as text.
    Alarm,
    /// What keeps a station from taking in casings; it follows as text, which is empty when nothing does any more.
    Fault,
    /// What was on a station's rig was taken off.
    Removed,
    /// Why a station's rig does nothing; it follows as text, which is empty when it goes on.
    Stopped,
}

/// What the text of an alarm begins with that has ended; the text of that alarm follows.
pub const OVER: &str = "over: ";

coded!(
    RecordKind: u32,
    Handshake = 1,
    Data = 2,
    Refusal = 3,
    Barrier = 4,
    End = 5,
    Plan = 6,
    Ledger = 7,
    Closed = 8,
    Alarm = 9,
    Fault = 10,
    Removed = 11,
    Stopped = 12,
);

/// Identity of a record: its sender, when the sender started, and its position in what the sender has sent.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
pub struct Stamp {
    /// Counts the records of one run of the sender; a gap is a loss.
    pub sequence: u64,
    /// When the sender started, ns since the Unix epoch; distinguishes its runs.
    pub epoch_ns: i64,
    /// Number of the casing that the record is about ([`crate::casing_number`]); 0 for a record that is about none.
    pub casing: u64,
    /// [`RecordKind::code`].
    pub kind: u32,
    /// Number of the sending `acquire` process; 0 for the other stages.
    pub source: u32,
    /// For a barrier a counter, for an end the number of the scan, for a plan its station.
    pub mark: u64,
}

impl Stamp {
    /// The record's kind; `None` for an unknown code.
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
