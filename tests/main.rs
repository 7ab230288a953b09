//! The built program, run in its own folder with its own shared memory, and killed on purpose.
//!
//! One folder for each use: [`run`] a list of casings, keep a [`line`] running, read [`archives`], use the
//! [`command_line`], send files to a centre by an [`uplink`]. [`faults`] has faults that must not lose a tap.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod archives;
mod command_line;
mod faults;
mod line;
mod run;
mod sandbox;
mod uplink;
