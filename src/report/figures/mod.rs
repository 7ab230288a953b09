//! The pictures of the pages, drawn by `tapline-draw` in one style.

pub(super) mod axis;
pub(super) mod boxes;
pub(super) mod bscan;
pub(super) mod chart;
pub(super) mod colour;
pub(super) mod inline;
pub(super) mod rig;
pub(super) mod ring;
pub(super) mod rounds;
pub(super) mod scale;
pub(super) mod sketch;
pub(super) mod small;
pub(super) mod strip;
pub(super) mod taps;
