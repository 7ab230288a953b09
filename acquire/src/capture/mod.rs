//! Live capture: a device recorded without a pause, the taps found in it, and their casings.
//!
//! One thread per station reads the device ([`device`]) into a ring of the last seconds ([`ring`]), and looks for taps in the
//! force ([`trigger`]); [`ear`] holds both. A tap is copied once, from the ring into its loan, when the station takes it
//! ([`heard`]). The rig determines which tap is next, or, by hand, the order of the plan ([`by_hand`]).

pub(crate) mod by_hand;
mod config;
mod device;
pub(crate) mod ear;
#[cfg(test)]
pub(crate) mod fake;
pub(crate) mod heard;
mod monitor;
mod ring;
mod trigger;

pub use config::{CaptureConfig, UldaqConfig};
pub use device::DeviceName;
#[cfg(feature = "alsa")]
pub use device::{Abilities, SoundCardInfo, sound_cards};
pub use monitor::{Monitor, MonitoredTap};
pub use trigger::{Crossing, NotTaps, Trigger, TriggerConfig};

#[cfg(test)]
#[cfg(feature = "alsa")]
mod tests;
