//! What can be wrong with a rig or a plan.

/// Why a casing cannot be simulated.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// A quantity is out of its bounds.
    #[error("{name} is {value}; it must lie in {low} to {high}")]
    OutOfRange { name: &'static str, value: f64, low: f64, high: f64 },
    /// The plan has records that the simulator does not make.
    #[error("the plan asks for {what}; the simulator records force and sound as 32-bit numbers of one length")]
    Recording { what: String },
    /// A serial number, offset or velocity that no tap can have.
    #[error(transparent)]
    Id(#[from] tapline_wire::IdError),
    /// The taps make no plan.
    #[error(transparent)]
    Plan(#[from] tapline_wire::PlanError),
    /// The settings of the discriminators are not valid.
    #[error(transparent)]
    Process(#[from] tapline_process::Error),
}

/// Refuses a value outside `low` to `high`, and NaN.
pub(crate) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), Error> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(Error::OutOfRange { name, value, low, high }) }
}
