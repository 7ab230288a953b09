//! A line: starts the stages as processes, restarts them, publishes each verdict as it falls, and shows how it is.
//!
//! `tapline run` ends when its list of casings does; `tapline line` goes on for ever. They are the same but for that.
//!
//! `check` looks at the options and `run` begins; `setup`, `limits` and `out_folder` are what a line needs; `supervisor` tends the `stages`, each a `stage_process` that
//! runs `stage`; `status` and `summary` say how it is and what came of it.

mod check;
pub(crate) mod limits;
mod listed;
pub(crate) mod out_folder;
pub(crate) mod process_name;
mod progress_rate;
mod run;
pub(crate) mod setup;
pub(crate) mod stage;
mod stage_process;
mod stages;
pub(crate) mod status;
mod store_silence;
mod summary;
pub(crate) mod supervisor;

pub(crate) use self::check::check_config;
pub(crate) use self::run::{line, run};
