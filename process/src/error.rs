//! Errors of a configuration. Bad data are not an error.

/// Why an extractor cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// A setting is not a number or out of its bounds; `unit` is empty or begins with a space.
    #[error("{table}.{key} = {value}{unit}: must be finite and {bound}")]
    OutOfBounds { table: &'static str, key: &'static str, value: f64, unit: &'static str, bound: &'static str },
    /// A band ends at or below its beginning, or PR's band reaches beyond its reference.
    #[error("process.{key} = {value} Hz: must be {relation} process.{bound_key} = {bound} Hz")]
    Band { key: &'static str, value: f64, relation: &'static str, bound_key: &'static str, bound: f64 },
}
