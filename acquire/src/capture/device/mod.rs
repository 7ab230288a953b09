//! What gives samples without a pause.

#[cfg(feature = "alsa")]
mod alsa;

#[cfg(feature = "alsa")]
pub use self::alsa::{Abilities, SoundCardInfo, sound_cards};
use crate::capture::CaptureConfig;

/// What came from a device, frame by frame, a sample of each channel in a frame.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(feature = "alsa"), expect(dead_code, reason = "no device is built in"))]
pub(super) enum Chunk<'a> {
    /// Counts of a 16-bit converter.
    I16(&'a [i16]),
    /// Parts of full scale.
    F32(&'a [f32]),
    /// So many frames were lost here.
    Lost(u64),
}

/// A device that is heard without a pause.
pub(super) trait Device {
    /// Waits a while for the next frames, and passes them on; not at all where none have come.
    ///
    /// # Errors
    /// Why the device cannot be read any more. It is then opened again.
    fn read(&mut self, take: &mut dyn FnMut(Chunk<'_>)) -> Result<(), String>;
}

/// Opens the sound card `name`.
///
/// # Errors
/// Why it cannot be opened as `config` wants it.
#[cfg(feature = "alsa")]
pub(super) fn open(name: &str, config: &CaptureConfig) -> Result<Box<dyn Device>, String> {
    Ok(Box::new(alsa::SoundCard::open(name, config)?))
}

#[cfg(not(feature = "alsa"))]
pub(super) fn open(name: &str, _config: &CaptureConfig) -> Result<Box<dyn Device>, String> {
    Err(format!("cannot open {name}: this program was built without the feature alsa"))
}
