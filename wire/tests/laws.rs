//! Laws of the stream that the shape of the records must keep; those of their transport are in `stream.rs`.

use tapline_wire::{CasingHeader, TapId};

/// Law 1: the time of day enters a result only where a tap happens; else it names things that are in none.
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
    let allowed = [
        "acquire/src/capture/by_hand.rs",      // the name of a casing without a serial
        "acquire/src/capture/ear.rs",          // when a tap was heard
        "acquire/src/capture/heard.rs",        // the day of a casing, on which its calibration is valid or not
        "acquire/src/rig/dialogue/receive.rs", // when a rig has hit: the time of a tap
        "acquire/src/rig/dialogue/station.rs", // the name of a casing whose serial is unreadable
        "acquire/src/rig/tests/mod.rs",        // what it is held to
        "acquire/src/stage/station.rs",        // how long a casing was left half tapped
        "src/line/status.rs",                  // how old a status is
        "src/line/supervisor/closed.rs",       // when a file was closed, of one that does not say
        "src/line/supervisor/mod.rs",          // when a status was so
        "src/serve/metrics.rs",                // how old a status and a calibration are
        "src/serve/mod.rs",                    // whether the line still shows itself
        "src/wires/modbus.rs",                 // at each start verdicts get other numbers
        "src/wires/opcua/mod.rs",              // how long a certificate is still valid
        "src/wires/outbox.rs",                 // when a verdict is reported again
        "store/src/stage/places.rs",           // names of files and folders
        "store/src/stage/unreported.rs",       // when a casing's file was finished
        "wire/src/clock.rs",                   // where it is read
        "wire/src/stream/line.rs",             // distinguishes the runs of a process
    ];
    assert_eq!(readers, allowed);
}

/// What lies in shared memory must have no bytes that are never written.
#[test]
fn records_have_no_padding_at_their_end() {
    // A field that needs no padding fills its type: the sum of the fields is the size.
    let stamp = size_of::<tapline_wire::Stamp>();
    assert_eq!(stamp, 3 * 8 + 2 * 4 + 8);
    assert_eq!(size_of::<CasingHeader>(), stamp + 3 * 8 + 10 * 4);
    assert_eq!(size_of::<TapId>(), 32 + 2 * 2 + 2 * 4 + 4 + 2 * 2);
}
