//! Wrong data is flagged: faults planted in taps of two simulators that share no code, and how many of them are flagged.
//!
//! Each fault must be flagged in 99 of 100 faulty taps, and no flag may be raised in more than 1 of 100 clean ones. Run it with
//! `cargo test -p tapline-plate --test wrong_data -- --nocapture` to see the shares.
#![expect(clippy::unwrap_used, reason = "a test that cannot be set up must fail")]

mod shoulders;
#[path = "../../../process/tests/extractor/tap.rs"]
#[allow(dead_code, reason = "what the tests of the extractor share with these")]
mod tap;
mod taps;

use tapline_wire::{Channel, SampleFormat, TapHeader, TapId};

const RATE_HZ: f64 = 40_960.0;

/// A tap of `count` samples, with `velocity` as planned and as measured.
fn header(
    format: SampleFormat,
    count: u32,
    pre_trigger_samples: u32,
    velocity: (f64, f64),
    units: [f64; 2],
) -> TapHeader {
    let mut header = TapHeader {
        id: TapId::default().with_velocity_m_per_s(Some(velocity.0)).unwrap(),
        velocity_nominal_m_per_s: velocity.0,
        velocity_measured_m_per_s: velocity.1,
        planned_sample_count: count,
        sample_format: format.code(),
        ..TapHeader::in_units(RATE_HZ, pre_trigger_samples, count, &Channel::BOTH)
    };
    for (channel, unit_per_count) in header.channels.iter_mut().zip(units) {
        channel.unit_per_count = unit_per_count;
    }
    header
}
