//! A table of fixed length whose rows are written in contiguous runs.

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::OnceLock;

use hdf5::plist::dataset_create::{AllocTime, FillTime};
use hdf5::{Dataset, Group, H5Type};
use ndarray::ArrayView1;

use crate::format::checksum::ChecksummedRow;
use crate::h5::rows::{InMemory, write_rows};

/// Rows read or written at a time when a whole table is processed: keeps memory constant.
const BLOCK_ROWS: usize = 4096;

/// A one-dimensional dataset of rows `R`.
#[derive(Debug)]
pub(crate) struct Table<R> {
    dataset: Dataset,
    /// Description of a row in memory, made at the first write.
    in_memory: OnceLock<InMemory<R>>,
    row_count: usize,
    row: PhantomData<R>,
}

/// Creates a dataset of `row_count` rows and writes all of them, so that no row is ever undefined.
pub(crate) fn create<R: H5Type + Clone>(
    parent: &Group,
    name: &str,
    row_count: usize,
    mut row: impl FnMut(usize) -> R,
) -> hdf5::Result<Dataset> {
    let dataset = parent
        .new_dataset_builder()
        .empty::<R>()
        .shape(row_count)
        .alloc_time(Some(AllocTime::Early))
        .fill_time(FillTime::Never)
        .obj_track_times(false)
        .create(name)?;
    for block in blocks(row_count) {
        let rows: Vec<R> = block.clone().map(&mut row).collect();
        dataset.write_slice(ArrayView1::from(&rows), block)?;
    }
    Ok(dataset)
}

impl<R: ChecksummedRow> Table<R> {
    /// Creates a table of `row_count` rows and writes all of them, with their checksums.
    pub(crate) fn create(parent: &Group, row_count: usize, mut row: impl FnMut(usize) -> R) -> hdf5::Result<Dataset> {
        create(parent, R::TABLE, row_count, |number| row(number).with_checksum(number))
    }

    /// Opens the first `row_count` rows of the table in `parent`; `None` unless the table has `capacity` rows `R`, and at least
    /// `row_count`.
    pub(crate) fn open(parent: &Group, row_count: usize, capacity: usize) -> hdf5::Result<Option<Self>> {
        let dataset = parent.dataset(R::TABLE)?;
        // The library matches columns by name: the memory of a column with another name would stay undefined.
        let has_layout = row_count <= capacity
            && dataset.shape() == [capacity]
            && dataset.dtype()?.to_descriptor()? == R::type_descriptor();
        Ok(has_layout.then_some(Self { dataset, in_memory: OnceLock::new(), row_count, row: PhantomData }))
    }

    /// Sets the number of rows, which the table must have room for.
    pub(crate) fn grow_to(&mut self, row_count: usize) {
        self.row_count = row_count;
    }

    /// The rows `range`.
    pub(crate) fn read(&self, range: Range<usize>) -> hdf5::Result<Vec<R>> {
        if range.is_empty() {
            return Ok(Vec::new());
        }
        Ok(self.dataset.read_slice_1d::<R, _>(range)?.to_vec())
    }

    /// Calls `visit` with every row and its number.
    pub(crate) fn for_each(&self, mut visit: impl FnMut(usize, R)) -> hdf5::Result<()> {
        for block in blocks(self.row_count) {
            for (number, row) in block.clone().zip(self.read(block)?) {
                visit(number, row);
            }
        }
        Ok(())
    }

    /// Every row.
    pub(crate) fn read_all(&self) -> hdf5::Result<Vec<R>> {
        self.read(0..self.row_count)
    }

    /// Writes `rows` with their checksums, each run of neighbours at once: a write of many rows costs as much as one of one row.
    pub(crate) fn write(&self, rows: &BTreeMap<u32, R>) -> hdf5::Result<()> {
        let mut run: Vec<R> = Vec::new();
        let mut start = 0;
        for (&number, row) in rows {
            let number = number as usize;
            if number != start + run.len() {
                self.write_run(start, &run)?;
                run.clear();
                start = number;
            }
            run.push(row.with_checksum(number));
        }
        self.write_run(start, &run)
    }

    /// Writes every row as it is, with the checksum that it has.
    pub(crate) fn write_unchanged(&self, rows: &[R]) -> hdf5::Result<()> {
        self.write_run(0, rows)
    }

    /// Writes every row with its checksum.
    pub(crate) fn write_all(&self, rows: &[R]) -> hdf5::Result<()> {
        let rows: Vec<R> = rows.iter().enumerate().map(|(number, row)| row.with_checksum(number)).collect();
        self.write_run(0, &rows)
    }

    fn write_run(&self, start: usize, rows: &[R]) -> hdf5::Result<()> {
        if rows.is_empty() {
            return Ok(());
        }
        let in_memory = match self.in_memory.get() {
            Some(known) => known,
            None => {
                let described = InMemory::describe()?;
                self.in_memory.get_or_init(|| described)
            }
        };
        write_rows(&self.dataset, in_memory, start, rows)
    }
}

fn blocks(row_count: usize) -> impl Iterator<Item = Range<usize>> {
    (0..row_count).step_by(BLOCK_ROWS).map(move |start| start..(start + BLOCK_ROWS).min(row_count))
}

#[cfg(test)]
mod tests {
    use tapline_wire::TapState;

    use super::*;
    use crate::format::layout::LedgerRow;

    fn row(attempt: usize) -> LedgerRow {
        LedgerRow::new(TapState::Missing, attempt as u16)
    }

    /// Catches a run that is cut or joined at the wrong row, a row at the end of a block that is read twice or not at all, and a
    /// row with another's checksum.
    #[test]
    fn scattered_rows_land_where_they_belong() {
        let folder = tempfile::tempdir().unwrap();
        let file = hdf5::File::create(folder.path().join("t.h5")).unwrap();
        let row_count = 2 * BLOCK_ROWS + 10;
        Table::create(&file, row_count, |_| row(0)).unwrap();
        let table = Table::<LedgerRow>::open(&file, row_count, row_count).unwrap().unwrap();

        // Short runs, and one over the ends of both blocks.
        let picked = (0..row_count as u32).filter(|k| *k > 50 || k % 7 != 3);
        let rows: BTreeMap<u32, LedgerRow> = picked.map(|k| (k, row(k as usize + 1))).collect();
        table.write(&rows).unwrap();

        let expected = (0..row_count as u32).map(|k| rows.get(&k).map_or(0, |row| row.attempt));
        let read = table.read_all().unwrap();
        assert_eq!(read.iter().map(|row| row.attempt).collect::<Vec<_>>(), expected.collect::<Vec<_>>());
        assert!(read.iter().enumerate().all(|(number, row)| row.is_valid(number)));
        let mut walked = 0;
        table.for_each(|number, row| walked += usize::from(row.attempt == read[number].attempt)).unwrap();
        assert_eq!(walked, row_count);
    }

    /// Catches a reader that threads cannot share: it would not compile.
    #[test]
    fn readers_are_shared() {
        fn shared<T: Send + Sync>() {}
        shared::<crate::read::reader::Reader>();
    }

    /// Catches a table of another length being taken for this one.
    #[test]
    fn another_length_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = hdf5::File::create(folder.path().join("t.h5")).unwrap();
        Table::create(&file, 3, |_| row(0)).unwrap();
        assert!(Table::<LedgerRow>::open(&file, 3, 4).unwrap().is_none());
    }
}
