//! Shared memory: a line and its topics, which carry the records.

pub(crate) mod address;
pub(crate) mod error;
pub(crate) mod event;
pub(crate) mod line;
pub(crate) mod publisher;
pub mod room;
pub(crate) mod service;
pub(crate) mod subscriber;
pub(crate) mod topic;
