//! Why a scene, a table or a simulated rig cannot be had.

/// Why a model cannot answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A quantity lies outside the bounds within which the formulas mean anything.
    #[error("{name} is {value}; it must lie in {low} to {high}")]
    OutOfRange {
        /// Which quantity.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Least value allowed.
        low: f64,
        /// Greatest value allowed.
        high: f64,
    },
    /// The dissertation has no such table of computed contact quantities.
    #[error("there is no table {number}; the tables are 4, 5, 6, 8, 9, 10 and 11")]
    NoTable {
        /// What was asked for.
        number: u8,
    },
    /// The dissertation has no such figure of its theory's curves.
    #[error("there is no figure {number}; the figures are 11-13, 16-20, 22-27, 31, 32 and 36-38")]
    NoFigure {
        /// What was asked for.
        number: u8,
    },
    /// The impact is so stiff that its integration does not end.
    #[error("integration of the impact stopped after {steps} steps at {reached_s} s of {wanted_s} s")]
    TooStiff {
        /// Steps taken.
        steps: usize,
        /// Time reached.
        reached_s: f64,
        /// Time that was to be reached.
        wanted_s: f64,
    },
    /// A crack of a simulated tyre is not one.
    #[error("tyre {serial} crack {number}: {name} is {value}; it must lie in {low} to {high}")]
    Crack {
        /// Serial number of the tyre.
        serial: String,
        /// Which of its cracks, from 1.
        number: usize,
        /// Which quantity.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Least value allowed.
        low: f64,
        /// Greatest value allowed.
        high: f64,
    },
    /// Two simulated tyres share a serial number.
    #[error("two simulated tyres have the serial number {serial:?}")]
    DuplicateTyre {
        /// The number.
        serial: String,
    },
}

/// `value` when it lies in `low` to `high`; NaN does not.
pub(crate) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<f64, Error> {
    if (low..=high).contains(&value) { Ok(value) } else { Err(Error::OutOfRange { name, value, low, high }) }
}
