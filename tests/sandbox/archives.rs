//! The files of a run, and their contents.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use tapline_store::{OwnedSamples, Reader, Writer};
use tapline_wire::{DamageCell, Discriminators, Judgement, Stamp, TapHeader, TapState};

/// The contents of an archive that must not depend on when and how it was written.
#[derive(Debug, PartialEq)]
pub(crate) struct Contents {
    pub states: Vec<TapState>,
    pub taps: Vec<Option<(TapHeader, OwnedSamples)>>,
    pub discriminators: Vec<Option<String>>,
    pub judgements: Vec<Option<String>>,
}

/// The range of bytes of a table in the archive's file.
pub(crate) fn table_bytes(archive: &Path, table: &str) -> Range<usize> {
    let file = hdf5::File::open(archive).unwrap();
    let table = file.dataset(table).unwrap();
    let start = table.offset().unwrap() as usize;
    start..start + table.storage_size() as usize
}

/// Flips the lowest bit of byte `at` of a table.
pub(crate) fn bend(archive: &Path, table: &str, at: usize) {
    let start = table_bytes(archive, table).start;
    let mut bytes = fs::read(archive).unwrap();
    bytes[start + at] ^= 1;
    fs::write(archive, bytes).unwrap();
}

/// Writes `rows` of `whole`, with headers as `change` makes them, to an archive of the same plan at `to`.
pub(crate) fn part_of(whole: &Reader, to: PathBuf, rows: Range<u32>, mut change: impl FnMut(u32, &mut TapHeader)) {
    let mut writer = Writer::create(to, whole.plan(), whole.plan().taps().len(), whole.config()).unwrap();
    let found = whole.discriminators().unwrap();
    for row in rows {
        let (mut header, samples) = whole.tap(row).unwrap().unwrap();
        change(row, &mut header);
        writer.put_tap(&header, samples.as_samples().as_bytes()).unwrap();
        writer.put_discriminators(&found[row as usize].unwrap()).unwrap();
    }
    writer.finish().unwrap();
}

/// Reads an archive, without what depends on transmission: sequence, epoch and time of sending.
pub(crate) fn contents(archive: &Path) -> Contents {
    let reader = Reader::open(archive).unwrap();
    let rows = 0..reader.plan().taps().len() as u32;
    let tap = |row| {
        let (header, samples) = reader.tap(row).unwrap()?;
        Some((TapHeader { stamp: Stamp::default(), sent_ns: 0, ..header }, samples))
    };
    // As text, so that absent values, which are NaN, compare equal.
    let found = |record: Discriminators| format!("{record:?}");
    let judged = |(judgement, cells): (Judgement, Vec<DamageCell>)| {
        format!("{:?} {cells:?}", Judgement { stamp: Stamp::default(), ..judgement })
    };
    Contents {
        states: reader.ledger().taps().to_vec(),
        taps: rows.map(tap).collect(),
        discriminators: reader.discriminators().unwrap().into_iter().map(|r| r.map(found)).collect(),
        judgements: reader.judgements().unwrap().into_iter().map(|j| j.map(judged)).collect(),
    }
}

/// The names of the files and folders in `folder`, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The finished files of a run, by the casings' names as in the file names.
pub(crate) fn finished(out: &Path) -> BTreeMap<String, PathBuf> {
    let files = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    let files = files.filter(|path| path.extension().is_some_and(|ending| ending == "h5"));
    files.map(|path| (path.file_stem().unwrap().to_str().unwrap().to_owned(), path)).collect()
}

/// The files of a run that are under way.
pub(crate) fn under_way(out: &Path) -> Vec<PathBuf> {
    finished(&out.join("open")).into_values().collect()
}

/// The contents of the finished files of a run, by casing.
pub(crate) fn casings(out: &Path) -> BTreeMap<String, Contents> {
    finished(out).into_iter().map(|(name, path)| (name, contents(&path))).collect()
}

/// Panics with the first difference between two runs, and its casing.
pub(crate) fn assert_same_casings(a: &BTreeMap<String, Contents>, b: &BTreeMap<String, Contents>) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, contents) in a {
        eprintln!("comparing {name}");
        assert_same(contents, &b[name]);
    }
}

/// Panics with the first difference between two archives, without printing them.
pub(crate) fn assert_same(a: &Contents, b: &Contents) {
    assert_eq!(a.states, b.states, "states");
    for (row, (a, b)) in a.taps.iter().zip(&b.taps).enumerate() {
        let header = |tap: &Option<(TapHeader, OwnedSamples)>| format!("{:?}", tap.as_ref().map(|(header, _)| *header));
        assert_eq!(header(a), header(b), "header of row {row}");
        let samples = |tap: &Option<(TapHeader, OwnedSamples)>| tap.as_ref().map(|(_, samples)| samples.clone());
        assert!(samples(a) == samples(b), "samples of row {row}");
    }
    assert_eq!(a.discriminators, b.discriminators, "discriminators");
    assert_eq!(a.judgements, b.judgements, "judgements");
}
