//! What the figures of reports, studies and pages are made of.
//!
//! - [`canvas`]: sheets, lines and letters, as SVG.
//! - [`palette`]: colours of curves, which colour-blind people tell apart.
//! - [`stats`]: the few numbers that a figure says of a list of values.
//! - [`record`]: one channel of a record in its unit, and the density of its power.

pub mod canvas;
pub mod palette;
pub mod record;
pub mod stats;
