//! The extractor against scipy, against a slow twin, against its own laws, and against garbage.
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
mod twin;
