//! Sources of taps: asked for a row of its plan, a source renders that tap in place.
//!
//! A [`TapSet`] reads recordings from a folder; a [`SimulatedLine`] computes taps from physics.
//!
//! - `source`: what a source of taps is
//! - `tap_set`: folders of recordings, `simulated`: computed tyres
//! - `capture`: live sound cards and modules, `rig`: casings on a rig, and a simulated rig for rehearsals
//! - `config`, `stations`: what a configuration says of scans and stations
//! - `stage`: the process `acquire` of a line
//!
//! ```
//! use tapline_acquire::{ScanConfig, SimulatedLine, Source};
//! use tapline_wire::{CacheLine, Samples, TapHeader, cache_lines_for};
//!
//! let scan = ScanConfig { repetitions: 2, ..ScanConfig::default() };
//! let mut line = SimulatedLine::new(&scan, &tapline_model::SimulationConfig::default())?;
//! assert_eq!(line.plan().taps().len(), 2 * 2 * 101); // shoulders, repetitions, locations and the first again
//!
//! let mut header = TapHeader::default();
//! let mut buffer = vec![CacheLine::default(); cache_lines_for(line.plan().recording.payload_bytes_max())];
//! line.render(7, 0, &mut header, &mut buffer)?;
//! assert_eq!(header.id.location, 7);
//! assert!(matches!(Samples::view(&header, &buffer), Some(Samples::I16(s)) if s.len() == 2 * 2048));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod capture;
mod config;
mod error;
mod rig;
mod simulated;
mod source;
mod stage;
mod stations;
mod tap_set;

#[cfg(feature = "alsa")]
pub use capture::{Abilities, SoundCardInfo, sound_cards};
pub use capture::{
    CaptureConfig, Crossing, DeviceName, Monitor, MonitoredTap, NotTaps, Trigger, TriggerConfig, UldaqConfig,
};
pub use config::calibration::{CALIBRATION_FILE, CalibrationFile, ChannelScale};
pub use config::text::{read_text, read_toml, toml_in_words};
pub use config::{AcquireConfig, ScanConfig, TyreConfig};
pub use error::{Error, none_can};
pub use rig::{RigArrivals, RigConfig, RigReport, RigScript, last_on_rig, serve_rig};
pub use simulated::SimulatedLine;
pub use simulated::listed::{SimulatedList, listed_simulated};
pub use source::arrivals::{Arrival, Arrivals, Casing, CasingEnd, CasingList, ListedCasing, Wake};
pub use source::{About, Readiness, Refusal, Source};
pub use stage::outcome::{Outcome, RunError};
pub use stage::run;
pub use stations::{StationConfig, StationSource, open_station, validate_stations};
pub use tap_set::TapSet;
pub use tap_set::extras::Extras as TapExtras;
pub use tap_set::listed::{TapSetList, listed_tap_set};
pub use tap_set::scan_toml::SAMPLE_RATE_HZ_MAX;
pub use tap_set::table::{Row as TableRow, columns_of, read_rows};
pub use tap_set::taps_csv::{TEXT_COLUMNS, TapRow, tap_columns, tap_rows};
pub use tap_set::watched_folder::FolderArrivals;
pub use tap_set::wav::{WavKind, WavLayout, read_wav_layout};
