//! Where casing files are, and which there are.
//!
//! - `place`: a folder, or the keys of a bucket
//! - `objects`: objects of a bucket, listed, read and put
//! - `files`: the casing files of places

mod files;
pub(crate) mod objects;
mod place;

pub(crate) use files::{ARCHIVES_FILE, End, JOB_DIGITS, JOB_PREFIX};
pub use files::{COMMIT_FILE, CasingFile, find, partitions};
pub use place::{Key, Place};
