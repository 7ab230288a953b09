//! A line: starts the stages as processes, restarts them, publishes each verdict at once, and shows its status.
//!
//! `tapline run` ends when its list of casings does; `tapline line` runs for ever. That is the only difference.
//!
//! `check` checks the options, `run` starts; `setup`, `limits` and `out_folder` have what a line needs. `supervisor`
//! tends the `stages`, each a `stage_process` that runs `stage`; `status` shows the line, `summary` its results.

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
mod summary;
pub(crate) mod supervisor;

pub(crate) use self::check::check_config;
pub(crate) use self::run::{line, run};
