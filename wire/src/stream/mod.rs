//! Shared memory: a line and its topics, which carry the records.

pub(crate) mod address;
mod cleanup;
pub(crate) mod error;
mod folder;
pub(crate) mod line;
pub(crate) mod mailbox;
pub(crate) mod publisher;
pub(crate) mod service;
pub mod shm;
pub(crate) mod subscriber;
pub(crate) mod topic;
