//! Options, configurations and errors; the verbs that need no archive; the commands of the pages.

mod dissertation;
mod model;
mod usage;
