//! How imperfect casings, places, turns and taps are.

/// Scatter of a population of casings and of the rig that taps them. Values without a unit are relative standard
/// deviations.
///
/// Every value is an assumption: nobody has published one for tyres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Population {
    /// Contact stiffness from casing to casing.
    pub casing_stiffness: f64,
    /// Mass per area from casing to casing; it enters the impedance, and reduces the level of the modes.
    pub casing_mass: f64,
    /// Frequency and decay of each mode from casing to casing.
    pub casing_mode_frequency: f64,
    /// Level of each mode from casing to casing.
    pub casing_mode_level: f64,
    /// Gain of the microphone from casing to casing.
    pub casing_gain: f64,
    /// Stiffness, frequencies and levels between the shoulders of a casing.
    pub shoulder: f64,
    /// Stiffness of a place, the same at every tap, correlated along the ring.
    pub place_stiffness: f64,
    /// Angle at which that correlation has fallen to exp(-1/2).
    pub place_correlation_deg: f64,
    /// Level of each mode at a place, the same at every tap, independent between places.
    pub place_modes: f64,
    /// Fraction of a place's variance that all offsets at one angle share.
    pub place_shared: f64,
    /// Gain of the microphone from turn to turn.
    pub turn_gain: f64,
    /// Change of that gain over a turn, from its first tap to its last.
    pub turn_drift: f64,
    /// Gain of the force sensor from turn to turn.
    pub turn_sensor: f64,
    /// Change of that gain over a turn.
    pub turn_sensor_drift: f64,
    /// Contact stiffness from tap to tap.
    pub tap_stiffness: f64,
    /// Velocity from tap to tap.
    pub tap_velocity: f64,
    /// Level of each mode from tap to tap.
    pub tap_modes: f64,
    /// Error of the measured velocity.
    pub velocity_error: f64,
    /// Fraction of the taps that go wrong: half bounce, half land beside their place or are too slow.
    pub rogue: f64,
    /// Whether the casings do not turn: every tap is at 0 degrees.
    pub stands_still: bool,
    /// Noise of the force sensor, N.
    pub force_noise_n: f64,
    /// Noise of the microphone, V.
    pub sound_noise_v: f64,
}

impl Population {
    /// A quiet rig and uniform casings.
    pub fn smooth() -> Self {
        Self {
            casing_stiffness: 0.03,
            casing_mass: 0.03,
            casing_mode_frequency: 0.01,
            casing_mode_level: 0.05,
            casing_gain: 0.03,
            shoulder: 0.01,
            place_stiffness: 0.01,
            place_correlation_deg: 10.0,
            place_modes: 0.02,
            place_shared: 0.5,
            turn_gain: 0.02,
            turn_drift: 0.003,
            turn_sensor: 0.005,
            turn_sensor_drift: 0.001,
            tap_stiffness: 0.01,
            tap_velocity: 0.008,
            tap_modes: 0.02,
            velocity_error: 0.002,
            rogue: 0.0,
            stands_still: false,
            force_noise_n: 0.05,
            sound_noise_v: 0.002,
        }
    }

    /// What a method must tolerate: 1 % rogue taps, a gain that drifts by 2 % within a turn, and variations of 4 % in
    /// stiffness and 8 % in the modes' level that belong to a place and return at every repetition.
    pub fn rough() -> Self {
        Self {
            place_stiffness: 0.04,
            place_modes: 0.08,
            turn_gain: 0.04,
            turn_drift: 0.02,
            turn_sensor_drift: 0.005,
            rogue: 0.01,
            ..Self::smooth()
        }
    }

    /// The same population with `times` the noise of force and sound.
    pub fn with_noise(self, times: f64) -> Self {
        Self { force_noise_n: times * self.force_noise_n, sound_noise_v: times * self.sound_noise_v, ..self }
    }
}

impl Default for Population {
    fn default() -> Self {
        Self::smooth()
    }
}
