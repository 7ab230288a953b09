//! A writer that is killed leaves an archive that opens normally and can be continued.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use tapline_store::{Codec, Lineage, Reader, Writer};
use tapline_wire::{SampleFormat, TapState};

use crate::common::{
    CONFIG, begun, big_plan, bytes, discriminators, header, new_path, open_or_create, plan, put_all, samples,
};
use crate::places::{chunk_bytes, table_bytes};

/// Names the archive to the test that is started again as the process to be killed.
const VICTIM: &str = "TAPLINE_STORE_TEST_VICTIM";

/// How many writers are killed; 24 when it is not set.
const TRIALS: &str = "TAPLINE_STORE_TEST_KILLS";

/// Not a test by itself: writes the archive named by [`VICTIM`] again and again until it is killed.
#[test]
fn victim() {
    let Ok(path) = std::env::var(VICTIM) else { return };
    let plan = big_plan();
    println!("begun");
    loop {
        let mut writer = open_or_create(&path, &plan, CONFIG).unwrap();
        for row in 0..plan.taps().len() as u32 {
            let tap = header(&plan, row, 4096);
            writer.put_tap(&tap, &samples(&tap)).unwrap();
            writer.put_discriminators(&discriminators(&plan, row)).unwrap();
            writer.flush().unwrap();
            if writer.ledger().taps()[row as usize] == TapState::Archived {
                println!("archived {row}");
            }
        }
        drop(writer);
        std::fs::remove_file(&path).unwrap();
    }
}

/// Kills a victim `delay` after it has archived `row_count` rows, and returns the rows that the last file it worked on
/// was said to have.
fn kill_after(path: &Path, row_count: usize, delay: Duration) -> Vec<u32> {
    let mut victim = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "crash::victim", "--nocapture"])
        .env(VICTIM, path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(victim.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.ends_with("begun")), "the victim did not begin");
    let mut rows = lines.filter_map(|line| line.strip_prefix("archived ")?.parse::<u32>().ok());
    let mut said: Vec<u32> = rows.by_ref().take(row_count).collect();
    std::thread::sleep(delay);
    victim.kill().unwrap();
    victim.wait().unwrap();
    for row in rows {
        if row == 0 {
            said.clear();
        }
        said.push(row);
    }
    said
}

/// Catches a file that a killed writer leaves unreadable, a tap that was archived and is missing or corrupt, and an
/// archive that cannot be completed afterwards.
#[test]
fn killed_at_any_time_it_opens_and_goes_on() {
    let _guard = crate::common::alone();
    let plan = big_plan();
    let mut survivors = 0;
    let trial_count = std::env::var(TRIALS).map_or(50, |count| count.parse().unwrap());
    for trial in 0..trial_count {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        // From before the first row to the last but one, and some way into the next.
        let row_count = trial % 12 * (plan.taps().len() - 1) / 12;
        let said = kill_after(&path, row_count, Duration::from_micros(137 * (trial % 97) as u64));
        if path.exists() {
            survivors += 1;
            let reader = Reader::open_unfinished(&path).unwrap();
            // When all rows were said to be there, the victim may have begun the next file already.
            if said.len() < plan.taps().len() {
                assert!(said.iter().all(|&row| reader.ledger().taps()[row as usize] == TapState::Archived));
            }
            for row in 0..plan.taps().len() as u32 {
                if let Some((tap, got)) = reader.tap(row).unwrap() {
                    assert_eq!(tap, header(&plan, row, 4096));
                    assert!(bytes(got.as_samples()) == samples(&tap), "row {row} of trial {trial} is corrupt");
                }
            }
            assert_eq!(tapline_store::verify(&path).unwrap().problems, []);
        }
        let mut writer = open_or_create(&path, &plan, CONFIG).unwrap();
        put_all(&mut writer).unwrap();
        writer.finish().unwrap();
        assert!(tapline_store::verify(&path).unwrap().is_complete());
    }
    println!("{survivors} of {trial_count} writers had begun an archive when they were killed; all open and went on");
    assert!(2 * survivors > trial_count, "too few victims lived long enough to prove anything");
}

/// Catches a change of the file's structure after its creation: the promise on which crash safety rests is that a
/// run only ever overwrites what was allotted, so the length stays and so does all that is not table contents.
#[test]
fn a_run_never_changes_the_structure() {
    let (_here, path) = new_path();
    let plan = plan(SampleFormat::I16);
    let mut writer =
        Writer::create(&path, &plan, plan.taps().len(), Lineage { codec: Codec::None, ..CONFIG.into() }).unwrap();
    let before = std::fs::read(&path).unwrap();
    put_all(&mut writer).unwrap();
    writer.flush().unwrap();
    let after = std::fs::read(&path).unwrap();
    drop(writer);
    assert_eq!(before.len(), after.len());
    let mut is_contents = vec![false; after.len()];
    let file = hdf5::File::open(&path).unwrap();
    let tables = ["taps/header", "discriminators", "ledger", "scans", "damage"].map(|name| table_bytes(&file, name));
    for range in tables.into_iter().chain(chunk_bytes(&file)) {
        is_contents[range].fill(true);
    }
    let changed = (0..after.len()).filter(|&k| before[k] != after[k] && !is_contents[k]).count();
    assert_eq!(changed, 0, "bytes outside the tables changed");
}

/// Catches an index of packed chunks that grows or is laid out again while a run is under way: only entries may change,
/// each in place, so that a writer killed in between leaves all others as they were.
#[test]
fn packed_chunks_change_entries_only() {
    let (_here, path, _, mut writer) = begun(big_plan());
    let before = std::fs::read(&path).unwrap();
    put_all(&mut writer).unwrap();
    writer.flush().unwrap();
    let after = std::fs::read(&path).unwrap();
    drop(writer);
    assert!(after.len() > before.len() && hdf5::File::open(&path).is_ok());
    // A node of the index: signature, type 1 (chunks), level, count of entries, neighbours.
    let nodes: Vec<usize> = (0..before.len() - 24).filter(|&at| before[at..].starts_with(b"TREE\x01")).collect();
    assert!(!nodes.is_empty());
    for at in nodes {
        assert_eq!(before[at..at + 24], after[at..at + 24], "the node at {at} is another");
    }
}

/// Catches samples that a power cut has lost, or a sector has changed, in an archive that is continued: it would be finished with them.
#[test]
fn altered_samples_are_taken_again() {
    let (_here, path, plan, mut writer) = begun(big_plan());
    put_all(&mut writer).unwrap();
    writer.settle().unwrap();
    writer.suspend().unwrap();
    let chunks = chunk_bytes(&hdf5::File::open(&path).unwrap());
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[chunks[3].start + 40] ^= 1;
    bytes[chunks[5].clone()].fill(0);
    std::fs::write(&path, bytes).unwrap();

    let mut writer = Writer::resume(&path, CONFIG).unwrap();
    let states = writer.ledger().taps();
    let missing: Vec<usize> = (0..states.len()).filter(|&row| states[row] == TapState::Missing).collect();
    assert_eq!(missing, [3, 5]);
    put_all(&mut writer).unwrap();
    writer.finish().unwrap();
    let report = tapline_store::verify(&path).unwrap();
    assert!(report.is_complete() && report.problems.is_empty(), "{:?} of {}", report.problems, plan.taps().len());
}
