//! The records that cross between stages, and the names and flags they carry.

pub(crate) mod calibration;
pub(crate) mod damage;
pub(crate) mod discriminators;
pub(crate) mod flags;
pub(crate) mod id;
pub(crate) mod stamp;
pub(crate) mod tap;
