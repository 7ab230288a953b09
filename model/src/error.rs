//! Errors of scenes, tables and simulated rigs.

/// Why a model gives no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// A quantity is outside the bounds in which the formulas are meaningful.
    #[error("{name} is {value}; it must lie in {low} to {high}")]
    OutOfRange { name: &'static str, value: f64, low: f64, high: f64 },
    /// The dissertation has no such table of computed contact quantities.
    #[error("there is no table {number}; the tables are 4, 5, 6, 8, 9, 10 and 11")]
    NoTable { number: u8 },
    /// The impact is too stiff to integrate in the allowed number of steps.
    #[error("integration of the impact stopped after {steps} steps at {reached_s} s of {wanted_s} s")]
    TooStiff { steps: usize, reached_s: f64, wanted_s: f64 },
    /// A quantity of a simulated tyre's crack is out of its bounds; cracks count from 1.
    #[error("tyre {serial} crack {number}: {name} is {value}; it must lie in {low} to {high}")]
    Crack { serial: String, number: usize, name: &'static str, value: f64, low: f64, high: f64 },
    /// A fault's fraction is not a probability; faults count from 1.
    #[error("fault {number}: fraction is {fraction}; it must lie in 0 to 1")]
    Fault { number: usize, fraction: f64 },
    /// Two simulated tyres share a serial number.
    #[error("two simulated tyres have the serial number {serial:?}")]
    DuplicateTyre { serial: String },
}

/// `value` if it lies in `low` to `high`; NaN does not.
pub(crate) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<f64, Error> {
    if (low..=high).contains(&value) { Ok(value) } else { Err(Error::OutOfRange { name, value, low, high }) }
}
