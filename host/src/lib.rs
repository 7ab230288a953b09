//! What tapline's programs need from the machine and to talk to their users: arguments that all verbs share,
//! messages, progress, tables, files that appear complete, signals, and network connections.

pub mod arguments;
pub mod atomic_file;
pub mod colour;
pub mod connection;
pub mod generated;
pub mod log;
pub mod memory;
pub mod messages;
pub mod progress;
pub mod signals;
pub mod similar;
pub mod stderr;
pub mod stdout;
pub mod table;
