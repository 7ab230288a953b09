//! The records that cross between stages, and the shared-memory topics that carry them.
//!
//! # Laws of the stream
//!
//! 1. Every record carries its [`TapId`] and a sequence number; times are `i64` ns since the Unix
//!    epoch, and only `acquire` reads a clock for a time that enters a result.
//! 2. Nothing is dropped to keep up. A slow stage makes the sources wait. A gap in a sequence is
//!    loss: counted, logged at ERROR, and the taps that are missing are asked for again.
//! 3. Samples are planar `[channel][sample]`, as the converter gave them, with the unit scale of
//!    each channel in the header. No stage copies them but the writer to disk.
//! 4. Results do not depend on how the stream was cut, nor on the order of stations, nor on how
//!    many worker threads there are.
//! 5. A scan ends in band. No end, or a tap missing without a reason, and there is no PASS.
//! 6. Same input, configuration and seed give the same results, byte for byte.

mod clock;
mod damage;
mod discriminators;
mod id;
mod ledger;
mod line;
mod plan;
mod publisher;
pub mod room;
mod stamp;
mod subscriber;
mod tap;
mod topic;

pub use clock::now_ns;
pub use damage::{DamageCell, Judgement, Reasons, Verdict};
pub use discriminators::{Discriminator, Discriminators, Quality, Values};
pub use id::{Geometry, IdError, SERIAL_BYTES, Serial, TapId};
pub use ledger::{Ledger, LedgerHeader, ScanState, TapState};
pub use line::{Line, LineAddress, LineError, Rope, Signal};
pub use plan::{Plan, PlanError, PlannedTap, Recording, Scan, Truth};
pub use publisher::{Loan, Publisher};
pub use stamp::{RecordKind, Stamp, Stamped};
pub use subscriber::{Received, Subscriber, Tally};
pub use tap::{
    CHANNELS_MAX, Channel, ChannelHeader, LANE_BYTES, Lane, SampleFormat, Samples, SourceKind, TapHeader, bytes_of,
    bytes_of_mut, f32_of_mut, i16_of_mut, lanes_for,
};
pub use topic::{
    DamageTopic, DiscriminatorTopic, LedgerTopic, REASON_BYTES_MAX, REPLAY_RECORDS_MAX, ReplayTopic, Role, TapTopic,
    Topic, line_bytes, publisher_bytes,
};

impl Stamped for TapHeader {
    fn stamp(&self) -> &Stamp {
        &self.stamp
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        &mut self.stamp
    }
}

impl Stamped for Judgement {
    fn stamp(&self) -> &Stamp {
        &self.stamp
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        &mut self.stamp
    }
}

impl Stamped for LedgerHeader {
    fn stamp(&self) -> &Stamp {
        &self.stamp
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        &mut self.stamp
    }
}
