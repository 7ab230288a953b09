//! The samples of a record, and the basis of every discriminator: levels, extents, sums.

pub(crate) mod aligned;
pub(crate) mod area;
pub(crate) mod baseline;
pub(crate) mod blocks;
pub(crate) mod extent;
pub(crate) mod hum;
pub(crate) mod real;
pub(crate) mod record;
pub(crate) mod wide;
