//! A column of a table: the one description from which every format is written.

use crate::Result;

/// Returns the value in a row; `None` if it is absent.
type Cell<R, T> = Box<dyn Fn(&R) -> Option<T>>;

/// The cells of a column, by type.
pub(crate) enum Cells<R> {
    /// Small numbers and codes.
    U16(Cell<R, u16>),
    /// Counts, indices and sets of flags.
    U32(Cell<R, u32>),
    /// Measured and computed values, always finite.
    F64(Cell<R, f64>),
    /// Names and texts; an empty text is not an absent one.
    Text(Cell<R, String>),
}

/// One column of a table whose rows are `R`.
pub(crate) struct Column<R> {
    /// Name, with the unit as its suffix where it has one.
    pub name: String,
    /// Unit of the values; "1" for a number without dimension, empty if they are not a quantity.
    #[cfg_attr(not(feature = "parquet"), expect(dead_code, reason = "CSV has no place for units"))]
    pub unit: &'static str,
    /// Whether the CSV has it too; CSV has the names of flags but not their bits.
    pub is_in_csv: bool,
    /// The values.
    pub cells: Cells<R>,
}

impl<R> Column<R> {
    fn new(name: impl Into<String>, unit: &'static str, cells: Cells<R>) -> Self {
        Self { name: name.into(), unit, is_in_csv: true, cells }
    }

    /// A column of small numbers, some of which may be absent.
    pub(crate) fn u16<V: Into<Option<u16>>>(name: &str, cell: impl Fn(&R) -> V + 'static) -> Self {
        Self::new(name, "", Cells::U16(Box::new(move |row| cell(row).into())))
    }

    /// A column of whole numbers, some of which may be absent.
    pub(crate) fn u32<V: Into<Option<u32>>>(name: &str, cell: impl Fn(&R) -> V + 'static) -> Self {
        Self::new(name, "", Cells::U32(Box::new(move |row| cell(row).into())))
    }

    /// A column of quantities in `unit`; values that are not finite are absent.
    pub(crate) fn f64<V: Into<Option<f64>>>(
        name: impl Into<String>,
        unit: &'static str,
        cell: impl Fn(&R) -> V + 'static,
    ) -> Self {
        Self::new(name, unit, Cells::F64(Box::new(move |row| cell(row).into().filter(|value| value.is_finite()))))
    }

    /// A column of texts, some of which may be absent.
    pub(crate) fn text<V: Into<Option<String>>>(name: &str, cell: impl Fn(&R) -> V + 'static) -> Self {
        Self::new(name, "", Cells::Text(Box::new(move |row| cell(row).into())))
    }

    /// The bits of a set of flags; their names are another column.
    pub(crate) fn bits(name: &str, cell: impl Fn(&R) -> u32 + 'static) -> Self {
        Self { is_in_csv: false, ..Self::u32(name, cell) }
    }
}

/// A format in which a table can be written.
pub(crate) trait Sink {
    /// Appends `rows`, with the same columns as rows before.
    fn rows<R>(&mut self, columns: &[Column<R>], rows: impl Iterator<Item = R>) -> Result<()>;
}
