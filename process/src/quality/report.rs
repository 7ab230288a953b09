//! The flags that the rules raise on one record.

use tapline_wire::{Discriminator, Discriminators, Quality};

use super::Policy;

/// The flags raised on a record, and the discriminators that are dropped for them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct QualityReport {
    flags: Quality,
    pulse_dropped_for: Option<Quality>,
    dropped: [bool; Discriminator::COUNT],
}

impl QualityReport {
    /// The flags raised so far.
    pub(crate) fn flags(&self) -> Quality {
        self.flags
    }

    /// The first flag for which the pulse, and every discriminator that needs it, is dropped.
    pub(crate) fn pulse_dropped_for(&self) -> Option<Quality> {
        self.pulse_dropped_for
    }

    /// Raises `flag`, which drops nothing.
    pub(crate) fn note(&mut self, flag: Quality) {
        self.flags.insert(flag);
    }

    /// Raises `flag` and, if its `policy` says so, drops `discriminators`.
    pub(crate) fn raise(&mut self, flag: Quality, policy: Policy, discriminators: &[Discriminator]) {
        self.flags.insert(flag);
        if policy.drops() {
            discriminators.iter().for_each(|&which| self.dropped[which as usize] = true);
        }
    }

    /// Raises `flag` and, if its `policy` says so, drops the pulse and every discriminator that needs it.
    pub(crate) fn raise_on_pulse(&mut self, flag: Quality, policy: Policy) {
        self.flags.insert(flag);
        if policy.drops() && self.pulse_dropped_for.is_none() {
            self.pulse_dropped_for = Some(flag);
        }
    }

    /// Adds the flags to `found` and removes the dropped discriminators from it.
    pub(crate) fn apply(&self, found: &mut Discriminators) {
        found.quality.insert(self.flags);
        for which in Discriminator::ALL.into_iter().filter(|&which| self.dropped[which as usize]) {
            found.values.set(which, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::RecordPart;

    use super::super::{OF_SOUND, OF_SPECTRUM};
    use super::*;

    /// Catches discriminators dropped under `keep`, and a first reason that a later one replaces.
    #[test]
    fn policies_are_heeded() {
        let mut report = QualityReport::default();
        report.raise(Quality::HUM, Policy::Keep, &OF_SOUND);
        report.raise(Quality::NEIGHBOUR, Policy::Drop, &OF_SPECTRUM);
        report.raise_on_pulse(Quality::LATE_TRIGGER, Policy::Keep);
        report.raise_on_pulse(Quality::CLIPPED, Policy::Drop);
        report.raise_on_pulse(Quality::DOUBLE_HIT, Policy::Drop);
        assert_eq!(report.pulse_dropped_for(), Some(Quality::CLIPPED));
        let mut found = Discriminators::default();
        Discriminator::ALL.iter().for_each(|&which| found.values.set(which, Some(1.0)));
        report.apply(&mut found);
        assert_eq!(
            Discriminator::ALL.map(|which| found.values.get(which).is_some()),
            Discriminator::ALL.map(|which| which.part() != RecordPart::SoundSpectrum)
        );
        assert_eq!(found.quality.to_string(), "clipped|late_trigger|double_hit|hum|neighbour");
    }
}
