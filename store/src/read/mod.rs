//! Archives read back, and checked.
//!
//! - `reader`: tables and single taps
//! - `samples`: chunks of samples, read without the HDF5 library
//! - `regions`: regions of a damage map
//! - `verify`: whether an archive is complete and consistent

pub(crate) mod reader;
pub(crate) mod regions;
pub(crate) mod samples;
pub(crate) mod verify;
