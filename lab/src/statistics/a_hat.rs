//! Probability of detection from the strength of the response: a line over ln(size).
//!
//! Model (MIL-HDBK-1823A, Appendix G): y = intercept + slope ln(size) + scatter e with y the response and e standard
//! normal. A target is found if y exceeds the decision threshold, so that POD = Phi((ln(size) - mu)/sigma) with mu =
//! (threshold - intercept)/slope and sigma = scatter/slope.
//!
//! The line of maximum likelihood is that of least squares. The scatter is that of maximum likelihood too: the root of
//! the mean square over n, not over n - 2. The handbook also censors responses, in noise and in saturation; an index
//! that is read has neither.

use statrs::distribution::{ContinuousCDF as _, Normal};
use tapline_draw::stats::extent;

use super::Refusal;
use super::bound::{Z_95, is_admitted, upper_bound};
use super::newton::variance;
use super::size::{LogSizes, size_near, size_of};

/// Targets below which MIL-HDBK-1823A does not trust responses.
pub const A_HAT_TARGETS: usize = 40;

/// Fewest responses from which a line and a scatter are estimated.
const RESPONSES_MIN: usize = 3;

/// Residuals at or below this part of the responses' own spread are rounding.
const ROUNDING: f64 = 1e-12;

/// What the square of a standard normal value exceeds in one of 100 cases (scipy.stats.chi2.ppf(0.99, 1)).
const CHI2_99: f64 = 6.634_896_601_021_213;

/// The standard normal value below which 90 % lie (scipy.stats.norm.ppf).
const Z_90: f64 = 1.281_551_565_544_600_4;

/// A fitted line of responses. Sizes are in the unit of the sizes given, responses in theirs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct AHat {
    /// Mean response at size 1.
    pub intercept: f64,
    /// Response gained per ln(size); above 0.
    pub slope: f64,
    /// Standard deviation of the response about the line, of maximum likelihood.
    pub scatter: f64,
    /// Covariance of intercept, slope and scatter: the inverse of the information.
    pub covariance: [[f64; 3]; 3],
    /// ln(a50).
    pub mu: f64,
    /// Width of the curve in ln(size).
    pub sigma: f64,
    /// Size found half the time; `None` where the line puts it ten times beyond the sizes looked at, which is no
    /// estimate.
    pub a50: Option<f64>,
    /// Size found nine times in ten; `None` likewise.
    pub a90: Option<f64>,
    /// Upper one-sided 95 % bound of a90 by likelihood ratio. Of 100 000 simulated studies of 60 targets it held in 93 %,
    /// and the handbook's, by the delta method, in 90 %. `None` where the data admit at this level that larger cracks do
    /// not answer more strongly: then no size is large enough.
    pub a90_95_likelihood: Option<f64>,
    /// Whether the responses scatter equally at all sizes, as the model has it: n r² with r the correlation of squared residuals with
    /// ln(size) stays below what it exceeds in one of 100 studies (Koenker, J. Econometrics 17 (1981) 107).
    pub has_even_scatter: bool,
    /// Targets looked at; [`A_HAT_TARGETS`] are wanted.
    pub targets: usize,
}

impl AHat {
    /// Probability that a crack of `size` is found, 0 to 1; `None` for a size that has no logarithm.
    pub fn pod(&self, size: f64) -> Option<f64> {
        let x = Some(size.ln()).filter(|x| x.is_finite())?;
        Some(upper_tail((self.mu - x) / self.sigma))
    }

    /// Lower one-sided 95 % bound of [`pod`](Self::pod), by the delta method on the normal deviate.
    pub fn pod_lower_95(&self, size: f64) -> Option<f64> {
        let x = Some(size.ln()).filter(|x| x.is_finite())?;
        // (intercept + slope x - threshold)/scatter
        let deviate = (x - self.mu) / self.sigma;
        let sd = variance(&self.covariance, &[1.0, x, -deviate].map(|gradient| gradient / self.scatter)).sqrt();
        Some(upper_tail(Z_95 * sd - deviate))
    }
}

/// Fits a line to the `responses` of targets of `sizes`, above 0, of which those above `threshold` are finds.
///
/// # Errors
/// [`Refusal::Lengths`], [`Refusal::Size`], [`Refusal::OutOfRange`] of the threshold, [`Refusal::Response`],
/// [`Refusal::TooFew`] responses (3), [`Refusal::OneSize`], [`Refusal::NoScatter`], [`Refusal::NotRising`].
pub fn a_hat(sizes: &[f64], responses: &[f64], threshold: f64) -> Result<AHat, Refusal> {
    if sizes.len() != responses.len() {
        return Err(Refusal::Lengths("sizes", sizes.len(), "responses", responses.len()));
    }
    let log = LogSizes::new(sizes)?;
    if !threshold.is_finite() {
        return Err(Refusal::OutOfRange("threshold", threshold, f64::MIN, f64::MAX));
    }
    if let Some(index) = responses.iter().position(|y| !y.is_finite()) {
        return Err(Refusal::Response(index, responses[index]));
    }
    let looked_at = extent(sizes.iter().copied()).filter(|_| sizes.len() >= RESPONSES_MIN);
    let looked_at = looked_at.ok_or(Refusal::TooFew("responses", sizes.len(), RESPONSES_MIN))?;
    if looked_at.0.ln() >= looked_at.1.ln() {
        return Err(Refusal::OneSize(looked_at.0));
    }
    let n = responses.len() as f64;
    let mean =
        |of: &dyn Fn(f64, f64) -> f64| log.standard.iter().zip(responses).map(|(&u, &y)| of(u, y)).sum::<f64>() / n;
    let level = mean(&|_, y| y);
    let spread = mean(&|_, y| (y - level).powi(2)).sqrt();
    if !(spread.is_finite() && spread > ROUNDING * level.abs()) {
        return Err(Refusal::NoScatter("responses"));
    }
    // The standardised ln(size) have mean 0 and mean square 1.
    let per_u = mean(&|u, y| u * (y - level));
    let scatter = mean(&|u, y| (y - level - per_u * u).powi(2)).sqrt();
    if !(scatter.is_finite() && scatter > ROUNDING * spread) {
        return Err(Refusal::NoScatter("responses about their line"));
    }
    let squares: Vec<f64> =
        log.standard.iter().zip(responses).map(|(&u, &y)| (y - level - per_u * u).powi(2)).collect();
    let of_squares = |of: &dyn Fn(f64, f64) -> f64| {
        log.standard.iter().zip(&squares).map(|(&u, &square)| of(u, square - scatter.powi(2))).sum::<f64>() / n
    };
    let has_even_scatter =
        n * of_squares(&|u, excess| u * excess).powi(2) <= CHI2_99 * of_squares(&|_, excess| excess.powi(2));
    let slope = per_u / log.sd;
    if slope <= 0.0 {
        return Err(Refusal::NotRising(slope));
    }
    let intercept = level - slope * log.mean;
    let (of_level, of_slope) = (scatter.powi(2) / n, (scatter / log.sd).powi(2) / n);
    let of_both = -of_slope * log.mean;
    let covariance =
        [[of_level - of_both * log.mean, of_both, 0.0], [of_both, of_slope, 0.0], [0.0, 0.0, 0.5 * of_level]];
    let (mu, sigma) = ((threshold - intercept) / slope, scatter / slope);
    let ln_a90 = mu + Z_90 * sigma;
    let sd = variance(&covariance, &[-1.0 / slope, -ln_a90 / slope, Z_90 / slope]).sqrt();
    // Of normal residuals with this root mean square, but for n ln(2 pi)/2.
    let log_likelihood = |scatter: f64, rms: f64| -n * (scatter.ln() + 0.5 * (rms / scatter).powi(2));
    let best = log_likelihood(scatter, scatter);
    // A line with a90 at a size lies Z_90 t above the threshold there, with t its own scatter. Where the fitted line lies
    // h above the threshold, the mean square about the best of those with a given t is scatter^2 + (h - Z_90 t)^2/l^2 with
    // l^2 = 1 + u^2. Its likelihood is greatest at the positive root of t^2 + Z_90 h/l^2 t = scatter^2 + h^2/l^2.
    let through = |ln_size: f64| {
        let u = (ln_size - log.mean) / log.sd;
        let l = u.hypot(1.0);
        let h_over_l = (level + per_u * u - threshold) / l;
        let half = 0.5 * Z_90 * h_over_l / l;
        let t = half.hypot(scatter.hypot(h_over_l)) - half;
        Some(log_likelihood(t, scatter.hypot(h_over_l - Z_90 * t / l)))
    };
    let is_rising = !is_admitted(best, log_likelihood(spread, spread));
    Ok(AHat {
        intercept,
        slope,
        scatter,
        covariance,
        mu,
        sigma,
        a50: size_near(mu, looked_at),
        a90: size_near(ln_a90, looked_at),
        a90_95_likelihood: if is_rising { upper_bound(ln_a90, sd, best, through).and_then(size_of) } else { None },
        has_even_scatter,
        targets: sizes.len(),
    })
}

/// The probability that a standard normal value exceeds `z`.
fn upper_tail(z: f64) -> f64 {
    Normal::standard().sf(z)
}
