//! The values of numpy and scipy for the same taps.

use crate::reference::CASES;
use crate::signal::assert_close;

/// Catches another reading of a definition than scipy's: window, detrending, doubling, edges, widths, areas.
#[test]
fn double_precision_like_scipy() {
    for (case, expected) in CASES {
        assert_close(&case.extract::<f64>(), *expected, 1e-9, case.name);
    }
}

/// Catches single precision that is off by more than the allowed 1e-4.
#[test]
fn single_precision_like_scipy() {
    for (case, expected) in CASES {
        assert_close(&case.extract::<f32>(), *expected, 1e-4, case.name);
    }
}

/// Catches a value that is absent without a flag, and a flag on a tap that has all values.
#[test]
fn flags_say_what_is_absent() {
    let flags: Vec<String> = CASES.iter().map(|(case, _)| case.extract::<f64>().quality.to_string()).collect();
    // The third case has a contact time that no casing has.
    let expected =
        ["", "", "rate_implausible", "no_force", "no_force", "", "", "", "no_baseline", "", "no_onset|low_snr"];
    assert_eq!(flags, expected);
}
