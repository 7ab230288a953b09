//! What tapline's programs ask of the machine they run on and of the people who run them: arguments that all verbs share,
//! messages, progress, tables, files that appear complete, signals, and who connects over a network.

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
pub mod stdout;
pub mod table;
