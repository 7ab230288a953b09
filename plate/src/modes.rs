//! The sound: decaying modes driven by the force.

use std::f64::consts::TAU;

/// Number of modes: those of the casing, and three of a loosened layer.
pub(crate) const MODES: usize = CASING.len() + LAYER_RATIOS.len();

/// Samples of one mode that are computed together.
const LANES: usize = 8;
/// Voltage below which a mode is no longer computed.
const SILENCE_V: f64 = 2e-6;

/// One mode: an impulse of 1 N s gives -`level` exp(-`decay` t) times the sine of 2 pi `frequency` t, or its cosine.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Mode {
    pub frequency_hz: f64,
    pub decay_per_s: f64,
    pub level_v_per_n_s: f64,
    /// Whether it sounds with its velocity, the cosine, instead of its deflection.
    pub by_velocity: bool,
}

/// Modes of a sound casing: assumed, to ring for some 25 ms with little above 550 Hz. The low ones come in pairs, a
/// quarter turn apart.
pub(crate) const CASING: [Mode; 8] = [
    mode(84.0, 110.0, 26.0),
    mode(151.0, 130.0, 22.0),
    mode(233.0, 150.0, 16.0),
    mode(352.0, 180.0, 12.0),
    mode(425.0, 210.0, 5.5),
    Mode { by_velocity: true, ..mode(697.0, 290.0, 1.3) },
    Mode { by_velocity: true, ..mode(1015.0, 380.0, 0.9) },
    Mode { by_velocity: true, ..mode(1460.0, 480.0, 0.7) },
];

/// Frequencies of a loosened layer relative to the layer alone, and their loudness: its surroundings move with it
/// (assumed, so that a faint crack is audible between 550 and 2000 Hz).
pub(crate) const LAYER_RATIOS: [(f64, f64); 3] = [(0.4, 1.0), (0.6, 0.6), (0.8, 0.4)];

const fn mode(frequency_hz: f64, decay_per_s: f64, level_v_per_n_s: f64) -> Mode {
    Mode { frequency_hz, decay_per_s, level_v_per_n_s, by_velocity: false }
}

/// Adds the sound of `modes` driven by `force_n` to `sound_v`; both begin at the same sample.
///
/// Each mode is the recursion s' = p s + F/fs with p = exp((-decay + i omega)/fs), and sounds as -level Im s; for a
/// mode that sounds with its velocity, i F replaces F.
pub(crate) fn add_sound(modes: &[Mode; MODES], sample_rate_hz: f64, force_n: &[f64], sound_v: &mut [f64]) {
    let dt = 1.0 / sample_rate_hz;
    let pole = modes.map(|m| {
        let (radius, angle) = ((-m.decay_per_s * dt).exp(), TAU * m.frequency_hz * dt);
        (radius * angle.cos(), radius * angle.sin())
    });
    let (pole_re, pole_im) = (pole.map(|p| p.0), pole.map(|p| p.1));
    let drive_im = modes.map(|m| if m.by_velocity { -m.level_v_per_n_s * dt } else { 0.0 });
    let drive_re = modes.map(|m| if m.by_velocity { 0.0 } else { -m.level_v_per_n_s * dt });
    let (mut re, mut im) = ([0.0; MODES], [0.0; MODES]);
    let driven = force_n.len().min(sound_v.len());
    for (force, out) in force_n.iter().zip(&mut sound_v[..driven]) {
        let mut sum = 0.0;
        for k in 0..MODES {
            let turned = pole_re[k] * re[k] - pole_im[k] * im[k];
            im[k] = pole_im[k] * re[k] + pole_re[k] * im[k] + drive_im[k] * force;
            re[k] = turned + drive_re[k] * force;
            sum += im[k];
        }
        *out += sum;
    }
    for k in 0..MODES {
        ring((pole_re[k], pole_im[k]), (re[k], im[k]), &mut sound_v[driven..]);
    }
}

/// Adds the imaginary part of `state` times the powers of `pole`, from the first power on, to `out`.
fn ring(pole: (f64, f64), state: (f64, f64), out: &mut [f64]) {
    let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
    let mut power = pole;
    for lane in 0..LANES {
        (re[lane], im[lane]) = times(power, state);
        if lane + 1 < LANES {
            power = times(power, pole);
        }
    }
    for block in out.chunks_mut(LANES) {
        if re[0].abs() + im[0].abs() < SILENCE_V {
            return;
        }
        for (x, im) in block.iter_mut().zip(&im) {
            *x += im;
        }
        for lane in 0..LANES {
            (re[lane], im[lane]) = (power.0 * re[lane] - power.1 * im[lane], power.1 * re[lane] + power.0 * im[lane]);
        }
    }
}

fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FS: f64 = 40_960.0;

    fn sound(modes: &[Mode; MODES], force_n: &[f64], count: usize) -> Vec<f64> {
        let mut sound = vec![0.0; count];
        add_sound(modes, FS, force_n, &mut sound);
        sound
    }

    fn wave(of: &Mode, t: f64) -> f64 {
        let (sine, cosine) = (TAU * of.frequency_hz * t).sin_cos();
        if of.by_velocity { cosine } else { sine }
    }

    fn alone(of: Mode) -> [Mode; MODES] {
        let mut modes = [Mode::default(); MODES];
        modes[3] = of;
        modes
    }

    /// Catches a mode with another frequency, decay or level than stated, while driven and after.
    #[test]
    fn a_mode_has_its_frequency_decay_and_level() {
        for of in CASING {
            for driven in [1, 40] {
                let mut force = vec![0.0; driven];
                force[0] = FS; // an impulse of 1 N s
                for (n, got) in sound(&alone(of), &force, 2000).into_iter().enumerate() {
                    let t = n as f64 / FS;
                    let expected = -of.level_v_per_n_s * (-of.decay_per_s * t).exp() * wave(&of, t);
                    assert!((got - expected).abs() < 1e-5, "{of:?} sample {n}: {got} for {expected}");
                }
            }
        }
    }

    /// Catches modes that do not add up, and a response that is not a convolution.
    #[test]
    fn modes_add_up_to_a_convolution() {
        let mut modes = [Mode::default(); MODES];
        modes[..CASING.len()].copy_from_slice(&CASING);
        modes[9] = mode(900.0, 450.0, 15.0);
        let force: Vec<f64> = (0..40).map(|n| 30.0 * (TAU * 0.5 * f64::from(n) / 40.0).sin()).collect();
        for (n, got) in sound(&modes, &force, 600).into_iter().enumerate() {
            let slow: f64 = modes
                .iter()
                .map(|m| {
                    let at = |t: f64| (-m.decay_per_s * t).exp() * wave(m, t);
                    let sum: f64 = (0..=n.min(39)).map(|k| force[k] * at((n - k) as f64 / FS)).sum();
                    -m.level_v_per_n_s * sum / FS
                })
                .sum();
            assert!((got - slow).abs() < 1e-5, "sample {n}: {got} for {slow}");
        }
    }

    /// Catches a casing that still rings at the end of the record.
    #[test]
    fn a_casing_falls_silent_within_fifty_milliseconds() {
        let mut modes = [Mode::default(); MODES];
        modes[..CASING.len()].copy_from_slice(&CASING);
        let sound = sound(&modes, &[1000.0; 20], 2048);
        let peak = |part: &[f64]| part.iter().map(|x| x.abs()).max_by(f64::total_cmp).unwrap();
        assert!(peak(&sound[1800..]) < 0.02 * peak(&sound), "{} {}", peak(&sound[1800..]), peak(&sound));
    }
}
