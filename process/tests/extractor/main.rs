//! The extractor, compared with scipy and a slow twin, and tested by its laws and with garbage.
#![expect(clippy::unwrap_used, reason = "a test that cannot be set up must fail")]

mod estimators;
mod estimators_reference;
mod garbage;
mod laws;
mod other_rig;
mod plant;
mod precision;
mod quality;
mod recorded;
mod reference;
mod scipy;
mod signal;
mod tap;
mod twin;
