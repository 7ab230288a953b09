//! The simulated tyre and its rig: cracks, sound, scatter and converter, rendered into samples.

pub(crate) mod casing;
pub(crate) mod converter;
pub(crate) mod crack;
pub(crate) mod fault;
#[cfg(test)]
pub(crate) mod features_for_tests;
pub(crate) mod identity;
pub(crate) mod pulse;
pub(crate) mod simulated;
pub(crate) mod simulation_config;
pub(crate) mod sound;
