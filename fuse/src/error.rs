//! Errors of a configuration or of a record's place in the plan.

use std::path::PathBuf;

use tapline_wire::{Geometry, Serial, TapId};

/// Why the fusion cannot be set up, or a record has no place in it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// No discriminator is to enter the index.
    #[error("fuse.discriminators is empty: the index needs at least one")]
    NoDiscriminators,
    /// A discriminator is listed twice.
    #[error("fuse.discriminators lists {name:?} twice: each counts once")]
    TwiceListed { name: &'static str },
    /// A number of the configuration lies outside its bounds.
    #[error("fuse.{name} = {value}: must be from {low} to {high}")]
    OutOfRange { name: &'static str, value: f64, low: f64, high: f64 },
    /// More shoulders would be rejected than fail to pass.
    #[error("fuse.reject_rate = {reject_rate}: must not be above fuse.re_inspect_rate = {re_inspect_rate}")]
    RejectRate { reject_rate: f64, re_inspect_rate: f64 },
    /// No reference is named.
    #[error(
        "no reference is named (--reference, or reference in [fuse]): give the .json file of one, \"TYRE/SHOULDER\" of this run, \
         or \"self\" to compare each tyre with itself (damage all round does not show then)"
    )]
    ReferenceNotNamed,
    /// The reference is in a file that was not read.
    #[error("the reference {} is in a file, and was not read", path.display())]
    ReferenceNotRead { path: PathBuf },
    /// The taps of a reference file were recorded or analysed differently from those compared with it.
    #[error(
        "the reference's taps were recorded or analysed differently from these: {difference}; make the reference again from archives that were made like these"
    )]
    ReferenceMadeOtherwise { difference: String },
    /// A reference has no tap at any offset and velocity of the plan.
    #[error("the reference has taps at {known}, the scan plan at {planned}: they have none in common")]
    NothingInCommon { known: String, planned: String },
    /// The reference has rings and the plan a line, or the other way round.
    #[error(
        "the scan plan has locations of a {}, and the shoulders of the reference do not: they cannot be compared",
        planned.name()
    )]
    OtherGeometry { planned: Geometry },
    /// The rings of a reference have a different number of locations from those of the plan.
    #[error(
        "the scan taps {planned} locations per ring, which are not all among the {known} of the reference: their arcs cannot be compared"
    )]
    OtherLocations { known: usize, planned: usize },
    /// A reference file is not a valid reference.
    #[error("it is not a reference: {reason}")]
    NotAReference { reason: String },
    /// A reference is neither `self` nor `TYRE/SHOULDER` nor a file.
    #[error(
        "reference is {text:?}; it must be \"self\", \"TYRE/SHOULDER\" with a shoulder of 0 to 65535, or the name of a .json file \
         that `tapline reference` made"
    )]
    ReferenceText { text: String },
    /// The reference is not a shoulder of the plan.
    #[error("reference {tyre}/{shoulder} is not one of the {scan_count} shoulders of the scan plan")]
    ReferenceNotPlanned { tyre: Serial, shoulder: u16, scan_count: usize },
    /// A record names a row that the plan does not have.
    #[error("a record names plan row {got}; the plan has {tap_count} rows")]
    NoSuchRow { got: u32, tap_count: usize },
    /// A record names a scan that the plan does not have.
    #[error("scan {got} was named; the plan has {scan_count} scans")]
    NoSuchScan { got: usize, scan_count: usize },
    /// A record's tap is not the one planned in its row.
    #[error("plan row {row} is {planned}, but a record for it is named {got}")]
    OtherTap { row: u32, planned: Box<TapId>, got: Box<TapId> },
}
