//! What the program asks of the machine it runs on: files that appear complete, signals, and what people see on standard error.

pub(crate) mod atomic_file;
pub(crate) mod log;
pub(crate) mod progress;
pub(crate) mod signals;
pub(crate) mod stderr;
