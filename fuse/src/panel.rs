//! Who is compared with whom: of each scan its reference, its casing, and the scans whose verdict rests on it.

use std::collections::BTreeMap;

use tapline_wire::{Plan, Serial};

use crate::{Centre, Error, FuseConfig, IndexKind, Reference};

/// Who is compared with whom.
#[derive(Debug, Clone)]
pub(crate) struct Panel {
    /// Whether each casing is its own reference.
    pub(crate) is_own: bool,
    /// For each scan the scans of this run that make its reference, ascending.
    references: Vec<Vec<usize>>,
    /// For each scan the scans that are judged as one casing, ascending; it is among them.
    casings: Vec<Vec<usize>>,
    /// For each scan the scans whose verdict rests on it, ascending; it is among them.
    dependents: Vec<Vec<usize>>,
}

impl Panel {
    /// The panel that `config` makes of the scans of `plan`.
    pub(crate) fn of(config: &FuseConfig, plan: &Plan) -> Result<Self, Error> {
        let scans = plan.scans();
        let mut of_tyre: BTreeMap<Serial, Vec<usize>> = BTreeMap::new();
        for (number, scan) in scans.iter().enumerate() {
            of_tyre.entry(scan.tyre).or_default().push(number);
        }
        let tyres = || scans.iter().map(|scan| of_tyre.get(&scan.tyre).cloned().unwrap_or_default());
        let references: Vec<Vec<usize>> = match config.reference.as_ref().ok_or(Error::ReferenceNotNamed)? {
            Reference::Own => tyres().collect(),
            &Reference::Shoulder { tyre, shoulder } => {
                let named = scans.iter().position(|s| s.tyre == tyre && s.shoulder == shoulder);
                let named = named.ok_or(Error::ReferenceNotPlanned { tyre, shoulder, scan_count: scans.len() })?;
                vec![vec![named]; scans.len()]
            }
            Reference::File(_) => vec![Vec::new(); scans.len()],
        };
        let is_own = config.reference == Some(Reference::Own);
        // A casing is measured against its own level, unless a shoulder of it is stated to be sound.
        let has_level = |number: usize| references[number].iter().any(|&r| scans[r].tyre == scans[number].tyre);
        let is_alone = |number: usize| {
            config.centre == Centre::Reference || config.index == IndexKind::Dissertation || has_level(number)
        };
        let casing = |(number, tyre)| if !is_own && is_alone(number) { vec![number] } else { tyre };
        let casings: Vec<Vec<usize>> = tyres().enumerate().map(casing).collect();
        let mut dependents = vec![Vec::new(); scans.len()];
        for (number, (reference, casing)) in references.iter().zip(&casings).enumerate() {
            for &scan in reference.iter().chain(casing) {
                if !dependents[scan].contains(&number) {
                    dependents[scan].push(number);
                }
            }
        }
        Ok(Self { is_own, references, casings, dependents })
    }

    /// The scans of this run that make the reference of `scan`, ascending; none where it is in a file.
    pub(crate) fn reference(&self, scan: usize) -> &[usize] {
        &self.references[scan]
    }

    /// The scans that are judged together with `scan`, ascending.
    pub(crate) fn casing(&self, scan: usize) -> &[usize] {
        &self.casings[scan]
    }

    /// All scans that the verdict on `scan` rests on, ascending.
    pub(crate) fn involved(&self, scan: usize) -> Vec<usize> {
        let mut involved = [&self.references[scan][..], &self.casings[scan]].concat();
        involved.sort_unstable();
        involved.dedup();
        involved
    }

    /// The scans whose verdict rests on `scan`, ascending.
    pub(crate) fn dependents(&self, scan: usize) -> &[usize] {
        &self.dependents[scan]
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::{Geometry, PlannedTap, TapId, Truth};

    use super::*;
    use crate::testing::recording;

    /// Two tyres of two shoulders: scans 0 to 3.
    fn plan() -> Plan {
        let tap = |(tyre, shoulder)| PlannedTap {
            id: TapId::new(1, Serial::new(tyre).unwrap(), shoulder, 0),
            angle_deg: None,
            is_closing: false,
        };
        let taps = [("A", 1), ("A", 2), ("B", 1), ("B", 2)].map(tap).to_vec();
        Plan::new(Geometry::Ring, recording(), taps, Truth::new()).unwrap()
    }

    fn panel(config: &FuseConfig) -> Panel {
        Panel::of(config, &plan()).unwrap()
    }

    #[test]
    fn a_verdict_rests_on_its_reference_and_its_casing() {
        // Catches a casing judged without its other shoulder, which then would depend on who comes first; and a shoulder
        // of a casing with a stated one that waits for nothing of use.
        let own = panel(&FuseConfig::by(Reference::Own));
        assert_eq!((own.reference(3), own.casing(3), own.dependents(3)), (&[2, 3][..], &[2, 3][..], &[2, 3][..]));
        let a_2 = FuseConfig::by(Reference::Shoulder { tyre: Serial::new("A").unwrap(), shoulder: 2 });
        let named = panel(&a_2);
        assert_eq!((named.reference(0), named.casing(0), named.involved(0)), (&[1][..], &[0][..], vec![0, 1]));
        assert_eq!((named.casing(2), named.involved(2)), (&[2, 3][..], vec![1, 2, 3]));
        assert_eq!((named.dependents(1), named.dependents(2)), (&[0, 1, 2, 3][..], &[2, 3][..]));
        let by_reference = panel(&FuseConfig { centre: Centre::Reference, ..a_2.clone() });
        assert_eq!(by_reference.involved(2), [1, 2]);
        assert_eq!(panel(&FuseConfig { index: IndexKind::Dissertation, ..a_2 }).involved(2), [1, 2]);
        let file = panel(&FuseConfig::by(Reference::File("sound.json".into())));
        assert_eq!((file.reference(1), file.involved(1)), (&[0_usize; 0][..], vec![0, 1]));
        assert_eq!(Panel::of(&FuseConfig::default(), &plan()).unwrap_err(), Error::ReferenceNotNamed);
    }
}
