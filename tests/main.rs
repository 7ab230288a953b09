//! The built program in a folder of its own, with its own shared memory, killed on purpose.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod alone;
mod archive;
mod cli;
mod disk;
mod dissertation;
mod export_taps;
mod faults;
mod folders;
mod in_memory;
mod limits;
mod line;
mod model;
mod python_pages;
mod recorded;
mod reference;
mod report;
mod reprocess;
mod retakes;
mod rig;
mod simulated;
mod tapset;
