//! Contacts: an impactor hits a block, with or without a crack under its surface.

pub(crate) mod choice;
pub(crate) mod compliance;
pub(crate) mod compliance_map;
pub(crate) mod damped;
pub(crate) mod damped_table;
pub(crate) mod damping;
pub(crate) mod defect;
pub(crate) mod domain;
pub(crate) mod impact;
pub(crate) mod integral;
pub(crate) mod ladder;
pub(crate) mod ode;
pub(crate) mod rung;
pub(crate) mod scene;
pub(crate) mod tables;
