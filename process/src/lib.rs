//! The discriminators of one tap, from its force and sound.
//!
//! Definitions are those of the method's section 2; each file states the ones it implements and where it goes beyond
//! them. A value that cannot be computed is absent, and a [`Quality`] flag says why.
//!
//! | flag | what it drops |
//! |---|---|
//! | `REFUSED` | everything: the header does not describe the samples, or has no sample rate |
//! | `NON_FINITE` | what needs the channel whose scale, or one of whose samples, is not a number |
//! | `NO_FORCE` | F_max, tau, A_1; A_2 starts at the onset that the sound itself shows |
//! | `NO_SOUND` | A_1, A_2, PR, P_f, E_f |
//! | `NO_BASELINE` | F_max, tau, A_1, A_2; the spectrum needs no baseline |
//! | `NO_PULSE` | F_max, tau, A_1, A_2 |
//! | `NO_ONSET` | A_1 and A_2; if the sound does not vary, or by less than 6 sigma, PR, P_f and E_f too |
//! | `NO_BAND` | PR, P_f, E_f; if noise is subtracted, also if a band has no more than noise |
//!
//! Other flags say that a value is doubtful. What they drop is set by the policies of [`QualityConfig`]; by default:
//!
//! | flag | rule | what it drops |
//! |---|---|---|
//! | `CLIPPED` | three samples in a row at the converter's limit, or at an extreme that the signal leaves steeply, also under noise | for the force F_max, tau, A_1, A_2; for the sound nothing |
//! | `LATE_TRIGGER` | fewer than 5 quiet samples before the pulse; or it lies in the baseline, or 15 % of it before the trigger | F_max, tau, A_1, A_2, and the powers if the pulse is cut; nothing if only the mark is late |
//! | `DOUBLE_HIT` | the force rises again by 5 % of F_max and 8 sigma, and no returning layer explains it | everything |
//! | `UNDERSAMPLED` | fewer than 8 samples above 10 % of F_max; a rate below 2 f_top | F_max, tau, A_1, A_2; PR, P_f, E_f |
//! | `HUM` | a line at 50 or 60 Hz above 2 % of the sound's peak, or in the force | nothing |
//! | `LOW_SNR` | a peak below 50 sigma of the noise before the trigger, or after the ringing | nothing |
//! | `NEIGHBOUR` | the sound's envelope rises again, or is loud before the tap, by 10 % of its peak and 6 sigma; or rings through the time before it | nothing if a retake did not help; under the policy `drop` A_2, PR, P_f, E_f, and A_1 if it came before |
//! | `VELOCITY_OFF` | measured and planned velocity differ by more than 3 % | nothing |
//! | `RATE_IMPLAUSIBLE` | tau outside 0.35 to 4 ms | nothing |
//!
//! # Example
//!
//! ```
//! use tapline_process::{Extractor, ProcessConfig};
//! use tapline_wire::{Channel, ChannelHeader, Discriminator, SampleFormat, Samples, TapHeader};
//!
//! // A half-sine of 100 N and 1 ms at 40 kHz, and a sound that rings at 1 kHz after it.
//! let force = (0..4000).map(|i| (100..140).contains(&i).then(|| (f64::from(i - 100) / 40.0)).unwrap_or(0.0))
//!     .map(|phase| (100.0 * (std::f64::consts::PI * phase).sin()) as f32);
//! let sound = (0..4000).map(|i| f64::from(i - 100) / 40e3)
//!     .map(|t| if t < 0.0 { 0.0 } else { ((-200.0 * t).exp() * (6283.2 * t).sin()) as f32 });
//! let samples: Vec<f32> = force.chain(sound).collect();
//!
//! let mut header = TapHeader {
//!     sample_rate_hz: 40e3,
//!     pre_trigger_samples: 100,
//!     sample_count: 4000,
//!     sample_format: SampleFormat::F32.code(),
//!     channel_count: 2,
//!     ..TapHeader::default()
//! };
//! header.channels[0] = ChannelHeader { code: Channel::Force.code(), unit_per_count: 1.0, ..Default::default() };
//! header.channels[1] = ChannelHeader { code: Channel::Sound.code(), unit_per_count: 1.0, ..Default::default() };
//!
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
pub use estimator::{BandEdges, DurationEstimator, PeakEstimator, SpectrumEstimator, Subtraction};
pub use extractor::config::{Precision, ProcessConfig};
pub use extractor::{Extractor, ProcessExtractor};
pub use quality::{Policy, QualityConfig};
pub use signal::real::Real;
pub use signal::wide::without_avx512;
pub use stage::{Outcome, RunError, run};
