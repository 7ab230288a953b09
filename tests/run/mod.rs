//! `tapline run`: a list of casings, simulated or recorded, from the taps to the verdicts.

mod in_memory;
mod recorded;
mod reference;
mod results;
mod retakes;
mod simulated;
mod tap_sets;
