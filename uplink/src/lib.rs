//! Finished casing files go from the hosts of stations to a centre, each once, over a server that keeps what it acknowledges.
//!
//! A casing's file is what travels: it is closed, sealed and never written again, so that what arrives is the same to the last bit, its
//! ledger included. It stays on the station's host, and is the truth until the centre has a file of its own on its disk, has
//! checked it, and says so in a *receipt*. What the server loses is sent again.
//!
//! | who | does |
//! |---|---|
//! | [`send()`] | publishes each finished file for which there is no receipt, at most [`WINDOW`] at a time |
//! | the server | keeps the bytes of files, who has yet to take which, and the receipts |
//! | [`collect()`] | takes files, several hosts from one queue; writes, checks, and gives the receipt |
//!
//! - `server`: where the server is, and what a connection to it needs
//! - `file`: names of files, and which of them are safe to write
//! - `receipt`: what a centre says of a file
//! - `jetstream`: the server that both ends use, NATS JetStream
//! - `send`, `collect`: the two ends; `staging`: a centre's folder
//! - `session`: tries again after any trouble, and logs it once

mod collect;
mod file;
mod jetstream;
mod receipt;
mod send;
mod server;
mod session;
mod staging;

pub use crate::collect::{Collected, Collector, collect};
pub use crate::file::{CasingFile, Site};
pub use crate::receipt::{Fate, Receipt};
pub use crate::send::{Sender, Sent, Standing, WINDOW, send};
pub use crate::server::{Access, Server};
pub use crate::session::Until;
