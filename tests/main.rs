//! The built program, run in its own folder with its own shared memory, and killed on purpose.
//!
//! One folder for each use: [`run`] a list of casings, leave a [`line`] on, read [`archives`], ask on the
//! [`command_line`], send files to a centre by an [`uplink`]. [`faults`] has what must not lose a tap meanwhile.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod archives;
mod command_line;
mod faults;
mod line;
mod run;
mod sandbox;
mod uplink;
