//! Texts and fingerprints of rows.

use proptest::prelude::*;

use super::*;

proptest! {
    /// Catches a cut inside a character, a text that outgrows its field, and a text that fits but is changed.
    #[test]
    fn a_text_is_whole_or_marked(given in "[^\u{0}]{0,40}") {
        let field = fixed::<32>(&given);
        let kept = text(&field).unwrap();
        if given.len() <= 32 {
            prop_assert_eq!(kept, given);
        } else {
            let head = kept.strip_suffix(ELLIPSIS).unwrap();
            prop_assert!(given.starts_with(head) && head.len() > 32 - ELLIPSIS.len() - 4);
        }
    }
}

/// Catches a fingerprint that a retransmission would change, or that a field of the tap does not enter.
#[test]
fn fingerprints_tell_takes_apart_not_sendings() {
    let row = HeaderRow::unwritten();
    let resent = HeaderRow { sequence: 9, epoch_ns: 9, sent_ns: 9, ..row };
    assert_eq!(row.fingerprint(), resent.fingerprint());
    let retaken = [
        HeaderRow { attempt: 1, ..row },
        HeaderRow { tap_time_ns: 1, ..row },
        HeaderRow { sample_count: 1, ..row },
        HeaderRow { velocity_measured_m_per_s: 1.0, ..row },
        HeaderRow { unit_per_count: [0.0, 1.0, 0.0, 0.0], ..row },
    ];
    assert!(retaken.iter().all(|other| other.fingerprint() != row.fingerprint()));
}
