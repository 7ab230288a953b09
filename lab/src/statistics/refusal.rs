//! Why a study gives no number.

/// Why data give no answer: too few or too alike, or wrong.
///
/// Most of these are outcomes rather than faults: a study in which every crack was found is a good one, but it has no
/// a90.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Two slices that belong together differ in length: name and length of the one, and of the other.
    #[error("{0} has {1} entries and {2} has {3}; the numbers must be equal")]
    Lengths(&'static str, usize, &'static str, usize),
    /// A size has no logarithm: which target, from 0, and its size.
    #[error("the size of target {0} is {1}; it must be above 0 and finite")]
    Size(usize, f64),
    /// A response is no number: which target, from 0, and its response.
    #[error("the response of target {0} is {1}; it must be finite")]
    Response(usize, f64),
    /// A setting lies outside its bounds: its name, value, and least and greatest value allowed.
    #[error("{0} is {1}; it must lie in {2} to {3}")]
    OutOfRange(&'static str, f64, f64, f64),
    /// There are fewer of a thing than the result needs at all: which, how many there are, and how many it needs.
    #[error("{0}: there are {1}; at least {2} are needed")]
    TooFew(&'static str, usize, usize),
    /// None of so many targets was found, so that no size is found half the time.
    #[error("none of the {0} targets was found; a50 lies above all of their sizes")]
    NoHits(usize),
    /// Each of so many targets was found, so that no size is missed half the time.
    #[error("all of the {0} targets were found; a50 lies below all of their sizes")]
    AllHits(usize),
    /// Misses and hits do not overlap, so that the steepest curve fits best and has no slope: greatest size missed and
    /// least size found, in the unit of the sizes.
    #[error("none up to size {0:.3} was found, and all from {1:.3} on: a50 lies between, and no slope fits")]
    Separable(f64, f64),
    /// All targets that determine a slope have this one size, in its unit.
    #[error("every target that determines the slope has the size {0}; at least two sizes are needed")]
    OneSize(f64),
    /// Larger cracks are not found more easily, so that no size is large enough: the slope fitted, per ln(size); minus
    /// infinity where hits and misses part cleanly the wrong way round.
    #[error("the slope over ln(size) is {0}; it must be above 0")]
    NotRising(f64),
    /// The named data lie on one line or are all the same.
    #[error("the {0} have no scatter, so that no probability can be computed")]
    NoScatter(&'static str),
    /// The fit did not settle in so many steps.
    #[error("the fit had not settled after {0} steps")]
    NotSettled(usize),
    /// A design has a hole: its part, its operator or station, and its repeat, each from 0.
    #[error("part {0}, operator {1}, repeat {2} has no value; the design must be complete")]
    Incomplete(usize, usize, usize),
}
