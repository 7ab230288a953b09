//! The position of the areas in the record of a sound.

use tapline_wire::Quality;

use crate::force::Pulse;
use crate::signal::record::{Count, Record, Track};
use crate::sound::{onset_without_force, sound_onset};

/// Where the sound's areas begin, in samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// Beginning of A_1, absent without a force.
    pub onset: Option<f64>,
    /// End of A_1 and beginning of A_2.
    pub ringing: f64,
}

/// The areas' window, or the flag that says why there is none.
pub(super) fn window<C: Count>(
    record: &Record<'_, C>,
    track: Track<'_, C>,
    base: f64,
    microphone_distance_m: f64,
    pulse: Result<Pulse, Quality>,
) -> Result<Window, Quality> {
    let last = track.samples.len() as f64 - 1.0;
    let window = match pulse {
        Ok(pulse) => {
            let onset = sound_onset(pulse, microphone_distance_m, record.sample_rate_hz);
            let has_distance = microphone_distance_m >= 0.0 && onset >= 0.0;
            has_distance.then_some(Window { onset: Some(onset), ringing: onset + pulse.tau_samples })
        }
        Err(Quality::NO_FORCE) => onset_without_force(track.samples, record.pre_trigger_samples, base)
            .map(|onset| Window { onset: None, ringing: onset as f64 }),
        Err(why) => return Err(why),
    };
    // Both areas must lie in the record; otherwise the shorter would look like the quieter.
    window.filter(|window| window.ringing < last).ok_or(Quality::NO_ONSET)
}
