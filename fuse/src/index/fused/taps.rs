//! The scores of taps, and what the taps of a place say together.

use crate::evidence::{ABSENT, Sum, Vector};
use crate::index::fused::Fused;
use crate::index::fused::level::{Level, Levels};
use crate::index::fused::offset_scale::OffsetScale;
use crate::shoulder::{Shoulder, Turn};

/// Largest magnitude of the score of one discriminator of a tap.
const SCORE_MAX: f64 = 6.0;

/// Largest evidence of a single tap that no other of its place or its neighbours bears out: one rogue tap is no damage.
const TAP_EVIDENCE_MAX: f64 = 4.0;

/// The scores of every tap of a shoulder, `[turn][place]`.
pub(super) type Taps = Vec<Vec<Vector>>;

/// Mean scores of the taps of each place at each offset, and how many taps, `[offset][place][discriminator]`.
pub(super) type TapMeans = Vec<Vec<Means>>;

/// Mean and count of each discriminator.
type Means = [(f64, u32); ABSENT.len()];

impl Fused {
    /// Scores of the taps of a turn, by place.
    pub(super) fn turn_scores(&self, turn: &Turn, levels: &[Level]) -> Vec<Vector> {
        let mut scores = vec![ABSENT; turn.values.len()];
        for (d, scale) in self.scales[turn.condition].iter().enumerate() {
            let Some(scale) = scale else { continue };
            for (scores, y) in scores.iter_mut().zip(self.above(turn, d, levels[d])) {
                scores[d] = y.map_or(f64::NAN, |y| (y / scale.sigma).clamp(-SCORE_MAX, SCORE_MAX));
            }
        }
        scores
    }

    /// The scores of the taps of each shoulder.
    pub(super) fn taps(&self, shoulders: &[&Shoulder], levels: &[Levels]) -> Vec<Taps> {
        let of_turns = |(shoulder, levels): (&&Shoulder, &Levels)| {
            shoulder.turns.iter().zip(levels).map(|(turn, levels)| self.turn_scores(turn, levels)).collect()
        };
        shoulders.iter().zip(levels).map(of_turns).collect()
    }

    /// Mean score of each discriminator over the `taps` of a place, `[place][discriminator]`.
    pub(super) fn by_discriminator(&self, shoulder: &Shoulder, taps: &Taps) -> Vec<Vec<f64>> {
        let mut sums = vec![Sum::default(); shoulder.place_count()];
        for turn in taps {
            sums.iter_mut().zip(turn).for_each(|(sum, scores)| sum.add(scores));
        }
        sums.into_iter().map(|sum| sum.mean()[..self.setup.discriminators.len()].to_vec()).collect()
    }

    /// The `taps` of each shoulder, of which the one of a place that stands out most counts no more than the next one bears
    /// out: another of that place, or one of a neighbour.
    pub(super) fn borne_out(&self, shoulders: &[&Shoulder], taps: &[Taps]) -> Vec<Taps> {
        shoulders.iter().zip(taps).map(|(shoulder, taps)| self.borne_out_on(shoulder, taps.clone())).collect()
    }

    fn borne_out_on(&self, shoulder: &Shoulder, mut taps: Taps) -> Taps {
        let stands_out = |scores: &Vector| self.tap_scatter.evidence_above(TAP_EVIDENCE_MAX, scores).unwrap_or(0.0);
        let evidence: Vec<Vec<f64>> = taps.iter().map(|turn| turn.iter().map(stands_out).collect()).collect();
        for place in 0..shoulder.place_count() {
            let of_place = evidence.iter().enumerate().map(|(turn, evidence)| (turn, evidence[place]));
            let Some((turn_of_most, most)) = of_place.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            let near = shoulder.ring.with_neighbours(place);
            let others = near.flat_map(|near| evidence.iter().enumerate().map(move |(turn, e)| (turn, near, e[near])));
            let others = others.filter(|&(turn, near, _)| (turn, near) != (turn_of_most, place)).map(|(.., e)| e);
            let next = others.fold(TAP_EVIDENCE_MAX, |most, e| if e > most { e } else { most });
            if most > next {
                taps[turn_of_most][place].iter_mut().for_each(|score| *score *= next / most);
            }
        }
        taps
    }

    /// The means of the `taps` of each place at each offset, by shoulder.
    pub(super) fn means(&self, shoulders: &[&Shoulder], taps: &[Taps]) -> Vec<TapMeans> {
        shoulders.iter().zip(taps).map(|(shoulder, taps)| self.means_on(shoulder, taps)).collect()
    }

    fn means_on(&self, shoulder: &Shoulder, taps: &Taps) -> TapMeans {
        let mut sums = vec![vec![Sum::default(); shoulder.place_count()]; self.setup.offset_count];
        for (turn, scores) in shoulder.turns.iter().zip(taps) {
            let sums = &mut sums[self.setup.offset_of[turn.condition]];
            sums.iter_mut().zip(scores).for_each(|(sum, scores)| sum.add(scores));
        }
        let of_offset = |sums: Vec<Sum>| {
            sums.into_iter().map(|sum| std::array::from_fn(|d| (sum.mean()[d], sum.count(d)))).collect()
        };
        sums.into_iter().map(of_offset).collect()
    }

    /// `[offset][place]`, as [`crate::index::Scores::by_offset`].
    pub(super) fn by_offset(&self, means: &TapMeans) -> Vec<Vec<Vector>> {
        let of = |(means, scales): (&Vec<Means>, &Vec<Option<OffsetScale>>)| {
            let score = |means: &Means| {
                let mut scores = ABSENT;
                for ((score, &(mean, count)), scale) in scores.iter_mut().zip(means).zip(scales) {
                    *score = scale.map_or(f64::NAN, |scale| scale.score(mean, count));
                }
                scores
            };
            means.iter().map(score).collect()
        };
        means.iter().zip(&self.offsets).map(of).collect()
    }
}
