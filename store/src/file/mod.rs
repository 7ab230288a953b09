//! The archive as a file of the system: under which name, on which disk, and whether it is still there.

pub(crate) mod background_sync;
pub(crate) mod draft;
pub(crate) mod guard;
