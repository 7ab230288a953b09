//! Repacks an archive with another codec: the same taps, results and digests, in another file.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use tapline_codec::Codec;

use crate::archive::create::create;
use crate::archive::{Access, Archive};
use crate::error::{Context, Error, Result};
use crate::file::draft::{self, remove_dead_drafts};
use crate::format::checksum::ChecksummedRow;
use crate::format::lineage::Lineage;
use crate::h5::table::Table;
use crate::read::reader::Reader;
use crate::read::samples::ReadBuffer;
use crate::read::verify::verify_with;
use crate::write::finish::close_and_seal;
use crate::write::packer::{Shape, pack};

/// Taps that are packed together, by several threads.
const BATCH_TAPS: usize = 64;

/// Part of the time that goes by while an archive is checked before it is repacked.
const CHECKED_PART: f64 = 0.3;

/// Bytes before and after repacking.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repacked {
    /// Of the samples.
    pub sample_bytes: u64,
    /// Of the file that was read.
    pub before_bytes: u64,
    /// Of the file that was written.
    pub after_bytes: u64,
}

/// Writes the archive at `from` to `to`, its samples packed with `codec`; every sample is checked.
///
/// The new file appears complete or not at all, and its results have the same lineage. `on_part` is called every few taps with the
/// part of the work that is done, from 0 to 1.
///
/// # Errors
/// [`Error::Exists`] if `to` exists, [`Error::ResultsAlone`] if `from` has no samples of its own, [`Error::Damaged`] if [`crate::verify()`]
/// finds a problem in it, or what the system returns.
pub fn repack(
    from: impl AsRef<Path>,
    to: impl AsRef<Path>,
    codec: Codec,
    mut on_part: impl FnMut(f64),
) -> Result<Repacked> {
    let (from, to) = (from.as_ref(), to.as_ref());
    let reader = Reader::open(from)?;
    if reader.is_results() {
        return Err(Error::ResultsAlone { path: from.to_owned() });
    }
    if to.try_exists().context("look for", to)? {
        return Err(Error::Exists { path: to.to_owned() });
    }
    if let Some(problem) = verify_with(from, |part| on_part(part * CHECKED_PART))?.problems.first() {
        return Err(reader.archive.damaged(format!("it is not repacked: {problem}")));
    }
    remove_dead_drafts(to);
    let draft = draft::begin(to).context("create", to)?;
    // The name is reserved for this draft, but an archive is created where no file is.
    fs::remove_file(&draft).context("create", &draft)?;
    let sample_bytes = fill(&reader, &draft, codec, |part| on_part(CHECKED_PART + part * (1.0 - CHECKED_PART)))?;
    draft::publish(draft, to)?;
    let length = |path: &Path| Ok::<_, Error>(fs::metadata(path).context("get the size of", path)?.len());
    Ok(Repacked { sample_bytes, before_bytes: length(from)?, after_bytes: length(to)? })
}

fn fill(reader: &Reader, draft: &Path, codec: Codec, on_part: impl FnMut(f64)) -> Result<u64> {
    let lineage = Lineage {
        config_toml: reader.config(),
        reference: reader.reference(),
        made_by: reader.made_by(),
        codec,
        raw: None,
    };
    let old = &reader.archive;
    create(draft, &old.begun, old.taps_max, lineage)?;
    let mut new = Archive::open(draft, Access::Write)?;
    new.grow_to(old.plan.clone());
    copy(&old.plan_rows, &new.plan_rows, draft)?;
    let sample_bytes = copy_taps(reader, &new, on_part)?;
    copy(&old.discriminators, &new.discriminators, draft)?;
    copy(&old.refusals, &new.refusals, draft)?;
    copy(&old.damage, &new.damage, draft)?;
    copy(&old.scans, &new.scans, draft)?;
    copy(&old.ledger, &new.ledger, draft)?;
    if !old.stored_key()?.is_empty() {
        new.write_key()?;
    }
    new.flush().context("write", draft)?;
    close_and_seal(new, reader.ledger().taps())?;
    fs::File::open(draft).and_then(|file| file.sync_all()).context("sync", draft)?;
    Ok(sample_bytes)
}

/// Copies a table as it is: a corrupt row stays corrupt.
fn copy<R: ChecksummedRow>(from: &Table<R>, to: &Table<R>, path: &Path) -> Result<()> {
    let rows = from.read_all().context("read a table", path)?;
    to.write_unchanged(&rows).context("write a table", path)
}

/// Packs the samples of every archived tap and writes them with their headers.
fn copy_taps(reader: &Reader, new: &Archive, mut on_part: impl FnMut(f64)) -> Result<u64> {
    let (rows, shape) = (&new.samples, Shape::of(new));
    let taps = reader.taps()?;
    let mut headers = reader.archive.headers.read_all().context("read the headers", reader.path())?;
    let numbers: Vec<u32> = (0..).take(headers.len()).collect();
    let mut buffer = ReadBuffer::default();
    let mut sample_bytes = 0;
    for batch in numbers.chunks(BATCH_TAPS) {
        on_part(batch.first().map_or(0.0, |&first| f64::from(first)) / numbers.len() as f64);
        let mut samples: BTreeMap<u32, Vec<u8>> = BTreeMap::new();
        for &row in batch {
            if let Some((_, of_tap)) = taps.read(row, &mut buffer)? {
                samples.insert(row, of_tap.as_bytes().to_vec());
            }
        }
        let records: Vec<(Shape, &[u8])> = samples.values().map(|of_tap| (shape, of_tap.as_slice())).collect();
        let rows_of: Vec<u32> = samples.keys().copied().collect();
        pack(&records, |number, packed| {
            let (row, record) = (rows_of[number], records[number].1);
            sample_bytes += record.len() as u64;
            let header = &mut headers[row as usize];
            if packed.samples_digest != header.samples_digest {
                let what =
                    format!("the samples of plan row {row} are not those that were recorded: their digest differs");
                return Err(reader.archive.damaged(what));
            }
            rows.write(row, packed.stored(record)).context("write samples", &new.path)?;
            header.stored_checksum = packed.stored_checksum;
            Ok(())
        })?;
    }
    new.headers.write_all(&headers).context("write the headers", &new.path)?;
    Ok(sample_bytes)
}
