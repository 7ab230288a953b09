//! Stability limits of ways to read a sound: a value must not become wrong without a flag.

use tapline_process::ProcessConfig;
use tapline_wire::Discriminator;

use super::point::{Failure, exceeds};
use crate::stability::{Tap, add_hum, add_neighbour, add_offset};

/// The values that a spectrum gives.
const POWERS: [Discriminator; 3] = [Discriminator::Pr, Discriminator::Pf, Discriminator::Ef];

/// The limits that a configuration's powers fail. A flagged or absent value does not fail.
pub(crate) fn of_spectrum(config: &ProcessConfig) -> Vec<Failure> {
    let clean = Tap::sound();
    let silent = |tap: &Tap| {
        let (found, truth) = (tap.extract(config), clean.extract(config));
        if !found.quality.is_empty() {
            return 0.0;
        }
        let off = |which| match (found.values.get(which), truth.values.get(which)) {
            (Some(x), Some(truth)) => (x / truth - 1.0).abs(),
            _ => 0.0,
        };
        POWERS.map(off).into_iter().max_by(f64::total_cmp).unwrap_or(0.0)
    };
    let changed = |change: &dyn Fn(&mut Tap)| {
        let mut tap = clean.clone();
        change(&mut tap);
        silent(&tap)
    };
    let cases = [
        exceeds(
            "C3: offset of 10 % of the peak, change of a power",
            changed(&|tap| add_offset(&mut tap.sound_v, 0.1)),
            0.01,
        ),
        exceeds(
            "C6: hum of 50 Hz of 1 % of the peak, change of a power",
            changed(&|tap| add_hum(&mut tap.sound_v, 0.01, 50.0, 0.4)),
            0.02,
        ),
        exceeds(
            "C15: a neighbour's tap after 50 ms, change of a power without a flag",
            changed(&|tap| add_neighbour(&mut tap.sound_v, 1.0, 1200.0)),
            0.01,
        ),
        exceeds("C21: contact 2 ms after the trigger, change of a power", silent(&Tap::clean(1e-3, 2e-3)), 0.01),
    ];
    cases.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches limits that the shipped configuration itself breaks, and ones that nothing breaks: a record that ends in the
    /// middle of the ringing changes with the trigger.
    #[test]
    fn limits_part_good_from_bad() {
        assert_eq!(of_spectrum(&ProcessConfig::default()), []);
        let cut = ProcessConfig { record_s: 0.02, ..ProcessConfig::default() };
        let failures = of_spectrum(&cut);
        assert!(failures.iter().any(|failure| failure.case.starts_with("C21")), "{failures:?}");
    }
}
