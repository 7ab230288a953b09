//! Many taps' discriminators become a damage map and a verdict per shoulder.
//!
//! [`Fusion`] is the state machine: it is told of every tap and of the end of every scan, in any
//! order, and judges a shoulder once its reference is whole. What it computes, step by step:
//!
//! 1. taps are grouped into conditions (offset, velocity class); closing taps enter nothing; if asked for, F_max and tau
//!    are brought from the measured to the planned velocity (`velocity`);
//! 2. each value is standardised by the reference in its condition (`reference`);
//! 3. a location's index is the mean over its taps and discriminators (`index`), and for the robust
//!    index then the mean over the location and its two neighbours (`ring`);
//! 4. the reference's own index map sets the limits (`limits`), and what exceeds them makes
//!    regions and a verdict (`verdict`).
//!
//! Beside it stand kernels that the defaults do not use: a signed scale between percentiles
//! ([`PercentileScale`]), the scan over arcs ([`scan()`]), conditions in one ([`combined`]), and the
//! honest bars of a score ([`auc_interval`], [`auc_left_out`]).
//!
//! ```
//! use tapline_fuse::{FuseConfig, Fusion};
//! use tapline_wire::{
//!     Discriminator, Discriminators, Geometry, Plan, PlannedTap, Reasons, Recording, SampleFormat, Serial, TapId, Truth,
//!     Values, Verdict,
//! };
//!
//! let recording = Recording {
//!     sample_rate_hz: 40_960.0,
//!     pre_trigger_samples: 512,
//!     sample_count_max: 16_384,
//!     sample_format: SampleFormat::I16,
//!     channels: vec![],
//! };
//! let tyre = Serial::new("T1")?;
//! let planned = |location| {
//!     let mut id = TapId::default();
//!     (id.tyre, id.shoulder, id.location) = (tyre, 1, location);
//!     PlannedTap { id, angle_deg: Some(3.6 * f64::from(location)), is_closing: false }
//! };
//! let plan = Plan::new(Geometry::Ring, recording, (0..100).map(planned).collect(), Truth::new())?;
//!
//! let mut fusion = Fusion::new(&FuseConfig::default(), &plan)?;
//! for (plan_index, tap) in (0..).zip(plan.taps()) {
//!     let is_cracked = (40..44).contains(&tap.id.location);
//!     let mut values = Values::default();
//!     let scatter = f64::from(tap.id.location * 37 % 101) * 1e-4; // stands for the casing's own
//!     values.set(Discriminator::Pr, Some(if is_cracked { 0.4 } else { 0.3 } + scatter));
//!     fusion.push(&Discriminators { id: tap.id, plan_index, values, ..Discriminators::default() })?;
//! }
//! assert!(fusion.ready().is_empty()); // no end, no verdict
//! fusion.end(0)?;
//! assert_eq!(fusion.ready(), [0]);
//! let (judgement, cells) = fusion.judge(0)?;
//! assert_eq!(judgement.verdict, Verdict::Reject.code());
//! assert!(judgement.reasons.contains(Reasons::DAMAGE));
//! assert!((40..44).all(|location| cells[location].region == 1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bootstrap;
mod combine;
mod condition;
mod config;
mod covariance;
mod error;
mod fusion;
mod index;
mod indices;
mod limits;
mod map;
mod reference;
mod resample;
mod ring;
mod run;
mod scale;
mod scan;
mod score;
mod split;
mod stats;
mod velocity;
mod verdict;

#[cfg(test)]
mod testing;

pub use bootstrap::{Bootstrap, auc_interval};
pub use combine::{Combination, combined};
pub use config::{Direction, Directions, FuseConfig, IndexKind, Reference};
pub use error::Error;
pub use fusion::Fusion;
pub use indices::{Example, Index, Lda, LearnError, LogOdds, Mahalanobis, Mean, PLACES_MIN, Signs, Weighted};
pub use run::{Outcome, RunError, run};
pub use scale::{PercentileScale, Scaled};
pub use scan::{ARC_LENGTHS, Arc, Permutation, scan, scan_p_value};
pub use score::{Score, auc};
pub use split::{Split, auc_left_out, leave_one_out};
pub use velocity::PowerLaw;
