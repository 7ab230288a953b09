//! Archives written, read, killed, damaged and refused, through the crate's public API.

#![expect(clippy::unwrap_used, reason = "a helper that fails fails its test")]

mod blocks;
mod common;
mod crash;
mod damage;
mod foreign;
mod grow;
mod outage;
mod page;
mod places;
mod refuse;
mod repack;
mod roundtrip;
mod verify;
