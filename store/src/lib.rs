//! One HDF5 archive per casing: written once, read back bit for bit.
//!
//! Row `k` of every table belongs to row `k` of the scan plan, so the contents of an archive do not depend on the order in
//! which taps arrived, and no tap can be stored twice. All tables have their final size from the start, and the index of the
//! samples' chunks has all of its entries: after creation only contents and entries change in place, so a writer that is
//! killed leaves a file that opens. Samples are packed outside the HDF5 library's lock, every row has a checksum, and
//! samples are read without the library.
//!
//! Folders, each of which uses only those above it in this list:
//!
//! - `format`: what the bytes of an archive mean, without opening one
//! - `file`: the archive as a file on disk: its name, its disk, and whether it is still there
//! - `h5`: calls of the HDF5 library, and its structures read without it
//! - `archive`: one archive, created, or opened and checked
//! - `read`, `write`: reading and writing taps and results; [`verify`]
//! - `folder`: the archives that a given folder means
//! - `stage`: the archives of a running line; [`repack()`]
//!
//! ```
//! use tapline_store::{Reader, Writer};
//! use tapline_wire::{
//!     Calibration, Channel, Geometry, Plan, PlannedTap, Purpose, Recording, SampleFormat, Serial, TapId, TapState,
//! };
//!
//! let mut id = TapId::default();
//! (id.tyre, id.station, id.shoulder) = (Serial::new("A1")?, 1, 1);
//! let recording = Recording {
//!     sample_rate_hz: 40960.0,
//!     pre_trigger_samples: 64,
//!     sample_count_max: 256,
//!     sample_format: SampleFormat::I16,
//!     channels: Channel::BOTH.to_vec(),
//!     calibration: Calibration::stated(),
//! };
//! let taps = vec![PlannedTap { id, angle_deg: Some(0.0), purpose: Purpose::Scan }];
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
mod config;
mod error;
mod file;
mod folder;
mod format;
mod h5;
mod read;
mod repack;
mod stage;
#[cfg(test)]
mod testing;
mod write;

pub use archive::has_only_results;
pub use config::StoreConfig;
pub use error::{Error, Result};
pub use file::{LEFT_FOLDER, OPEN_FOLDER, UNREPORTED_FOLDER};
pub use folder::{Finished, Folder, Results, Sorted, archive_of, has_results, last_finished, results_path};
pub use format::layout::{FORMAT_VERSION, REASON_BYTES};
pub use format::lineage::{Lineage, digest_of, hex_of, lineage_change, lineage_changes, lineage_key};
pub use format::lost::Lost;
pub use read::reader::{Judged, OwnedSamples, Reader, Refusal};
pub use read::regions::{Region, peak, regions};
pub use read::samples::{ReadBuffer, Taps};
pub use read::verify::{Problem, Report, verify, verify_with};
pub use repack::{Repacked, repack};
pub use stage::{Outcome, Places, RunError, StoreRun, Unreported, casing_id, run};
pub use tapline_codec::Codec;
pub use write::Writer;
pub use write::finish::Finishing;
pub use write::put_taps::put_taps_of;
pub use write::tap_state::{PutCounts, PutOutcome};
