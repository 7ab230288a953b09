//! A line: starts the stages as processes, heals them, says each verdict as it falls, and shows how it is.
//!
//! `tapline run` ends when its list of casings does; `tapline line` goes on for ever. They are the same but for that.

mod child;
mod hook;
pub(crate) mod limits;
pub(crate) mod name;
pub(crate) mod out_folder;
mod run;
pub(crate) mod setup;
pub(crate) mod stage;
pub(crate) mod status;
mod summary;
pub(crate) mod supervisor;
pub(crate) mod verdicts;

pub(crate) use self::run::{line, run};
