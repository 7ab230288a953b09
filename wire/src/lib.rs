//! The records that cross between stages, and the shared-memory topics that carry them.
//!
//! - `record`: the records themselves; `plan`: which taps must exist, and the state of each. Neither uses shared
//!   memory.
//! - `stream`: a [`Line`] in shared memory, its topics, and their publishers and subscribers
//!
//! # Laws of the stream
//!
//! 1. Every record carries the [`TapId`] it is about and a sequence number; times are `i64` ns since the Unix epoch,
//!    and only `acquire` reads a clock for a time that enters a result.
//!    (`stream/topic.rs`: no topic has a header without a stamp; `tests/laws.rs`: `law_1_only_acquire_reads_a_clock_for_a_result`;
//!    `clippy.toml` forbids clocks elsewhere)
//! 2. No record is dropped to keep up: a slow stage makes the sources wait. A gap in a sequence is a loss. It is counted and
//!    logged at ERROR, and the missing taps are requested again.
//!    (`tests/stream.rs`: all; `stream/subscriber.rs`: `a_gap_is_counted_once`; the program's `tests/faults/killed.rs`: all)
//! 3. Samples are planar `[channel][sample]`, as the converter gave them, with the unit scale of each channel in the
//!    header. Only the writer to disk copies them; the archive returns them bit for bit.
//!    (`record/tap.rs`: `samples_are_viewed_in_place`; the program's `tests/run/tap_sets.rs`: `a_clean_set_is_archived_bit_for_bit`)
//! 4. Results do not depend on interruptions of the stream, on the order of stations, or on earlier casings.
//!    (the program's `tests/run/results.rs`: `a_casing_does_not_depend_on_the_others`)
//! 5. A scan ends in band. Without its end, or if a tap is missing without a reason, there is no PASS.
//!    (`fuse`: `only_a_whole_sound_scan_passes`; the program's `tests/faults/killed.rs`: `an_interrupted_run_is_resumed`)
//! 6. Same input, configuration and seed give the same results, byte for byte.
//!    (the program's `tests/faults/killed.rs`: all; `tests/archives/reprocess.rs`: `the_same_lineage_gives_the_same_bits`)
//! 7. The memory of a stage and the cost of a tap do not grow with the number of earlier casings.
//!    (the program's `tests/line/endurance.rs`: `two_hundred_casings_leave_no_trace`)
//!
//! # How a record travels
//!
//! A process joins a [`Line`] in a [`Role`], opens a [`Publisher`] or a [`Subscriber`] on a [`Topic`], and waits to be
//! notified. A publisher sends every subscriber a handshake record, and nothing else until each has answered READY: a
//! subscriber that has not mapped its connection yet would lose records silently.
//!
//! A record names its casing by a number derived from the file's name ([`casing_number`]). `store` sends each process what
//! it needs to know about the open casings ([`CasingTopic`]), and sends it again when that process or `store` restarts.
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//! use tapline_wire::*;
//!
//! let address = LineAddress::fresh()?;
//! let limits = Limits::default(); // all processes of a line are given the same
//! {
//!     let fuse = Line::join(&address, Role::Fuse, &limits, Arc::default())?;
//!     let store = Line::join(&address, Role::Store, &limits, Arc::default())?;
//!     let verdicts = Publisher::<DamageTopic>::open(&fuse)?;
//!     let inbox = Subscriber::<DamageTopic>::open(&store)?;
//!
//!     let judgement = Judgement { verdict: Verdict::Pass.code(), ..Judgement::default() };
//!     // In one thread neither side may wait for the other; in two, `verdicts.send(..)` would.
//!     while !verdicts.try_send(RecordKind::Data, judgement, &[DamageCell::default()])? {
//!         assert!(inbox.receive()?.is_none()); // answers the handshake
//!     }
//!     let record = inbox.receive()?.expect("it was sent");
//!     assert_eq!((record.header().verdict, record.len()), (Verdict::Pass.code(), 1));
//! }
//! address.clear()?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[macro_use]
mod coded;

mod clock;
mod csv_text;
mod plan;
mod record;
mod stream;

pub use clock::{monotonic_ns, now_ns};
pub use csv_text::{csv_cell, csv_text};
pub use plan::casing::{
    CasingHeader, NAME_BYTES_MAX, REASON_BYTES_MAX, casing_number, decode_opened, decode_proposal, encode_opened,
    encode_proposal,
};
pub use plan::codec::{decode_taps, encode_taps};
pub use plan::digest::digest_of_parts;
pub use plan::ledger::{Ledger, RETAKES_MAX, ScanState, TapState, end_mark, split_end_mark};
pub use plan::limits::{CasingLimits, Limits};
pub use plan::parts::{PlannedTap, Purpose, Recording, Scan, Truth};
pub use plan::{Plan, PlanError, scans_of};
pub use record::calibration::{Calibration, Certificate, ChannelCalibration, METHOD_BYTES_MAX, Unit};
pub use record::damage::{DamageCell, Judgement, Verdict};
pub use record::discriminators::{Direction, Discriminator, Discriminators, RecordPart, Values};
pub use record::flags::{Quality, Reasons};
pub use record::id::{Geometry, IdError, SERIAL_BYTES, Serial, TapId, is_unseen};
pub use record::stamp::{OVER, RecordKind, Stamp, Stamped};
pub use record::tap::{
    CACHE_LINE_BYTES, CHANNELS_MAX, CacheLine, Channel, ChannelHeader, SampleFormat, Samples, SourceKind, TapHeader,
    bytes_of, bytes_of_mut, cache_lines_for, f32_of_mut, i16_of_mut,
};
pub use stream::address::LineAddress;
pub use stream::error::LineError;
pub use stream::line::Line;
pub use stream::mailbox::Waker;
pub use stream::publisher::{Loan, Publisher};
pub use stream::service::Services;
pub use stream::shm;
pub use stream::subscriber::{Received, Subscriber};
pub use stream::topic::{
    AskTopic, CasingTopic, DamageTopic, Delivery, DiscriminatorTopic, ProposalTopic, Role, SETTLED_RECORDS_MAX,
    SettledTopic, TapTopic, Topic, WaitTopic, line_bytes,
};
