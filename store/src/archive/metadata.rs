//! What is set when an archive is created and never changes afterwards, with its digest.

use hdf5::{File, H5Type};

use crate::format::checksum::PlainRow as _;
use crate::format::layout::{PlanRow, TruthRow, attribute, table};
use crate::h5::text::read_text;

/// Everything that never changes after creation, and the rows of the plan, which may grow.
pub(crate) struct Metadata {
    /// BLAKE3 of all of it except added rows of the plan, as hexadecimal digits.
    pub digest: String,
    pub geometry: String,
    pub plan_digest: u64,
    pub source_digest: u64,
    pub config: Vec<u8>,
    pub made_by: Vec<u8>,
    pub calibration: Vec<u8>,
    pub reference: Option<Vec<u8>>,
    /// Rows of the plan as it was begun.
    pub begun_count: usize,
    pub plan: Vec<PlanRow>,
    pub truth: Vec<TruthRow>,
}

impl Metadata {
    /// Reads it from `file`; `None` if a table has an impossible length or other columns.
    pub(crate) fn read(file: &File) -> hdf5::Result<Option<Self>> {
        // In one piece: BLAKE3 hashes several parts of it at a time.
        let mut all = Vec::new();
        let mut add = |part: &[u8]| {
            all.extend_from_slice(&(part.len() as u64).to_le_bytes());
            all.extend_from_slice(part);
        };
        let mut text = |name: &str| -> hdf5::Result<String> {
            let text = read_text(file, name)?;
            add(text.as_bytes());
            Ok(text)
        };
        text(attribute::FORMAT)?;
        text(attribute::TAPLINE_VERSION)?;
        let geometry = text(attribute::GEOMETRY)?;
        let mut number = |name: &str| -> hdf5::Result<u64> {
            let number: u64 = file.attr(name)?.read_scalar()?;
            add(&number.to_le_bytes());
            Ok(number)
        };
        let (plan_digest, source_digest) = (number(attribute::PLAN_DIGEST)?, number(attribute::SOURCE_DIGEST)?);
        let begun_count = number(attribute::BEGUN_TAPS)?;
        add(&file.attr(attribute::FORMAT_VERSION)?.read_scalar::<u32>()?.to_le_bytes());
        let Some(config) = read_bounded::<u8>(file, table::CONFIG)? else { return Ok(None) };
        let Some(made_by) = read_bounded::<u8>(file, table::MADE_BY)? else { return Ok(None) };
        let Some(calibration) = read_bounded::<u8>(file, table::CALIBRATION)? else { return Ok(None) };
        [&config, &made_by, &calibration].into_iter().for_each(|text| add(text));
        let names = file.attr_names()?;
        let has = |name: &str| names.iter().any(|known| known == name);
        if has(attribute::RAW) {
            for name in [attribute::RAW, attribute::RAW_DIGEST] {
                add(read_text(file, name)?.as_bytes());
            }
        }
        let mut reference = None;
        if file.link_exists(table::REFERENCE) {
            let Some(bytes) = read_bounded::<u8>(file, table::REFERENCE)? else { return Ok(None) };
            add(&bytes);
            reference = Some(bytes);
        }
        let Some(plan) = read_bounded::<PlanRow>(file, table::PLAN)? else { return Ok(None) };
        let begun = usize::try_from(begun_count).ok().and_then(|count| plan.get(..count));
        let Some(begun) = begun else { return Ok(None) };
        begun.iter().for_each(|row| add(row.bytes()));
        let begun_count = begun.len();
        add(&(plan.len() as u64).to_le_bytes());
        let mut truth = Vec::new();
        if file.link_exists(table::TRUTH) {
            let Some(rows) = read_bounded::<TruthRow>(file, table::TRUTH)? else { return Ok(None) };
            rows.iter().for_each(|row| add(row.bytes()));
            truth = rows;
        }
        let digest = blake3::hash(&all).to_hex().to_string();
        Ok(Some(Self {
            digest,
            geometry,
            plan_digest,
            source_digest,
            config,
            made_by,
            calibration,
            reference,
            begun_count,
            plan,
            truth,
        }))
    }
}

/// All rows of a table whose length is not known beforehand; `None` if the file is too short for that length, or the table has
/// other columns.
fn read_bounded<R: H5Type + Clone>(file: &File, name: &str) -> hdf5::Result<Option<Vec<R>>> {
    let dataset = file.dataset(name)?;
    let &[row_count] = dataset.shape().as_slice() else { return Ok(None) };
    // A damaged length must not allocate more memory than the file has bytes.
    let bytes = row_count.checked_mul(size_of::<R>()).and_then(|bytes| u64::try_from(bytes).ok());
    let fits = bytes.is_some_and(|bytes| bytes <= file.size());
    if !fits || dataset.dtype()?.to_descriptor()? != R::type_descriptor() {
        return Ok(None);
    }
    dataset.read_raw::<R>().map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches memory that is allocated for rows that the file cannot have.
    #[test]
    fn more_rows_than_the_file_has_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = File::create(folder.path().join("t.h5")).unwrap();
        let of = |name: &str, row_count: usize| {
            file.new_dataset::<PlanRow>().chunk([64]).shape(row_count).create(name).unwrap();
            read_bounded::<PlanRow>(&file, name).unwrap()
        };
        assert!(of("too many", 1 << 40).is_none());
        assert!(of("beyond all bytes", usize::MAX / 2).is_none());
        assert_eq!(of("none", 0).map(|rows| rows.len()), Some(0));
    }
}
