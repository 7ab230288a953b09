//! The upper confidence bound of a size, from its likelihood.

/// The standard normal value below which 95 % lie (scipy.stats.norm.ppf): of one-sided bounds.
pub(super) const Z_95: f64 = 1.644_853_626_951_472_2;

/// Twice the logarithm of likelihood that a one-sided 95 % bound may lose: the 90 % point of chi-squared with one
/// degree.
const DEVIANCE_95: f64 = Z_95 * Z_95;

/// Doublings of the first guess, and halvings after, by which a bound is searched for.
const DOUBLINGS: usize = 40;
const HALVINGS: usize = 52;

/// Whether log likelihood `value` is among those that the `best` does not exclude at 95 %, one-sided.
pub(super) fn is_admitted(best: f64, value: f64) -> bool {
    2.0 * (best - value) <= DEVIANCE_95
}

/// Greatest ln(size) at or above `from` that the likelihood does not exclude. `through` is the best log likelihood of the
/// fits that give the quantity this size, and `sd` the expected distance of the bound.
///
/// Log likelihoods here are concave, and the size is monotone along every line through their parameters while the slope is
/// above 0: the sizes not excluded are one interval about the best, whose end doubling and halving find. Do not call it if
/// the flat fit is not excluded: then there is no end. `None` if the end is too far off, or a fit does not converge.
pub(super) fn upper_bound(from: f64, sd: f64, best: f64, through: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let is_within = |ln_size| through(ln_size).map(|value| is_admitted(best, value));
    let (mut low, mut step) = (from, sd);
    let mut high = None;
    for _ in 0..DOUBLINGS {
        if is_within(from + step)? {
            low = from + step;
            step *= 2.0;
        } else {
            high = Some(from + step);
            break;
        }
    }
    let mut high = high?;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if is_within(middle)? { low = middle } else { high = middle }
    }
    Some(0.5 * (low + high))
}
