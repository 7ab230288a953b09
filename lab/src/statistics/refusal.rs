//! Why a study gives no number.

/// Why data give no answer: too few or too alike, or wrong.
///
/// Most of these are outcomes rather than faults: a study in which every crack was found is a good one, but it has no
/// a90.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Two slices that belong together differ in length.
    #[error("{first_name} has {first} entries and {second_name} has {second}; they must be as many")]
    Lengths {
        /// Name of the one.
        first_name: &'static str,
        /// Its length.
        first: usize,
        /// Name of the other.
        second_name: &'static str,
        /// Its length.
        second: usize,
    },
    /// A size has no logarithm.
    #[error("the size of target {index} is {value}; it must be above 0 and finite")]
    Size {
        /// Which target, from 0.
        index: usize,
        /// What was given.
        value: f64,
    },
    /// A response is no number, or has no logarithm where one is asked for.
    #[error(
        "the response of target {index} is {value}; it must be finite, and above 0 or no more than the noise in logs"
    )]
    Response {
        /// Which target, from 0.
        index: usize,
        /// What was given.
        value: f64,
    },
    /// A setting lies outside its bounds.
    #[error("{name} is {value}; it must lie in {low} to {high}")]
    OutOfRange {
        /// Which setting.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Least value allowed.
        low: f64,
        /// Greatest value allowed.
        high: f64,
    },
    /// There are fewer of a thing than the result needs at all.
    #[error("{name}: there are {got}; at least {least} are needed")]
    TooFew {
        /// Which thing.
        name: &'static str,
        /// How many there are.
        got: usize,
        /// Fewest that give a result.
        least: usize,
    },
    /// No target was found, so that no size is found half the time.
    #[error("none of the {target_count} targets was found; a50 lies above all of their sizes")]
    NoHits {
        /// Targets looked at.
        target_count: usize,
    },
    /// Every target was found, so that no size is missed half the time.
    #[error("all of the {target_count} targets were found; a50 lies below all of their sizes")]
    AllHits {
        /// Targets looked at.
        target_count: usize,
    },
    /// Misses and hits do not overlap, so that the steepest curve fits best and has no slope.
    #[error(
        "none up to size {largest_miss:.3} was found, and all from {smallest_hit:.3} on: a50 lies between, and no slope fits"
    )]
    Separable {
        /// Greatest size missed, in the unit of the sizes.
        largest_miss: f64,
        /// Least size found, in the unit of the sizes.
        smallest_hit: f64,
    },
    /// All targets that determine a slope have one size.
    #[error("every target that determines the slope has the size {size}; at least two sizes are needed")]
    OneSize {
        /// That size, in its unit.
        size: f64,
    },
    /// Larger cracks are not found more easily, so that no size is large enough.
    #[error("the slope over ln(size) is {slope}; it must be above 0")]
    NotRising {
        /// The slope fitted, per ln(size); minus infinity where hits and misses part cleanly the wrong way round.
        slope: f64,
    },
    /// The data lie on one line or are all the same.
    #[error("the {name} have no scatter, so that no probability can be computed")]
    NoScatter {
        /// What has none.
        name: &'static str,
    },
    /// The fit did not settle.
    #[error("the fit had not settled after {steps} steps")]
    NotSettled {
        /// Steps taken.
        steps: usize,
    },
    /// A design has a hole.
    #[error("part {part}, operator {operator}, repeat {repeat} has no value; the design must be complete")]
    Incomplete {
        /// Part of the hole, from 0.
        part: usize,
        /// Operator, or station, of the hole, from 0.
        operator: usize,
        /// Repeat of the hole, from 0.
        repeat: usize,
    },
}
