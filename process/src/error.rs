//! Errors of a configuration. Bad data are not an error.

/// Why an extractor cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting is not a number or out of its bounds.
    #[error("{table}.{key} = {value}{unit}: must be finite and {bound}")]
    OutOfBounds {
        /// Table of the configuration.
        table: &'static str,
        /// Key in that table.
        key: &'static str,
        /// Value given.
        value: f64,
        /// Its unit with a space before it, or nothing.
        unit: &'static str,
        /// What it must be.
        bound: &'static str,
    },
    /// A band ends at or below its beginning, or PR's band reaches beyond its reference.
    #[error("process.{key} = {value} Hz: must be {relation} process.{bound_key} = {bound} Hz")]
    Band {
        /// Key of the edge.
        key: &'static str,
        /// Edge given, Hz.
        value: f64,
        /// Where it must lie.
        relation: &'static str,
        /// Key of the other edge.
        bound_key: &'static str,
        /// The other edge, Hz.
        bound: f64,
    },
}
