//! The greatest x'b / sqrt(x'Mx) over all x that are nowhere below 0.

use crate::evidence::scatter::{Square, root_of_rest};
use crate::evidence::{Vector, WIDTH, dot};

/// How often a bound is lowered along each discriminator.
const BOUND_SWEEPS: usize = 2;

/// Most entries that are set free; as many as there are discriminators are usual at most.
const ROUNDS_MAX: usize = 4 * WIDTH;

/// A matrix M and a vector b, both 0 where a discriminator is not used.
#[derive(Debug, Clone, Copy)]
pub(super) struct Orthant<'a> {
    pub matrix: &'a Square,
    pub inverse: &'a Square,
    /// 1 over the diagonal of the inverse, 0 where that is 0.
    pub steps: &'a Vector,
    pub used: &'a [usize],
    pub b: Vector,
}

impl Orthant<'_> {
    /// The greatest value; NaN where nothing is used.
    pub(super) fn greatest(&self) -> f64 {
        let mut most = f64::NAN;
        for &d in self.used {
            let alone = self.b[d] / self.matrix[d][d].sqrt();
            most = if most >= alone { most } else { alone };
        }
        // At the least of x'Mx - 2 x'b both terms are the same but for the 2.
        if most > 0.0 { dot(&self.descend(), &self.b).sqrt() } else { most }
    }

    /// Whether it is plain that the square of the greatest value is below `limit`.
    ///
    /// That square is the least of y'M^-1 y over all y that are nowhere below b: the dual of the greatest over x. Any such y is a bound,
    /// and a few steps, each along one discriminator, lead to one that is near.
    pub(super) fn is_bounded_by(&self, limit: f64) -> bool {
        // All that follows runs over whole vectors, so that the compiler can use registers.
        let mut y = self.b.map(|b| if b > 0.0 { b } else { 0.0 });
        let mut slope = [0.0; WIDTH];
        for (column, y) in self.inverse.iter().zip(&y) {
            (0..WIDTH).for_each(|d| slope[d] += column[d] * y);
        }
        for _ in 0..BOUND_SWEEPS {
            if dot(&y, &slope) < limit {
                return true;
            }
            for k in 0..WIDTH {
                let free = y[k] - slope[k] * self.steps[k];
                let step = if free < self.b[k] { self.b[k] } else { free } - y[k];
                y[k] += step;
                (0..WIDTH).for_each(|d| slope[d] += self.inverse[k][d] * step);
            }
        }
        dot(&y, &slope) < limit
    }

    /// The least of x'Mx - 2 x'b over x >= 0, which is where the value is greatest: after a first guess, the entries above 0 are found
    /// one by one (Lawson and Hanson 1974). All 0 where no entry of b is above 0.
    pub(super) fn descend(&self) -> Vector {
        let mut x = [0.0; WIDTH];
        let mut is_free = self.b.map(|b| b > 0.0);
        self.settle(&mut is_free, &mut x);
        for _ in 0..ROUNDS_MAX {
            let slope = |d: usize| (self.b[d] - dot(&self.matrix[d], &x)) / self.matrix[d][d].sqrt();
            let held = self.used.iter().filter(|&&d| !is_free[d]).map(|&d| (d, slope(d)));
            let Some((steepest, _)) = held.filter(|(_, slope)| *slope > 1e-9).max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            is_free[steepest] = true;
            self.settle(&mut is_free, &mut x);
        }
        x
    }

    /// Moves `x` to the least over the entries that are free, and holds at 0 those that would fall below it.
    fn settle(&self, is_free: &mut [bool; WIDTH], x: &mut Vector) {
        for _ in 0..WIDTH {
            let best = self.solved(is_free);
            let falls = |d: &usize| is_free[*d] && best[*d] <= 0.0;
            // At 0 already: it stays there, and none of the others moves.
            let step = |d: usize| if x[d] > 0.0 { x[d] / (x[d] - best[d]) } else { 0.0 };
            let Some(step) = self.used.iter().copied().filter(falls).map(step).min_by(f64::total_cmp) else {
                *x = best;
                return;
            };
            for &d in self.used.iter().filter(|&&d| is_free[d]) {
                x[d] += step * (best[d] - x[d]);
            }
            for &d in self.used {
                if is_free[d] && best[d] <= 0.0 && x[d] <= 1e-12 * best[d].abs() {
                    (is_free[d], x[d]) = (false, 0.0);
                }
            }
        }
    }

    /// M^-1 b of those that are free, 0 of the others.
    fn solved(&self, is_free: &[bool; WIDTH]) -> Vector {
        let (mut factor, mut x, mut count) = ([[0.0; WIDTH]; WIDTH], [0.0; WIDTH], 0);
        let mut free = [0; WIDTH];
        for &d in self.used.iter().filter(|&&d| is_free[d]) {
            (free[count], count) = (d, count + 1);
        }
        let free = &free[..count];
        // By the factor of Cholesky, forwards and back.
        for (i, &of_i) in free.iter().enumerate() {
            for (j, &of_j) in free[..=i].iter().enumerate() {
                let before: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
                let rest = self.matrix[of_i][of_j] - before;
                factor[i][j] = if i > j { rest / factor[j][j] } else { root_of_rest(rest, self.matrix[of_i][of_i]) };
            }
            let before: f64 = (0..i).map(|k| factor[i][k] * x[k]).sum();
            x[i] = (self.b[of_i] - before) / factor[i][i];
        }
        for i in (0..count).rev() {
            let behind: f64 = (i + 1..count).map(|k| factor[k][i] * x[k]).sum();
            x[i] = (x[i] - behind) / factor[i][i];
        }
        let mut solved = [0.0; WIDTH];
        free.iter().zip(x).for_each(|(&d, x)| solved[d] = x);
        solved
    }
}
