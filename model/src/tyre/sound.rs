//! The sound of a tap at the microphone: modes of the casing, driven by the force.

use std::f64::consts::TAU;

/// Speed of sound in air.
pub(crate) const SOUND_M_PER_S: f64 = 343.0;

/// Number of modes: those of the casing, and that of the layer above a crack.
pub(crate) const MODES: usize = 6;

/// One damped mode, as the voltage at the microphone after an impulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mode {
    /// Frequency without damping.
    pub frequency_hz: f64,
    /// Damping ratio: 1 is critical.
    pub damping_ratio: f64,
    /// Amplitude after an impulse of 1 N s; the surface goes in first, so the voltage goes down.
    pub voltage_v_per_n_s: f64,
    /// Phase phi of the mode, which Eq. 42 leaves open: 0 follows the surface's velocity, -pi/2 its deflection.
    pub phase_rad: f64,
}

impl Mode {
    /// A mode that does not sound.
    pub(crate) const SILENT: Self =
        Self { frequency_hz: 0.0, damping_ratio: 1.0, voltage_v_per_n_s: 0.0, phase_rad: 0.0 };
}

/// Modes of a sound casing on its rim: low and well damped, with little above 550 Hz.
///
/// Invented to look like Fig. 57 (a downward peak of about half a volt, silence after some 80 ms), not measured.
pub(crate) const CASING: [Mode; 5] = [
    casing_mode(92.0, 0.12, 22.0),
    casing_mode(168.0, 0.10, 16.0),
    casing_mode(305.0, 0.08, 10.0),
    casing_mode(470.0, 0.08, 5.0),
    casing_mode(760.0, 0.06, 2.0),
];

const fn casing_mode(frequency_hz: f64, damping_ratio: f64, voltage_v_per_n_s: f64) -> Mode {
    Mode { frequency_hz, damping_ratio, voltage_v_per_n_s, phase_rad: 0.0 }
}

/// Modes as resonators that turn force into voltage sample by sample.
///
/// After an impulse, a mode is exp(-d w t) cos(w_d t + phi), the projection of a rotation in the complex plane. Between
/// two samples the force enters by the trapezoid rule.
#[derive(Debug)]
pub(crate) struct Resonators {
    pole_re: [f64; MODES],
    pole_im: [f64; MODES],
    re: [f64; MODES],
    im: [f64; MODES],
    /// Direction on which the rotation is projected.
    view_re: [f64; MODES],
    view_im: [f64; MODES],
    /// Voltage per newton held for half a sample.
    drive: [f64; MODES],
}

impl Resonators {
    pub(crate) fn new(modes: &[Mode; MODES], sample_rate_hz: f64) -> Self {
        let dt = 1.0 / sample_rate_hz;
        let pole = modes.map(|m| {
            let omega = TAU * m.frequency_hz;
            let d = m.damping_ratio.clamp(0.0, 1.0);
            ((-d * omega * dt).exp(), omega * (1.0 - d * d).sqrt() * dt)
        });
        Self {
            pole_re: pole.map(|(radius, angle)| radius * angle.cos()),
            pole_im: pole.map(|(radius, angle)| radius * angle.sin()),
            re: [0.0; MODES],
            im: [0.0; MODES],
            view_re: modes.map(|m| m.phase_rad.cos()),
            view_im: modes.map(|m| -m.phase_rad.sin()),
            drive: modes.map(|m| 0.5 * dt * m.voltage_v_per_n_s),
        }
    }

    /// Voltage at the next sample, where the force is `force_n` after `last_n` at the previous one.
    pub(crate) fn step(&mut self, last_n: f64, force_n: f64) -> f64 {
        let mut sum = 0.0;
        for i in 0..MODES {
            let (re, im) = (self.re[i] + self.drive[i] * last_n, self.im[i]);
            self.re[i] = self.pole_re[i] * re - self.pole_im[i] * im + self.drive[i] * force_n;
            self.im[i] = self.pole_im[i] * re + self.pole_re[i] * im;
            sum += self.view_re[i] * self.re[i] + self.view_im[i] * self.im[i];
        }
        -sum
    }

    /// Upper bound of the voltage that the modes can still reach.
    pub(crate) fn loudness_v(&self) -> f64 {
        (0..MODES).map(|i| self.re[i].hypot(self.im[i])).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FS: f64 = 40_960.0;

    /// Catches a wrong pole, drive or sign: the slow twin convolves the force with each mode's response.
    #[test]
    fn resonators_are_a_convolution() {
        let force = |n: usize| if n < 40 { (TAU * 0.5 * n as f64 / 40.0).sin() * 30.0 } else { 0.0 };
        let layer = Mode { phase_rad: -1.2, ..casing_mode(700.0, 0.1, 30.0) };
        let modes = [CASING[0], CASING[1], CASING[2], CASING[3], CASING[4], layer];
        let mut resonators = Resonators::new(&modes, FS);
        for n in 0..2000_usize {
            let fast = resonators.step(if n == 0 { 0.0 } else { force(n - 1) }, force(n));
            let slow: f64 = modes
                .iter()
                .map(|m| {
                    let (omega, d) = (TAU * m.frequency_hz, m.damping_ratio);
                    let answer =
                        |t: f64| (-d * omega * t).exp() * (omega * (1.0 - d * d).sqrt() * t + m.phase_rad).cos();
                    let held: f64 = (0..=n.min(40))
                        .map(|k| force(k) * answer((n - k) as f64 / FS) * if k == n { 0.5 } else { 1.0 })
                        .sum();
                    -m.voltage_v_per_n_s * held / FS
                })
                .sum();
            assert!((fast - slow).abs() < 1e-9, "sample {n}: {fast} for {slow}");
        }
    }

    /// Catches a casing that rings for more than 100 ms, or whose sound begins upwards.
    #[test]
    fn a_casing_goes_down_first_and_falls_silent() {
        let mut modes = [Mode::SILENT; MODES];
        modes[..5].copy_from_slice(&CASING);
        let mut resonators = Resonators::new(&modes, FS);
        let first = resonators.step(0.0, 20.0);
        assert!(first < 0.0);
        let loud = resonators.loudness_v();
        let mut last = 20.0;
        for _ in 0..4096 {
            resonators.step(last, 0.0);
            last = 0.0;
        }
        assert!(resonators.loudness_v() < 0.01 * loud);
    }
}
