//! Archives read back, and checked.

pub(crate) mod mapped;
pub(crate) mod reader;
pub(crate) mod regions;
pub(crate) mod samples;
pub(crate) mod verify;
