//! How far a vector of scores stands out in the direction of damage.
//!
//! Damage raises some discriminators and does not change others, and it is not known beforehand which. With z the scores, S their
//! covariance on sound places and w the weights of a sum, the evidence is the greatest w'z / sqrt(w'Sw) over two sets of w:
//!
//! - w >= 0 (Roy's union-intersection principle, 1953): the scores as they are. A discriminator that moves the wrong way does not
//!   count against the others.
//! - Sw >= 0 (the likelihood ratio of a shift that is nowhere below 0; Kudo 1963): each score against what the others predict for a
//!   sound place. A crack in a stiff place leaves some scores where they are that should have fallen.
//!
//! In both, S removes the joint change of scores at a place that is only softer than others.

mod covariance;
mod normals;
mod scatter;

use std::sync::LazyLock;

use tapline_wire::Discriminator;

pub(crate) use normals::{Normals, STRATIFIED};
pub(crate) use scatter::Scatter;

/// One score a discriminator, in the order in which they are configured; NaN where it is absent, and beyond the last one.
pub(crate) type Vector = [f64; WIDTH];

/// The scores of a place of which nothing is known.
pub(crate) const ABSENT: Vector = [f64::NAN; WIDTH];

/// The scores of many places, or values that scores are made of, `[discriminator][place]`: in single precision and this order they are
/// fast to compute.
pub(crate) type Columns = [Vec<f32>; WIDTH];

/// Most discriminators.
pub(crate) const WIDTH: usize = Discriminator::COUNT;

/// 1 over the root of a count, NaN for 0; in a table, because sums over few places are needed by the million.
static INVERSE_ROOTS: LazyLock<[f64; 64]> =
    LazyLock::new(|| std::array::from_fn(|count| if count > 0 { 1.0 / (count as f64).sqrt() } else { f64::NAN }));

/// What rounding may take from a bound, as a part of its square.
const ROUNDING: f64 = 1e-9;

/// Whether anything is known of a place.
pub(crate) fn has_value(scores: &Vector) -> bool {
    scores.iter().any(|score| score.is_finite())
}

/// The sum of scores, of each discriminator by itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sum {
    sum: [f64; WIDTH],
    count: [u32; WIDTH],
}

impl Sum {
    /// Adds what `scores` have.
    pub(crate) fn add(&mut self, scores: &Vector) {
        // Without branches, so that the compiler can use vectors.
        for (d, score) in scores.iter().enumerate() {
            self.sum[d] += if score.is_finite() { *score } else { 0.0 };
            self.count[d] += u32::from(score.is_finite());
        }
    }

    /// How many have been added of discriminator number `d`.
    pub(crate) fn count(&self, d: usize) -> u32 {
        self.count[d]
    }

    /// Their mean; NaN of none.
    pub(crate) fn mean(&self) -> Vector {
        std::array::from_fn(|d| self.sum[d] / f64::from(self.count[d]))
    }

    /// The sum over the root of how many there are, which scatters as one of them where they are independent.
    pub(crate) fn over_root(&self) -> Vector {
        std::array::from_fn(|d| match INVERSE_ROOTS.get(self.count[d] as usize) {
            Some(inverse) => self.sum[d] * inverse,
            None => self.sum[d] / f64::from(self.count[d]).sqrt(),
        })
    }
}

/// The sum of the products, in four lanes, so that the compiler can use vectors.
fn dot(a: &Vector, b: &Vector) -> f64 {
    let mut lanes = [0.0; 4];
    a.iter().zip(b).enumerate().for_each(|(d, (a, b))| lanes[d % 4] += a * b);
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])
}
