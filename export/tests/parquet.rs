//! Exported Parquet files, read back by this crate's library and by pyarrow.

use std::fs::File;
use std::process::Command;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{Float64Type, UInt16Type, UInt32Type};
use arrow_array::{Array as _, ArrayRef, RecordBatch};
use arrow_schema::DataType;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use tapline_export::{Export, TableFile};
use tapline_store::Reader;
use tapline_wire::Quality;

use crate::common;
use crate::tables::unfinished;
use crate::write;

/// Columns that only Parquet has: the bits of what CSV names in words.
const BITS: [&str; 2] = ["quality_bits", "reasons_bits"];

/// Header and cells of a table as CSV.
fn as_csv(reader: &Reader, table: Export) -> (Vec<String>, Vec<Vec<String>>) {
    let mut out = Vec::new();
    write(TableFile::csv(table, &mut out), reader);
    let mut csv = csv::Reader::from_reader(out.as_slice());
    let texts = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<_>>();
    let header = texts(csv.headers().unwrap());
    (header, csv.records().map(|record| texts(&record.unwrap())).collect())
}

/// Whether a cell has the value of the CSV cell, in the type of its column.
fn is_same(array: &ArrayRef, row: usize, csv: &str) -> bool {
    if array.is_null(row) {
        return csv.is_empty();
    }
    match array.data_type() {
        DataType::UInt16 => csv.parse() == Ok(array.as_primitive::<UInt16Type>().value(row)),
        DataType::UInt32 => csv.parse() == Ok(array.as_primitive::<UInt32Type>().value(row)),
        DataType::Float64 => csv.parse() == Ok(array.as_primitive::<Float64Type>().value(row)),
        DataType::Utf8 => csv == array.as_string::<i32>().value(row),
        _ => false,
    }
}

/// Catches a column, row, value or absence that differs between the two formats, and a number that became text.
#[test]
fn parquet_is_the_csv_cell_by_cell() {
    let _guard = common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let reader = unfinished(&folder);
    for table in Export::ALL {
        let path = folder.path().join("table.parquet");
        write(TableFile::parquet(table, File::create(&path).unwrap()), &reader);
        let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(&path).unwrap()).unwrap();
        let schema = builder.schema().clone();
        let names: Vec<&str> =
            schema.fields().iter().map(|f| f.name().as_str()).filter(|n| !BITS.contains(n)).collect();
        let (header, rows) = as_csv(&reader, table);
        assert_eq!(names, header, "{table:?}");
        let mut done = 0;
        let batches: Vec<RecordBatch> = builder.build().unwrap().map(Result::unwrap).collect();
        for batch in &batches {
            for row in 0..batch.num_rows() {
                for (name, cell) in header.iter().zip(&rows[done]) {
                    let array = batch.column_by_name(name).unwrap();
                    assert!(is_same(array, row, cell), "{table:?} row {done} {name}: {cell:?} in {array:?}");
                }
                done += 1;
            }
        }
        assert_eq!(done, rows.len(), "{table:?}");
        // A tap without a reason has none; one without flags has an empty text.
        let null_count =
            |name: &str| batches.iter().filter_map(|b| b.column_by_name(name)).map(|a| a.null_count()).sum::<usize>();
        assert_eq!(null_count("reason"), if table == Export::Ledger { 9 } else { 0 });
        assert_eq!(null_count("quality"), 0);
        assert!(done > 0);
    }
}

/// Catches quantities without their unit, flags without their bits, and a file that does not say where it comes from.
#[test]
fn units_bits_and_origin_are_in_the_file() {
    let _guard = common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let reader = unfinished(&folder);
    let mut found = Vec::new();
    write(TableFile::parquet(Export::Discriminators, &mut found), &reader);
    let path = folder.path().join("found.parquet");
    std::fs::write(&path, found).unwrap();
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(&path).unwrap()).unwrap();
    let entries = builder.metadata().file_metadata().key_value_metadata().unwrap().clone();
    let entry = |key: &str| entries.iter().find(|e| e.key == key).and_then(|e| e.value.clone());
    assert_eq!(entry("tapline.table").unwrap(), "discriminators");
    assert_eq!(entry("tapline.plan_digest").unwrap(), format!("{:016x}", reader.plan().digest()));
    assert_eq!(entry("tapline.written_by"), reader.written_by());
    assert_eq!(entry("tapline.exported_by").unwrap(), env!("CARGO_PKG_VERSION"));
    for field in builder.schema().fields() {
        let unit = field.metadata().get("unit").map(String::as_str);
        // Units that follow from the scale of a channel are in columns of their own.
        let is_scaled = ["f_max", "a_1", "a_2", "p_f", "e_f"].contains(&field.name().as_str());
        assert_eq!(unit.is_some(), *field.data_type() == DataType::Float64 && !is_scaled, "{field}");
        // The unit is the suffix of the name, spelt differently.
        let ends = [("_s", "s"), ("_hz", "Hz")];
        let ends = ends.into_iter().chain([("_mm", "mm"), ("_m_per_s", "m/s"), ("_deg", "deg"), ("pr", "1")]);
        let longest = ends.filter(|(end, _)| field.name().ends_with(end)).max_by_key(|(end, _)| end.len());
        if let Some(unit) = unit {
            assert_eq!(Some(unit), longest.map(|(_, unit)| unit), "{field}");
        }
    }
    let batch = builder.build().unwrap().next().unwrap().unwrap();
    let bits = batch.column_by_name("quality_bits").unwrap().as_primitive::<UInt32Type>().values().to_vec();
    let no_force = Quality::NO_FORCE.bits();
    assert_eq!(bits, [0, 0, no_force, 0, no_force, 0, 0, no_force]);
}

/// Prints what another program reads: types, units, metadata, rows and absent values.
const SCRIPT: &str = r#"
import sys, pyarrow as pa, pyarrow.parquet as pq
table = pq.read_table(sys.argv[1])
field = table.schema.field("tau_s")
print(field.type, field.metadata[b"unit"].decode(), table.schema.field("location").type, table.schema.field("tyre").type)
print(pq.read_metadata(sys.argv[1]).metadata[b"tapline.plan_digest"].decode(), table.num_rows, table["tau_s"].null_count)
print(table["tyre"][0].as_py(), table["pr"].to_pylist(), table["quality"].to_pylist()[2])
"#;

/// Catches a file that only the library that wrote it can read.
#[test]
fn pyarrow_reads_the_same() {
    let _guard = common::alone();
    let Some(python) = tapline_testing::python_with("pyarrow.parquet") else { return };
    let folder = tempfile::tempdir().unwrap();
    let reader = unfinished(&folder);
    let path = folder.path().join("found.parquet");
    write(TableFile::parquet(Export::Discriminators, File::create(&path).unwrap()), &reader);
    let out = Command::new(python).env("PYTHONIOENCODING", "utf-8").args(["-c", SCRIPT]).arg(&path).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let expected = [
        "double s uint32 string".to_owned(),
        format!("{:016x} 8 3", reader.plan().digest()),
        "A\u{e9}-1 [0.5, 1.5, 2.5, 4.5, 5.5, 6.5, 7.5, 8.5] no_force".to_owned(),
    ];
    assert_eq!(String::from_utf8_lossy(&out.stdout).lines().collect::<Vec<_>>(), expected);
}
