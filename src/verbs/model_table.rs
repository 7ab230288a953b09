//! `tapline model table`: tables of the dissertation.

use std::io;

use anyhow::Result;
use tapline_model::EffectiveLength;

use crate::cli::model::Length;

pub(crate) fn model(number: u8, length: Length) -> Result<bool> {
    let rule = match length {
        Length::Published => EffectiveLength::Published,
        Length::Table1 => EffectiveLength::Table1,
    };
    let table = tapline_model::table(number, rule)?;
    let mut out = csv::Writer::from_writer(io::stdout().lock());
    out.write_record(&table.columns)?;
    for row in &table.rows {
        out.write_record(row.iter().map(ToString::to_string))?;
    }
    out.flush()?;
    Ok(true)
}
