//! `tapline model table`: tables of the dissertation.

use std::io::Write as _;

use anyhow::Result;
use serde_json::{Value, json};
use tapline_host::stdout::Stdout;
use tapline_model::EffectiveLength;

pub(crate) fn model(number: u8, rule: EffectiveLength, as_json: bool) -> Result<bool> {
    let table = tapline_model::table(number, rule)?;
    if as_json {
        let row = |row: &Vec<f64>| {
            let cells = table.columns.iter().zip(row).map(|(column, &value)| ((*column).to_owned(), json!(value)));
            Value::Object(cells.collect())
        };
        writeln!(Stdout, "{}", Value::Array(table.rows.iter().map(row).collect()))?;
        return Ok(true);
    }
    let mut out = csv::Writer::from_writer(Stdout);
    out.write_record(&table.columns)?;
    for row in &table.rows {
        out.write_record(row.iter().map(ToString::to_string))?;
    }
    out.flush()?;
    Ok(true)
}
