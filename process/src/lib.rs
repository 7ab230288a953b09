//! The discriminators of one tap, from its force and sound.
//!
//! Definitions are those of section 2 of the method; each file states which it implements and where it goes beyond
//! them. A value that cannot be computed is absent, and a [`Quality`] flag says why.
//!
//! - `signal`: levels, extents and sums, which everything else needs first
//! - `force`: peak, duration and onset of the pulse; `sound`: the two areas; `spectrum`: the powers
//! - `quality`: what is wrong with a tap; `calibration`: scales of samples
//! - `extractor`: one tap in, its discriminators out; `estimator`: the choices of `[process]`
//! - `stage`: the process `process` of a line
//!
//! | flag | what it drops |
//! |---|---|
//! | `REFUSED` | everything: the header does not describe the samples, or has no sample rate |
//! | `NON_FINITE` | what needs the channel whose scale, or one of whose samples, is not a number |
//! | `NO_FORCE` | F_max, tau, A_1; A_2 starts at the onset that the sound itself shows |
//! | `NO_SOUND` | A_1, A_2, PR, P_f, E_f, centroid |
//! | `NO_BASELINE` | F_max, tau, A_1, A_2; if noise is subtracted and the baseline does not show it, PR, P_f, E_f, centroid |
//! | `NO_PULSE` | F_max, tau, A_1, A_2 |
//! | `NO_ONSET` | A_1 and A_2; if the sound does not vary, or by less than 6 sigma, PR, P_f, E_f and the centroid too |
//! | `NO_BAND` | PR, P_f, E_f, centroid; if noise is subtracted, also if a band has no more than noise |
//!
//! Other flags say that a value is doubtful. What they drop is set by the policies of [`QualityConfig`]; `docs/flags.md` has the rule
//! and the default of each.
//!
//! # Example
//!
//! ```
//! use tapline_process::{Extractor, ProcessConfig};
//! use tapline_wire::{Channel, Discriminator, Samples, TapHeader};
//!
//! // A half-sine of 100 N and 1 ms at 40 kHz, and a sound that rings at 1 kHz after it.
//! let force = (0..4000).map(|i| (100..140).contains(&i).then(|| (f64::from(i - 100) / 40.0)).unwrap_or(0.0))
//!     .map(|phase| (100.0 * (std::f64::consts::PI * phase).sin()) as f32);
//! let sound = (0..4000).map(|i| f64::from(i - 100) / 40e3)
//!     .map(|t| if t < 0.0 { 0.0 } else { ((-200.0 * t).exp() * (6283.2 * t).sin()) as f32 });
//! let samples: Vec<f32> = force.chain(sound).collect();
//!
//! let header = TapHeader::in_units(40e3, 100, 4000, &[Channel::Force, Channel::Sound]);
//! let mut extractor = Extractor::<f64>::new(&ProcessConfig::default())?;
//! let found = extractor.extract(&header, Samples::F32(&samples));
//! assert!(found.quality.is_empty());
//! let tau_s = found.values.get(Discriminator::Tau).unwrap_or_default();
//! assert!((tau_s - 1e-3).abs() < 2e-6);
//! let pr = found.values.get(Discriminator::Pr).unwrap_or_default();
//! assert!(pr > 0.9); // 1 kHz lies between 550 and 2000 Hz
//! # Ok::<(), tapline_process::Error>(())
//! ```
//!
//! [`Quality`]: tapline_wire::Quality

pub mod calibration;
mod error;
mod estimator;
mod extractor;
mod force;
mod quality;
mod signal;
mod sound;
mod spectrum;
mod stage;

pub use error::Error;
pub use estimator::{BandEdges, DurationEstimator, PeakEstimator, Subtraction};
pub use extractor::config::{Precision, ProcessConfig};
pub use extractor::{Extractor, ProcessExtractor};
pub use quality::{Policy, QualityConfig};
pub use signal::real::Real;
pub use signal::wide::without_avx512;
pub use stage::{Outcome, RunError, run};
