//! Questions over years of archives, and new results of them, on this host or on a cluster.
//!
//! [`places`] are folders or the keys of a bucket, and have the casing files; [`copy`] copies them from one to another. [`task`]
//! says what is done with each, [`plan`] puts that into a plan of DataFusion, and [`engine`] runs the plan here or on a cluster of
//! Ballista, whose processes are in [`cluster`]. [`reprocess`] keeps the results of a job in one committed folder.
//!
//! Two rules make a cluster return what one host returns. A plan's leaf is always one that Ballista can cut into tasks:
//! paths of files in memory. Our node above it turns them into rows: with a leaf of ours, each task would do all files.
//! And a file that cannot be read is a row with its error, because an error would end the whole job.

pub mod cluster;
pub mod copy;
pub mod engine;
pub mod places;
pub mod plan;
pub mod reprocess;
pub mod sql;
pub mod task;

pub use engine::Engine;
pub use places::{CasingFile, Place};
pub use task::Task;
