//! Options, configurations and errors; the verbs that need no archive; the commands on the pages.

mod dissertation;
mod generated;
mod json;
mod model;
mod overwriting;
mod terminal;
mod usage;
