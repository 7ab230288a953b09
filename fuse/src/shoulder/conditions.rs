//! Conditions: taps that may be compared with each other, of one offset and one velocity class.

use std::borrow::Borrow;

use tapline_wire::{Plan, TapId};

/// A velocity this much above the next lower one starts a new class.
///
/// Planned velocities lie 10 % or more apart. Measured ones that replace a planned one scatter, so that a class may span more than this; but
/// neighbours among them lie closer together.
const CLASS_GAP: f64 = 1.05;

/// The conditions of a set of taps.
///
/// It depends on which taps there are, not on their order. Taps of unknown offset or velocity form
/// classes of their own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Conditions {
    /// Bits of the offsets in mm, sorted by bits: an order, if not that of the numbers.
    offsets: Vec<Option<u64>>,
    /// Lowest velocity of each class in m/s, ascending.
    class_floors_m_per_s: Vec<f64>,
}

impl Conditions {
    /// The conditions that `taps` fall into.
    pub(crate) fn of(taps: impl Iterator<Item = impl Borrow<TapId>>) -> Self {
        let (mut offsets, mut velocities) = (Vec::new(), Vec::new());
        for tap in taps {
            let tap = tap.borrow();
            offsets.push(offset_key(tap));
            velocities.extend(tap.velocity_m_per_s());
        }
        offsets.sort_unstable();
        offsets.dedup();
        velocities.sort_by(f64::total_cmp);
        let mut class_floors_m_per_s = Vec::new();
        let mut below = f64::NEG_INFINITY;
        for velocity in velocities {
            if class_floors_m_per_s.is_empty() || velocity > CLASS_GAP * below {
                class_floors_m_per_s.push(velocity);
            }
            below = velocity;
        }
        Self { offsets, class_floors_m_per_s }
    }

    /// How many conditions there can be.
    pub(crate) fn count(&self) -> usize {
        self.offsets.len() * (self.class_floors_m_per_s.len() + 1)
    }

    /// Number of the offset of `tap` among those known here.
    pub(crate) fn offset_number(&self, tap: &TapId) -> Option<usize> {
        self.offsets.binary_search(&offset_key(tap)).ok()
    }

    /// The offsets in mm, by their numbers; `None` is the unknown one.
    pub(crate) fn offsets_mm(&self) -> Vec<Option<f64>> {
        self.offsets.iter().map(|key| key.map(f64::from_bits)).collect()
    }

    /// Numbers of the offsets from the belt edge inwards, the unknown one last.
    pub(crate) fn offsets_inwards(&self) -> Vec<usize> {
        let offsets_mm = self.offsets_mm();
        let distance = |number: &usize| edge_distance_mm(offsets_mm[*number]);
        let mut numbers: Vec<usize> = (0..offsets_mm.len()).collect();
        numbers.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        numbers
    }

    /// Offset in mm and least velocity in m/s of condition number `condition`; `None` where unknown.
    pub(crate) fn name(&self, condition: usize) -> (Option<f64>, Option<f64>) {
        let class = condition % (self.class_floors_m_per_s.len() + 1);
        let floor = class.checked_sub(1).and_then(|class| self.class_floors_m_per_s.get(class).copied());
        (self.offsets[self.offset_of(condition)].map(f64::from_bits), floor)
    }

    /// Number of the offset of condition number `condition`.
    pub(crate) fn offset_of(&self, condition: usize) -> usize {
        condition / (self.class_floors_m_per_s.len() + 1)
    }

    /// Number of the condition of `tap`, below [`Conditions::count`]; `None` for an offset unknown here.
    pub(crate) fn number(&self, tap: &TapId) -> Option<usize> {
        let offset = self.offset_number(tap)?;
        // Class 0 is that of unknown velocity.
        let class =
            tap.velocity_m_per_s().map_or(0, |v| self.class_floors_m_per_s.partition_point(|&floor| floor <= v));
        Some(offset * (self.class_floors_m_per_s.len() + 1) + class)
    }
}

/// One tap of `taps` for each offset and velocity among them: all that [`Conditions::of`] looks at.
pub(crate) fn distinct(taps: impl Iterator<Item = TapId>) -> Vec<TapId> {
    let mut names: Vec<TapId> = Vec::new();
    let mut last = None;
    for tap in taps {
        // Most taps have the name of the one before.
        if last.replace(name(&tap)) != Some(name(&tap)) {
            names.push(tap);
        }
    }
    names.sort_by_key(name);
    names.dedup_by_key(|tap| name(tap));
    names
}

/// The name of the tap in row `row` of `plan`, with its planned velocity.
pub(crate) fn name_as_planned(plan: &Plan, row: u32) -> TapId {
    let id = plan.taps()[row as usize].id;
    id.with_velocity_m_per_s(plan.velocity_nominal_m_per_s(row)).unwrap_or(id)
}

/// Offset and velocity of a tap, in an order.
fn name(tap: &TapId) -> (Option<u64>, Option<u64>) {
    (offset_key(tap), tap.velocity_m_per_s().map(f64::to_bits))
}
/// How far an offset lies from the belt edge; an unknown one is the farthest.
pub(crate) fn edge_distance_mm(offset_mm: Option<f64>) -> f64 {
    offset_mm.map_or(f64::INFINITY, f64::abs)
}

fn offset_key(tap: &TapId) -> Option<u64> {
    tap.offset_mm().map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tap(offset_mm: Option<f64>, velocity_m_per_s: Option<f64>) -> TapId {
        TapId::default().with_offset_mm(offset_mm).unwrap().with_velocity_m_per_s(velocity_m_per_s).unwrap()
    }

    #[test]
    fn velocities_that_scatter_fall_into_their_nominal_classes() {
        // Catches a class per velocity, and classes that depend on the order of the taps.
        let mut taps = Vec::new();
        for step in 0..50 {
            for nominal in [0.9, 1.2, 1.8] {
                taps.push(tap(Some(5.0), Some(nominal * (1.0 + 0.0015 * f64::from(step - 25)))));
            }
        }
        let conditions = Conditions::of(taps.iter());
        assert_eq!(conditions.class_floors_m_per_s.len(), 3);
        for (row, id) in taps.iter().enumerate() {
            assert_eq!(conditions.number(id), Some(row % 3 + 1));
        }
        taps.reverse();
        assert_eq!(Conditions::of(taps.iter()), conditions);
        // Catches a name that is lost because another tap came between two that share it, and one that is there twice.
        let twice = distinct(taps.iter().chain(&taps).copied());
        assert_eq!((Conditions::of(twice.iter()), twice.len()), (conditions, 150));
    }

    #[test]
    fn the_unknown_is_a_class_of_its_own() {
        // Catches taps of unknown velocity or offset being compared with known ones.
        let taps = [
            tap(None, None),
            tap(None, Some(0.0)),
            tap(None, Some(1.0)),
            tap(Some(0.0), Some(1.0)),
            tap(Some(-5.0), None),
        ];
        let conditions = Conditions::of(taps.iter());
        let mut numbers: Vec<usize> = taps.iter().map(|t| conditions.number(t).unwrap()).collect();
        assert!(numbers.iter().all(|&n| n < conditions.count()));
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), 5);
        assert_eq!(conditions.number(&tap(Some(1.0), None)), None);
    }
}
