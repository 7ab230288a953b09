//! What can be wrong with a configuration. Bad data is not an error.

/// Why an extractor cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A frequency is not a number or lies below what it may be.
    #[error("process.{key} = {value} Hz: must be finite and {bound}")]
    Frequency {
        /// Key in the configuration.
        key: &'static str,
        /// Value given, Hz.
        value: f64,
        /// What it must be.
        bound: &'static str,
    },
    /// A time is not a number or below what it may be.
    #[error("process.{key} = {value} s: must be finite and {bound}")]
    Time {
        /// Key in the configuration.
        key: &'static str,
        /// Value given, s.
        value: f64,
        /// What it must be.
        bound: &'static str,
    },
    /// A band ends at or below its beginning.
    #[error("process.{key} = {value} Hz: must be above process.{bound_key} = {bound} Hz")]
    EmptyBand {
        /// Key of the band's upper edge.
        key: &'static str,
        /// Upper edge given, Hz.
        value: f64,
        /// Key of the band's lower edge.
        bound_key: &'static str,
        /// Lower edge given, Hz.
        bound: f64,
    },
    /// A threshold of a quality flag is not a number or out of its bounds.
    #[error("process.quality.{key} = {value}: must be finite and {bound}")]
    Threshold {
        /// Key in the configuration.
        key: &'static str,
        /// Value given.
        value: f64,
        /// What it must be.
        bound: &'static str,
    },
}
