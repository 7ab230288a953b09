//! The built program: every question and every job on this host and on a cluster of real processes, which are killed on purpose.

#![expect(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod bucket;
mod cluster;
mod dask;
mod jobs;
mod kills;
mod network;
mod objects;
mod questions;
mod sandbox;
