//! Devices that never pause.

#[cfg(feature = "alsa")]
mod alsa;
#[cfg(feature = "uldaq")]
mod uldaq;

use std::fmt;

#[cfg(feature = "alsa")]
pub use self::alsa::{Abilities, SoundCardInfo, sound_cards};
use crate::capture::CaptureConfig;

/// A device that can be recorded: its name, by driver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeviceName {
    /// A sound card, as ALSA names it.
    Alsa(String),
    /// A data acquisition module, by its product or its number.
    Uldaq(String),
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Alsa(name) | Self::Uldaq(name)) = self;
        f.write_str(name)
    }
}

/// Data from a device, frame by frame; a frame has one sample of each channel.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(any(feature = "alsa", feature = "uldaq", test)), expect(dead_code, reason = "only devices give it"))]
pub(super) enum Chunk<'a> {
    /// Parts of full scale.
    F32(&'a [f32]),
    /// This many frames were lost here.
    Lost(u64),
}

/// A device that is heard without a pause.
pub(super) trait Device {
    /// Waits a while for the next frames and passes them on, or nothing if none have come. Each piece has the number of
    /// frames that had already come after it: samples that are read late were not recorded late.
    ///
    /// # Errors
    /// Why the device cannot be read any more. It is then opened again.
    fn read(&mut self, take: &mut dyn FnMut(Chunk<'_>, u64)) -> Result<(), String>;
}

/// Opens the device `name`.
pub(super) fn open(name: &DeviceName, config: &CaptureConfig) -> Result<Box<dyn Device>, String> {
    match name {
        #[cfg(feature = "alsa")]
        DeviceName::Alsa(name) => Ok(Box::new(alsa::SoundCard::open(name, config)?)),
        #[cfg(feature = "uldaq")]
        DeviceName::Uldaq(name) => Ok(Box::new(uldaq::DaqModule::open(name, config)?)),
        #[cfg(not(all(feature = "alsa", feature = "uldaq")))]
        _ => {
            let _wanted = config;
            Err(format!("this program was built without a driver for {name:?}"))
        }
    }
}
