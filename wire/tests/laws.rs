//! Laws of the stream that the shape of the records must keep; those of their transport are in `stream.rs`.

use tapline_wire::{Discriminators, Judgement, LedgerHeader, Stamped, TapHeader, TapId};

/// Law 1: a record that lost its stamp or its name would not compile here; one that is copied keeps both.
#[test]
fn law_1_every_record_has_a_stamp_and_says_what_it_is_about() {
    fn stamped<H: Stamped + Default>() -> u64 {
        let mut header = H::default();
        header.stamp_mut().sequence = 7;
        header.stamp().sequence
    }
    assert_eq!([stamped::<TapHeader>(), stamped::<Judgement>(), stamped::<LedgerHeader>()], [7; 3]);
    let id: TapId = TapHeader::default().id;
    assert_eq!(id, Discriminators::default().id);
    let time_ns: i64 = TapHeader::default().tap_time_ns;
    assert_eq!(time_ns, 0);
}

/// Law 1: the time of day is asked for where a process begins its life, and, by a source that has a real converter,
/// where a tap happens; nowhere else.
#[test]
fn law_1_only_acquire_reads_a_clock_for_a_result() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut readers = Vec::new();
    let mut folders: Vec<_> = ["src", "wire/src", "model/src", "acquire/src", "process/src", "fuse/src", "store/src"]
        .map(|folder| root.join(folder))
        .into();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            if entry.path().is_dir() {
                folders.push(entry.path());
            } else if std::fs::read_to_string(entry.path()).unwrap().contains("now_ns()") {
                readers.push(entry.path().strip_prefix(root).unwrap().to_str().unwrap().to_owned());
            }
        }
    }
    readers.sort();
    assert_eq!(readers, ["wire/src/clock.rs", "wire/src/line.rs"]);
}

/// What lies in shared memory must have no bytes that are never written.
#[test]
fn records_have_no_padding_at_their_end() {
    for (size, align) in [
        (size_of::<TapHeader>(), align_of::<TapHeader>()),
        (size_of::<Discriminators>(), align_of::<Discriminators>()),
        (size_of::<Judgement>(), align_of::<Judgement>()),
    ] {
        assert_eq!((size % 8, align), (0, 8));
    }
}
