//! The velocities that a plan means, told from those that some of its taps were made with.
//!
//! A tap set lists the velocity of each tap. Where it lists what was asked for, the plan means exactly that; where it
//! lists what was measured, or a few taps strike out, it means the velocity that many taps have, or lie around.

/// A velocity of which there is less than this part of the most frequent one is not meant.
const SHARE: f64 = 0.25;

/// Taps of one velocity from which on velocities are what was asked for; fewer are measured values that happen to agree.
const FREQUENT: usize = 4;

/// Measured velocities this much above the next lower one are meant to be others.
const GAP: f64 = 1.05;

/// Farthest that a tap may strike out, as a factor; farther it is a velocity of its own, however rare.
const REACH: f64 = 1.3;

/// The velocities that a plan means, ascending.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Nominals(Vec<f64>);

impl Nominals {
    /// What is meant by `velocities`, in m/s.
    pub(crate) fn of(velocities: impl Iterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = velocities.filter(|v| v.is_finite() && *v > 0.0).collect();
        sorted.sort_by(f64::total_cmp);
        let same: Vec<&[f64]> = sorted.chunk_by(|a, b| a.total_cmp(b).is_eq()).collect();
        let is_asked_for = same.iter().any(|group| group.len() >= FREQUENT);
        let groups = if is_asked_for { same } else { sorted.chunk_by(|below, v| *v <= GAP * below).collect() };
        let most = groups.iter().map(|group| group.len()).max().unwrap_or(0);
        #[expect(clippy::cast_precision_loss, reason = "counts of taps")]
        let is_meant = |group: &&[f64]| group.len() as f64 >= SHARE * most as f64;
        Self(groups.into_iter().filter(is_meant).map(|group| group[group.len() / 2]).collect())
    }

    /// What is meant by `velocity`: the nearest that is, or itself when none is near.
    pub(crate) fn nearest(&self, velocity: f64) -> f64 {
        let distance = |nominal: &f64| (velocity / nominal).ln().abs();
        let nearest = self.0.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.filter(|nominal| distance(nominal) < REACH.ln()).unwrap_or(velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As text, in which numbers may be compared.
    fn nominals(groups: &[(f64, usize)]) -> String {
        let found = Nominals::of(groups.iter().flat_map(|&(v, count)| std::iter::repeat_n(v, count)));
        format!("{:?}", found.0)
    }

    /// Catches velocities that lie close and are merged, one that a few taps strike out with and is meant, and one that
    /// is rare for good reason and taken for another.
    #[test]
    fn what_is_asked_for_is_meant() {
        assert_eq!(nominals(&[(1.8, 100), (1.85, 100), (1.2, 90)]), "[1.2, 1.8, 1.85]");
        assert_eq!(nominals(&[(1.85, 90), (2.03, 10), (1.7, 3)]), "[1.85]");
        let of = Nominals(vec![1.2, 1.85]);
        for (velocity, meant) in [(2.03, 1.85), (1.7, 1.85), (1.25, 1.2), (5.0, 5.0), (0.5, 0.5)] {
            assert!((of.nearest(velocity) - meant).abs() < 1e-15, "{velocity}");
        }
        assert_eq!(nominals(&[(f64::NAN, 9), (-1.0, 9), (0.0, 9)]), "[]");
        assert!((Nominals::default().nearest(1.85) - 1.85).abs() < 1e-15);
    }

    /// Catches measured velocities of which each is its own nominal, and two that are meant taken for one.
    #[test]
    fn what_is_measured_lies_around_what_is_meant() {
        let around = |nominal: f64, count: u32| {
            (0..count).map(move |k| nominal * (1.0 + 0.02 * (f64::from(k * 37 % 101) / 50.0 - 1.0)))
        };
        let of = Nominals::of(around(1.2, 60).chain(around(1.85, 60)).chain([2.1, 2.11]));
        assert_eq!(of.0.len(), 2, "{of:?}");
        assert!((of.0[0] / 1.2 - 1.0).abs() < 0.005 && (of.0[1] / 1.85 - 1.0).abs() < 0.005, "{of:?}");
        assert!((of.nearest(2.1) - of.0[1]).abs() < 1e-15);
    }
}
