//! Section 5.4: a tap of a sound place compared with one over a crack.

use anyhow::Result;
use tapline_draw::stats::{mean, median};
use tapline_wire::Discriminator;

use super::{Claim, digits, known, values};
use crate::experiment::dataset::{Experiment, Tap};
use crate::experiment::spectrum::{BAND_HZ, STEP_HZ};

pub(super) fn claims(experiment: &Experiment) -> Result<Vec<Claim>> {
    let [turn, _] = experiment.repetitions(1);
    let typical = |which: Discriminator, severity: u8| {
        known(median(&values(&turn, |tap| tap.severity == severity, |tap| tap.value(which))))
    };
    let both = |which| -> Result<(f64, f64)> { Ok((typical(which, 0)?, typical(which, 3)?)) };
    let (f_max, tau, a_1) = (both(Discriminator::FMax)?, both(Discriminator::Tau)?, both(Discriminator::A1)?);
    let f_c_hz = 0.5 / tau.0;
    let above_550 = |severity: u8| {
        known(mean(&values(&turn, |tap| tap.severity == severity, |tap| power_from(tap, 550.0, 2000.0))))
    };
    let gain_db = 10.0 * (above_550(3)? / above_550(0)?).log10();
    let pair =
        |(sound, cracked): (f64, f64), scale: f64| format!("{} and {}", digits(sound * scale), digits(cracked * scale));
    Ok(vec![
        Claim::new("force", "5.4, Fig. 56")
            .claim("over a crack the force is lower and lasts longer")
            .quantity("medians of sound places and of severity 3")
            .ours(format!("F_max {} N, tau {} ms", pair(f_max, 1.0), pair(tau, 1e3)))
            .agrees(f_max.1 < f_max.0 && tau.1 > tau.0)
            .remark("Follows from the contact model; how compliant a crack in a casing is, is assumed."),
        Claim::new("contact-time", "5.4")
            .claim("the contact at a sound place lasts 0.9 ms, so that f_c is 555 Hz")
            .quantity("median tau of sound places, and 1/(2 tau)")
            .dissertation("0.9 ms, 555 Hz")
            .ours(format!("{} ms, {} Hz", digits(tau.0 * 1e3), digits(f_c_hz)))
            .agrees((tau.0 * 1e3 - 0.9).abs() < 0.09)
            .remark("Within a tenth. Built so: the casing's modulus was set for this contact time."),
        Claim::new("initial-area", "5.4, Fig. 57")
            .claim("the initial area of the sound is smaller at a sound place")
            .quantity("median A_1 of sound places and of severity 3")
            .ours(format!("{} mV s", pair(a_1, 1e3)))
            .agrees(a_1.1 > a_1.0)
            .remark("Built so: the layer above a crack is heard by its deflection."),
        Claim::new("power-above-f_c", "5.4, Fig. 57")
            .claim("above 550 Hz the power of the sound is greater over a crack")
            .quantity("mean power of 550 to 2000 Hz, severity 3 over sound")
            .ours(format!("{} dB", digits(gain_db)))
            .agrees(gain_db > 0.0)
            .remark("Built so: the layer has a mode in that band."),
    ])
}

/// Mean power density of `tap` between two frequencies.
pub(super) fn power_from(tap: &Tap, low_hz: f64, high_hz: f64) -> Option<f64> {
    let frequency_hz = |step: usize| BAND_HZ.0 + (step as f64 + 0.5) * STEP_HZ;
    let steps = tap.density_v2_per_hz.iter().enumerate();
    let within =
        steps.filter(|(step, _)| (low_hz..high_hz).contains(&frequency_hz(*step))).map(|(_, &density)| density);
    mean(&within.collect::<Vec<_>>())
}
