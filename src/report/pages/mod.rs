//! The pages: one per tyre, one per shift, and their vocabulary.

pub(super) mod marks;
pub(super) mod page;
pub(super) mod paper;
pub(super) mod rig;
pub(super) mod shift;
pub(super) mod tyre;
pub(super) mod words;
