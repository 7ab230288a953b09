//! The parts of the figures in reports, studies and pages.
//!
//! - [`axes`]: a pair of axes with a grid.
//! - [`boxplot`]: boxes with whiskers, by Tukey's rule.
//! - [`canvas`]: lines and letters, as SVG.
//! - [`palette`]: colours of curves, which colour-blind people distinguish.
//! - [`scale`]: where a value lies along an axis, and its ticks.
//! - [`stats`]: summary statistics of a list of values.
//! - [`record`]: one channel of a record in its unit, and its power spectral density.

pub mod axes;
pub mod boxplot;
pub mod canvas;
pub mod palette;
pub mod record;
pub mod scale;
pub mod stats;
