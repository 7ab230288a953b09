//! What can be wrong with a population, a crack or a plan.

/// Why a casing cannot be simulated or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A quantity lies outside its bounds.
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
    /// The plan asks for records that the simulator does not make.
    #[error("the plan asks for {what}; the simulator records force and sound as 32-bit numbers of one length")]
    Recording {
        /// What it asks for.
        what: String,
    },
    /// A serial number, offset or velocity that no tap can have.
    #[error(transparent)]
    Id(#[from] tapline_wire::IdError),
    /// The taps make no plan.
    #[error(transparent)]
    Plan(#[from] tapline_wire::PlanError),
    /// The discriminators' settings cannot be worked with.
    #[error(transparent)]
    Process(#[from] tapline_process::Error),
    /// What the system says of a file.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A table could not be written.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// A recording could not be written.
    #[error(transparent)]
    Wav(#[from] hound::Error),
}

/// Refuses a value outside `low` to `high`, and one that is no number.
pub(crate) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), Error> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(Error::OutOfRange { name, value, low, high }) }
}
