//! One HDF5 archive a casing: written once, read back bit for bit.
//!
//! Row `k` of every table belongs to row `k` of the scan plan, so what an archive holds does not depend on the order in
//! which taps arrived, and no tap can be there twice. All tables have their final size from the start, and
//! the index of the samples' chunks has all of its entries: once created, a file's structure changes no more than entries
//! where they stand, which is why a writer that is killed leaves a file that opens plainly. Samples are packed off the
//! library's lock, every row is sealed, and readers read past the library.
//!
//! ```
//! use tapline_store::{Reader, Writer};
//! use tapline_wire::{Channel, Geometry, Plan, PlannedTap, Recording, SampleFormat, Serial, TapId, TapState};
//!
//! let mut id = TapId::default();
//! (id.tyre, id.station, id.shoulder) = (Serial::new("A1")?, 1, 1);
//! let recording = Recording {
//!     sample_rate_hz: 40960.0,
//!     pre_trigger_samples: 64,
//!     sample_count_max: 256,
//!     sample_format: SampleFormat::I16,
//!     channels: vec![Channel::Force, Channel::Sound],
//! };
//! let taps = vec![PlannedTap { id, angle_deg: Some(0.0), is_closing: false }];
//! let plan = Plan::new(Geometry::Ring, recording, taps, Default::default())?;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("run.h5");
//! let mut writer = Writer::create(&path, &plan, plan.taps().len(), "[store]\n")?;
//! writer.put_refusal(0, &id, "the impactor did not return")?;
//! writer.finish()?;
//!
//! let reader = Reader::open(&path)?;
//! assert_eq!(reader.ledger().taps(), [TapState::Refused]);
//! assert_eq!(reader.plan(), &plan);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod archive;
mod behind;
mod blosc;
mod check;
mod chunk;
mod chunk_index;
mod codec;
mod config;
mod context;
mod create;
mod draft;
mod encode;
mod error;
mod finish;
mod given;
mod grow;
mod layout;
mod lineage;
mod lost;
mod lz4;
mod mapped;
mod outage;
mod pending;
mod place;
mod planes;
mod puts;
mod reader;
mod reason;
mod recall;
mod regions;
mod repack;
mod replay;
mod rows;
mod samples;
mod seal;
mod sealed;
mod settled;
mod stage;
mod structure;
mod table;
#[cfg(test)]
mod testing;
mod text;
mod track;
mod units;
mod verify;
mod writer;

pub use codec::Codec;
pub use config::StoreConfig;
pub use error::Error;
pub use finish::Finishing;
pub use layout::{FORMAT_VERSION, REASON_BYTES};
pub use lineage::{Lineage, digest_of, hex_of, lineage_key};
pub use lost::Lost;
pub use puts::put_taps_of;
pub use reader::{Judged, OwnedSamples, Reader, Refusal};
pub use regions::{Region, regions};
pub use repack::{Repacked, repack};

pub use samples::{Room, Taps};
pub use stage::{LEFT_FOLDER, OPEN_FOLDER, Outcome, Places, RunError, StoreRun, run};
pub use track::{PutCounts, PutOutcome};
pub use verify::{Problem, Report, verify};
pub use writer::Writer;

/// What a fallible call of this crate returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;
