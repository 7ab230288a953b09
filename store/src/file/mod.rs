//! The archive as a file on disk: its name, its disk, and whether it is still there.
//!
//! - `draft`: a new file, created under another name and renamed when it is complete
//! - `guard`: whether the file that is being written is still at its path
//! - `background_sync`: written data goes to the disk while the writer continues

pub(crate) mod background_sync;
pub(crate) mod draft;
pub(crate) mod guard;

/// Folder of the unfinished files, within the output folder of a line.
pub const OPEN_FOLDER: &str = "open";

/// Folder of unfinished files that a line cannot resume, within its output folder.
pub const LEFT_FOLDER: &str = "left";

/// Folder of the notes of verdicts that are still to be reported, within the output folder of a line.
pub const UNREPORTED_FOLDER: &str = "unreported";

/// Ending of an archive's name.
pub(crate) const ENDING: &str = "h5";
