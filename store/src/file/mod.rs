//! The archive as a file of the system: its name, its disk, and whether it is still there.
//!
//! - `draft`: a new file, created under another name and renamed when it is complete
//! - `guard`: whether the file that is being written is still at its path
//! - `background_sync`: written data goes to the disk while the writer goes on

pub(crate) mod background_sync;
pub(crate) mod draft;
pub(crate) mod guard;
