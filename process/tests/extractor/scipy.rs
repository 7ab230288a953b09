//! The values that numpy and scipy find in the same taps.

use crate::reference::CASES;
use crate::signal::assert_close;

/// Catches any other reading of a definition than scipy's: window, detrending, doubling, edges, widths, areas.
#[test]
fn double_precision_like_scipy() {
    for (case, expected) in CASES {
        assert_close(&case.extract::<f64>(), *expected, 1e-9, case.name);
    }
}

/// Catches single precision that costs more digits than the 1e-4 it may.
#[test]
fn single_precision_like_scipy() {
    for (case, expected) in CASES {
        assert_close(&case.extract::<f32>(), *expected, 1e-4, case.name);
    }
}

/// Catches a value absent without a flag, and a flag on a tap that has all seven.
#[test]
fn flags_say_what_is_absent() {
    let flags: Vec<String> = CASES.iter().map(|(case, _)| case.extract::<f64>().quality.to_string()).collect();
    // The third has a contact time that no casing has.
    let expected =
        ["", "", "rate_implausible", "no_force", "no_force", "", "", "", "no_baseline", "", "no_onset|low_snr"];
    assert_eq!(flags, expected);
}
