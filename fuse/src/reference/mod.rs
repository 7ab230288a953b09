//! What shoulders are compared with: `file` holds shoulders that are known (`known_shoulder`), `build` makes such a file of archives,
//! `fitted` is what they teach for one plan, and `supported` says which rates of false calls they support.

pub(crate) mod build;
pub(crate) mod file;
pub(crate) mod fitted;
pub(crate) mod known_shoulder;
pub(crate) mod pattern;
mod standing_out;
pub(crate) mod summary;
pub(crate) mod supported;
