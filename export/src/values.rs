//! A table as plain columns of values, for programs that have a format of their own.

use crate::Result;
use crate::column::{Cells, Column, Sink};

/// Rows that are handed over together.
const BATCH_ROWS: usize = 8192;

/// The type of a column's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ColumnKind {
    /// Small numbers and codes.
    U16,
    /// Counts, indices and sets of flags.
    U32,
    /// Measured and computed values, always finite.
    F64,
    /// Names and texts.
    Text,
}

/// Name, unit and type of a column. Every column may have absent values.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct ColumnInfo {
    /// Name, with the unit as its suffix where it has one.
    pub name: String,
    /// Unit of the values; "1" for a number without dimension, empty if they are not a quantity.
    pub unit: &'static str,
    /// The type of the values.
    pub kind: ColumnKind,
}

/// Values of a column, `None` where absent.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Of [`ColumnKind::U16`].
    U16(Vec<Option<u16>>),
    /// Of [`ColumnKind::U32`].
    U32(Vec<Option<u32>>),
    /// Of [`ColumnKind::F64`].
    F64(Vec<Option<f64>>),
    /// Of [`ColumnKind::Text`].
    Text(Vec<Option<String>>),
}

/// Describes columns.
pub(crate) fn infos<R>(columns: &[Column<R>]) -> Vec<ColumnInfo> {
    let info = |column: &Column<R>| ColumnInfo {
        name: column.name.clone(),
        unit: column.unit,
        kind: match column.cells {
            Cells::U16(_) => ColumnKind::U16,
            Cells::U32(_) => ColumnKind::U32,
            Cells::F64(_) => ColumnKind::F64,
            Cells::Text(_) => ColumnKind::Text,
        },
    };
    columns.iter().map(info).collect()
}

/// Hands batches of rows, column by column, to a function.
pub(crate) struct Batches<F> {
    take: F,
}

impl<F: FnMut(Vec<Values>)> Batches<F> {
    pub(crate) fn new(take: F) -> Self {
        Self { take }
    }
}

impl<F: FnMut(Vec<Values>)> Sink for Batches<F> {
    fn rows<R>(&mut self, columns: &[Column<R>], rows: impl Iterator<Item = R>) -> Result<()> {
        let mut rows = rows.peekable();
        while rows.peek().is_some() {
            let batch: Vec<R> = rows.by_ref().take(BATCH_ROWS).collect();
            (self.take)(columns.iter().map(|column| values(&column.cells, &batch)).collect());
        }
        Ok(())
    }

    fn finish(self) -> Result<()> {
        Ok(())
    }
}

fn values<R>(cells: &Cells<R>, rows: &[R]) -> Values {
    match cells {
        Cells::U16(cell) => Values::U16(rows.iter().map(cell).collect()),
        Cells::U32(cell) => Values::U32(rows.iter().map(cell).collect()),
        Cells::F64(cell) => Values::F64(rows.iter().map(cell).collect()),
        Cells::Text(cell) => Values::Text(rows.iter().map(cell).collect()),
    }
}
