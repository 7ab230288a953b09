//! Options, configurations and errors; the verbs that need no archive; the commands on the pages.

mod dissertation;
mod model;
mod usage;
