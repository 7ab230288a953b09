//! Archives written, read, killed, damaged and refused, through the crate's public face.

mod common;
mod crash;
mod export;
mod foreign;
mod refuse;
mod roundtrip;
mod verify;
