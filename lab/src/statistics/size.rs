//! Sizes of targets on the log scale, standardised so that a fit is well conditioned.

use super::Refusal;

/// ln(size) of the targets, and the same less its mean over its standard deviation.
pub(super) struct LogSizes {
    /// ln(size).
    pub ln: Vec<f64>,
    /// Standardised ln(size); all 0 where all sizes are the same.
    pub standard: Vec<f64>,
    /// Mean of ln(size).
    pub mean: f64,
    /// Standard deviation of ln(size), by the count; 1 where it would be 0.
    pub sd: f64,
}

impl LogSizes {
    pub(super) fn new(sizes: &[f64]) -> Result<Self, Refusal> {
        for (index, &value) in sizes.iter().enumerate() {
            if !(value.is_finite() && value > 0.0) {
                return Err(Refusal::Size(index, value));
            }
        }
        let ln: Vec<f64> = sizes.iter().map(|size| size.ln()).collect();
        let count = ln.len() as f64;
        let mean = ln.iter().sum::<f64>() / count;
        let variance = ln.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count;
        let sd = if variance > 0.0 { variance.sqrt() } else { 1.0 };
        let standard = ln.iter().map(|x| (x - mean) / sd).collect();
        Ok(Self { ln, standard, mean, sd })
    }
}

/// How far beyond the sizes looked at, as a factor, a size may lie to be an estimate at all.
const BEYOND: f64 = 10.0;

/// The size of a logarithm, if it lies among `sizes` looked at, or up to ten times beyond them.
pub(super) fn size_near(ln_size: f64, sizes: (f64, f64)) -> Option<f64> {
    size_of(ln_size).filter(|&size| size >= sizes.0 / BEYOND && size <= sizes.1 * BEYOND)
}

/// The size of a logarithm, if it is one: neither 0 nor infinite.
pub(super) fn size_of(ln_size: f64) -> Option<f64> {
    Some(ln_size.exp()).filter(|size| size.is_normal())
}
