//! What gives samples without a pause.

#[cfg(feature = "alsa")]
mod alsa;
#[cfg(feature = "uldaq")]
mod uldaq;

use std::fmt;

#[cfg(feature = "alsa")]
pub use self::alsa::{Abilities, SoundCardInfo, sound_cards};
use crate::capture::CaptureConfig;

/// A device that can be listened to: its name, by what drives it.
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

/// What came from a device, frame by frame, a sample of each channel in a frame.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(any(feature = "alsa", feature = "uldaq", test)), expect(dead_code, reason = "only devices give it"))]
pub(super) enum Chunk<'a> {
    /// Parts of full scale.
    F32(&'a [f32]),
    /// So many frames were lost here.
    Lost(u64),
}

/// A device that is heard without a pause.
pub(super) trait Device {
    /// Waits a while for the next frames, and passes them on; not at all where none have come. With each piece goes how many
    /// frames had come behind it by then: what was late in being read was not heard late.
    ///
    /// # Errors
    /// Why the device cannot be read any more. It is then opened again.
    fn read(&mut self, take: &mut dyn FnMut(Chunk<'_>, u64)) -> Result<(), String>;
}

/// Opens the device `name`.
///
/// # Errors
/// Why it cannot be opened as `config` wants it.
pub(super) fn open(name: &DeviceName, config: &CaptureConfig) -> Result<Box<dyn Device>, String> {
    match name {
        #[cfg(feature = "alsa")]
        DeviceName::Alsa(name) => Ok(Box::new(alsa::SoundCard::open(name, config)?)),
        #[cfg(feature = "uldaq")]
        DeviceName::Uldaq(name) => Ok(Box::new(uldaq::DaqModule::open(name, config)?)),
        #[cfg(not(all(feature = "alsa", feature = "uldaq")))]
        _ => {
            let _wanted = config;
            Err(format!("this program was built without what drives it: {name:?}"))
        }
    }
}
