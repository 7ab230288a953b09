//! The built program in a folder of its own, with its own shared memory, killed on purpose.
//!
//! One folder for each thing that people do with it: [`run`] a list of casings, leave a [`line`] on, read [`archives`], ask on
//! the [`command_line`]; [`faults`] is what must not lose a tap meanwhile.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod archives;
mod command_line;
mod faults;
mod line;
mod run;
mod sandbox;
