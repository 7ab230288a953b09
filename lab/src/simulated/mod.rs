//! Casings of two simulators that share no code, tapped, read and judged: what `examples/rates` counts and `tapline-lab chart`
//! draws.
//!
//! - [`Scene`]: which casings, of what population, with which cracks; [`Simulator`]: `model` or `plate`.
//! - [`Reading`]: how a record is heard and read; one simulation can be read in many ways.
//! - [`Dataset`]: a plan and what was found in its taps.
//! - [`Set`]: casings and their taps' values; [`ScanTaps`]: which of these taps a scan makes, and [`Times`] its duration.
//! - [`judge`]: the shoulders of such scans, judged by the fusion, with the truth about them.

mod dataset;
mod judged;
mod plate_line;
mod reading;
mod scan_taps;
mod scene;
mod set;

pub use crate::shoulder_result::ShoulderResult;
pub use dataset::Dataset;
pub(crate) use dataset::scan_model;
pub(crate) use judged::alone_of;
pub use judged::{Judged, Judging, judge};
pub use reading::Reading;
pub(crate) use reading::quantise;
pub use scan_taps::{ScanTaps, Times, Turn};
pub use scene::{Crack, Scene, Simulator, Tyre};
pub use set::{Set, simulate};
