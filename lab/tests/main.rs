//! The built `tapline-lab` in a folder of its own, and the catalogue of stability.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod chart;
mod experiment;
mod figures;
mod headroom;
mod overwriting;
mod pod;
mod rates;
mod sandbox;
mod stability;
mod statistics;
mod study;
