//! Many taps' discriminators become a damage map and a verdict per shoulder.
//!
//! [`Fusion`] is the state machine: it takes every tap and the end of every scan, in any order, and judges a shoulder once its
//! casing and its reference are complete. What it computes, step by step, and the folder of each:
//!
//! 1. `shoulder`: taps are grouped into turns: once around at one offset, velocity and repetition;
//! 2. `index`: the discriminators of a tap are compared with the level of its turn and the scatter of the reference, and become
//!    one score per place and offset;
//! 3. `arcs`: the scores of neighbours and of offsets become the evidence of arcs, and the arcs of the reference's casings, each
//!    judged by the others, set the limits for the stated rates of false calls;
//! 4. `verdict`: arcs above a limit, or a level that is off as a whole, give reasons, and these a verdict.
//!
//! `reference` holds what shoulders are compared with: the casing itself, a shoulder of it that is known to be sound, or a
//! [`ReferenceSet`] of earlier casings. `fusion` is the state machine, and `run` its loop on a line.
//!
//! ```
//! use tapline_fuse::{FuseConfig, Fusion, Reference};
//! use tapline_wire::{
//!     Discriminator, Discriminators, Geometry, Plan, PlannedTap, Purpose, Reasons, Recording, SampleFormat, Serial, TapId, Truth,
//!     Values, Verdict,
//! };
//!
//! let recording = Recording {
//!     sample_rate_hz: 40_960.0,
//!     pre_trigger_samples: 512,
//!     sample_count_max: 16_384,
//!     sample_format: SampleFormat::I16,
//!     channels: vec![],
//!     calibration: tapline_wire::Calibration::stated(),
//! };
//! let tyre = Serial::new("T1")?;
//! let planned = |location| {
//!     let id = TapId::new(1, tyre, 1, location);
//!     PlannedTap { id, angle_deg: Some(3.6 * f64::from(location)), purpose: Purpose::Scan }
//! };
//! let plan = Plan::new(Geometry::Ring, recording, (0..100).map(planned).collect(), Truth::new())?;
//!
//! let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan)?;
//! for (plan_index, tap) in (0..).zip(plan.taps()) {
//!     let is_cracked = (40..44).contains(&tap.id.location);
//!     let mut values = Values::default();
//!     let scatter = f64::from(tap.id.location * 37 % 101) * 1e-4; // stands for the casing's own
//!     values.set(Discriminator::Pr, Some(if is_cracked { 0.4 } else { 0.3 } + scatter));
//!     fusion.push(&Discriminators { id: tap.id, plan_index, values, ..Discriminators::default() })?;
//! }
//! assert!(!fusion.can_be_judged(0)); // no end, no verdict
//! fusion.end(0)?;
//! assert!(fusion.can_be_judged(0));
//! let (judgement, cells) = fusion.judge(0)?;
//! assert_eq!(judgement.verdict, Verdict::Reject.code());
//! assert!(judgement.reasons.contains(Reasons::DAMAGE));
//! assert!((40..44).all(|location| cells[location].region == 1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arcs;
mod config;
mod error;
mod evidence;
mod fusion;
mod index;
mod reference;
mod run;
mod score;
mod shoulder;
mod stats;
mod verdict;

#[cfg(test)]
mod testing;

pub use config::{Directions, FuseConfig, IndexKind, Reference};
pub use error::Error;
pub use fusion::{Fusion, OffsetMap};
pub use reference::build::{Built, build_reference};
pub use reference::file::{Origin, ReferenceSet};
pub use reference::known_shoulder::{KnownShoulder, KnownTurn};
pub use reference::summary::{ScaleLine, Summary};
pub use reference::supported::unsupported;
pub use run::{Outcome, RunError, run};
pub use score::{Score, ScorePool};
pub use shoulder::velocity::PowerLaw;
pub use stats::auc;
pub use tapline_wire::Direction;
