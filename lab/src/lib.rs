//! What a researcher runs beside the everyday program: `tapline-lab`.
//!
//! - [`study`]: simulated tyres by the hundred, and how good each index and reference is.
//! - [`pod`]: the same of casings that a plant has scanned and inspected.
//! - [`chart`]: the atlas, speed against accuracy of all that can be chosen.
//! - [`experiment`]: chapter 5 of the dissertation done again on three simulated tyres.
//! - [`figures`]: the figures of the dissertation's contact theory.
//! - [`estimators`]: bias and spread of every estimator on taps whose truth is known.
//! - [`stability`]: breakdown curves, how wrong a number gets as a disturbance grows.
//! - [`headroom`]: how many stations a host carries, and what binds.
//! - [`line_cost`]: what a run of the built program cost.
//! - [`hop`]: a record from process to process, through shared memory and other ways.
//! - [`simulated`]: casings of two simulators, tapped and judged.
//! - [`written`]: the files that a verb writes.
//! - [`statistics`]: probability of detection, rates, gauge studies, resampling, held-out areas.

pub mod chart;
pub mod estimators;
mod evaluation;
pub mod experiment;
pub mod figures;
pub mod headroom;
pub mod hop;
mod in_memory;
pub mod line_cost;
pub mod pod;
pub mod simulated;
pub mod stability;
pub mod statistics;
pub mod study;
pub mod written;
