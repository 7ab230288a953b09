//! The pages: one a tyre, one a shift, and the words they are written in.

pub(super) mod marks;
pub(super) mod page;
pub(super) mod shift;
pub(super) mod tyre;
pub(super) mod words;
