//! What the program asks of the machine it runs on: files that appear whole, signals, and what people see on standard error.

pub(crate) mod atomic_file;
pub(crate) mod progress;
pub(crate) mod sigbus;
pub(crate) mod stderr;
pub(crate) mod stop;
