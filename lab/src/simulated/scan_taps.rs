//! Which taps of a casing a scan makes, and how long they take on a rig.

use tapline_plate::ScanShape;
use tapline_wire::{Plan, PlannedTap, Scan, Serial};

/// Once around a shoulder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Offset from the belt's edge.
    pub offset_mm: f64,
    /// Impact velocity.
    pub velocity_m_per_s: f64,
    /// Which repetition it is, from 0.
    pub repetition: u16,
    /// Step between locations: 2 taps every second one.
    pub every: u32,
}

/// The turns of a scan, and whether what stands out is tapped again.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanTaps {
    /// The turns that are made in any case.
    pub turns: Vec<Turn>,
    /// Whether what stands out is tapped again before it is judged.
    pub is_confirmed: bool,
}

impl ScanTaps {
    /// Every location at each of these offsets and velocities, `repetitions` times.
    pub fn full(offsets_mm: &[f64], velocities_m_per_s: &[f64], repetitions: u16) -> Self {
        let mut turns = Vec::new();
        for &offset_mm in offsets_mm {
            for &velocity_m_per_s in velocities_m_per_s {
                turns.extend((0..repetitions).map(|repetition| Turn {
                    offset_mm,
                    velocity_m_per_s,
                    repetition,
                    every: 1,
                }));
            }
        }
        Self { turns, is_confirmed: false }
    }

    /// One turn at each of `steps`, an offset with the step from location to location.
    pub fn coarse(steps: &[(f64, u32)], velocity_m_per_s: f64) -> Self {
        let turn = |&(offset_mm, every)| Turn { offset_mm, velocity_m_per_s, repetition: 0, every };
        Self { turns: steps.iter().map(turn).collect(), is_confirmed: false }
    }

    /// What tapline makes by default: one turn at the belt edge, then again what stands out.
    pub fn adaptive(velocity_m_per_s: f64) -> Self {
        Self::coarse(&[(0.0, 1)], velocity_m_per_s).confirmed()
    }

    /// The same turns, then again what stands out.
    pub fn confirmed(self) -> Self {
        Self { is_confirmed: true, ..self }
    }

    /// Whether `tap` is one of them.
    pub fn has(&self, tap: &PlannedTap) -> bool {
        let is_near = |value: Option<f64>, other: f64| value.is_some_and(|value| (value - other).abs() < 1e-6);
        self.turns.iter().any(|turn| {
            is_near(tap.id.offset_mm(), turn.offset_mm)
                && is_near(tap.id.velocity_m_per_s(), turn.velocity_m_per_s)
                && tap.id.repetition == turn.repetition
                && tap.id.location.is_multiple_of(turn.every)
        })
    }

    /// The shape of a set that has all of them, on every location, with room for second readings.
    pub fn shape(&self, other: &ScanShape) -> ScanShape {
        let mut shape =
            ScanShape { offsets_mm: Vec::new(), velocities_m_per_s: Vec::new(), repetitions: 0, ..other.clone() };
        let add = |values: &mut Vec<f64>, value: f64| {
            if values.iter().all(|other| (other - value).abs() > 1e-6) {
                values.push(value);
            }
        };
        for turn in &self.turns {
            add(&mut shape.offsets_mm, turn.offset_mm);
            add(&mut shape.velocities_m_per_s, turn.velocity_m_per_s);
            shape.repetitions = shape.repetitions.max(turn.repetition + 1);
        }
        shape.repetitions *= if self.is_confirmed { 2 } else { 1 };
        shape
    }
}

/// Times of a rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// From tap to tap.
    pub tap_s: f64,
    /// In addition, to another offset.
    pub offset_s: f64,
}

impl Default for Times {
    fn default() -> Self {
        Self { tap_s: 0.4, offset_s: 3.0 }
    }
}

impl Times {
    /// Time of the scan of `tyre`, whose two shoulders are tapped at once.
    pub fn of(self, plan: &Plan, tyre: Serial) -> f64 {
        let of_scan = |scan: &Scan| {
            let taps: Vec<&PlannedTap> = scan.taps.iter().map(|&row| &plan.taps()[row as usize]).collect();
            let moves = taps.windows(2).filter(|pair| pair[0].id.offset_mm() != pair[1].id.offset_mm()).count();
            taps.len() as f64 * self.tap_s + moves as f64 * self.offset_s
        };
        let scans = plan.scans().iter().filter(|scan| scan.tyre == tyre);
        scans.map(of_scan).max_by(f64::total_cmp).unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches turns that are lost or doubled, a step that is not kept to, and a shape without room for second readings.
    #[test]
    fn taps_are_those_of_the_turns() {
        let tyre = tapline_plate::Tyre { serial: Serial::new("T").unwrap(), cracks: Vec::new() };
        let shape = ScanShape { repetitions: 2, velocities_m_per_s: vec![1.2, 1.85], ..ScanShape::default() };
        let plan = shape.plan(&[tyre]).unwrap();
        let count = |taps: &ScanTaps| plan.taps().iter().filter(|tap| taps.has(tap)).count();
        assert_eq!(count(&ScanTaps::full(&shape.offsets_mm, &[1.2, 1.85], 2)), plan.taps().len());
        assert_eq!(count(&ScanTaps::full(&[5.0], &[1.2], 1)), 200);
        assert_eq!(count(&ScanTaps::adaptive(1.85)), 2 * 100);
        let coarse = ScanTaps::coarse(&[(0.0, 2), (10.0, 3)], 1.85).confirmed();
        assert_eq!(count(&coarse), 2 * (50 + 34));
        let of = coarse.shape(&shape);
        assert_eq!((of.offsets_mm, of.velocities_m_per_s, of.repetitions), (vec![0.0, 10.0], vec![1.85], 2));
    }
}
