//! `tapline-lab`: tools for researchers, apart from the everyday program.
//!
//! - [`study`]: how good each index and reference is on hundreds of simulated tyres.
//! - [`pod`]: the same for casings that a plant has scanned and inspected.
//! - [`chart`]: the atlas: speed against accuracy of every choice.
//! - [`experiment`]: chapter 5 of the dissertation repeated on three simulated tyres.
//! - [`figures`]: the figures of the dissertation's contact theory.
//! - [`estimators`]: bias and spread of every estimator on taps whose truth is known.
//! - [`stability`]: breakdown curves: how wrong a number gets as a disturbance grows.
//! - [`headroom`]: how many stations a host supports, and what limits them.
//! - [`line_cost`]: what a run of the built program cost.
//! - [`in_memory`]: taps rendered and read within this process.
//! - [`hop`]: records sent between processes, through shared memory and in other ways.
//! - [`simulated`]: casings of two simulators, tapped and judged.
//! - [`written`]: the files that a verb writes.
//! - [`statistics`]: probability of detection, rates, gauge studies.

pub mod chart;
pub mod estimators;
mod evaluation;
pub mod experiment;
pub mod figures;
pub mod headroom;
pub mod hop;
pub mod in_memory;
pub mod line_cost;
pub mod pod;
mod shoulder_result;
pub mod simulated;
pub mod stability;
pub mod statistics;
pub mod study;
pub mod written;
