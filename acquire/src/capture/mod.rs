//! Live capture: a sound card that is heard without a pause, the taps that are found in it, and the station whose taps they are.

mod ring;
mod trigger;

pub use trigger::{Crossing, NotTaps, Trigger, TriggerConfig};
