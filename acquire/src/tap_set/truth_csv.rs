//! `truth.csv`: known cracks, for scoring.

use std::collections::BTreeMap;
use std::path::Path;

use tapline_wire::{Serial, Truth, csv_text};

use crate::Error;
use crate::tap_set::table::read_rows;
use crate::tap_set::taps_csv::LOCATION_MAX;

const COLUMNS: &[&str] = &["tyre", "shoulder", "location", "cracked"];

/// Reads the `text` of `file`.
pub(crate) fn parse(file: &Path, text: &str) -> Result<Truth, Error> {
    let mut truth = Truth::new();
    let mut line_of = BTreeMap::new();
    read_rows(file, text, (COLUMNS, &[]), |row| -> Result<(), Error> {
        let tyre = Serial::new(csv_text(row.text("tyre"))).map_err(|e| row.refuse("tyre", e.bound()))?;
        let shoulder = row.needed("shoulder", 1, u16::MAX)?;
        let location = row.needed("location", 0, LOCATION_MAX)?;
        let is_cracked = match row.text("cracked") {
            "0" | "false" => false,
            "1" | "true" => true,
            _ => return Err(row.refuse("cracked", "0, 1, false or true")),
        };
        let key = (tyre, shoulder, location);
        if let Some(first) = line_of.insert(key, row.line()) {
            let what = format!("tyre {tyre} shoulder {shoulder} location {location}");
            return Err(Error::Duplicate { file: file.to_owned(), what, first, second: row.line() });
        }
        truth.insert(key, is_cracked);
        Ok(())
    })?;
    Ok(truth)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(rows: &str) -> Result<Truth, Error> {
        parse(Path::new("truth.csv"), &format!("tyre,shoulder,location,cracked\n{rows}"))
    }

    /// Catches sound and cracked swapped, and a spelling that is not understood.
    #[test]
    fn truth_is_read() {
        assert!(
            parsed("'=T,1,0,0\n").unwrap().contains_key(&(Serial::new("=T").unwrap(), 1, 0)),
            "as exports write it"
        );
        let truth = parsed("T,1,0,0\nT,1,1,1\nT,2,0,true\nT,2,1,false\n").unwrap();
        let tyre = Serial::new("T").unwrap();
        let cracked: Vec<_> = truth.iter().filter(|&(_, &c)| c).map(|(&key, _)| key).collect();
        assert_eq!((truth.len(), cracked), (4, vec![(tyre, 1, 1), (tyre, 2, 0)]));
    }

    /// Catches a contradiction that is accepted.
    #[test]
    fn faults_are_reported() {
        let error = parsed("T,1,0,0\nT,1,0,1\n").unwrap_err().to_string();
        assert_eq!(error, "truth.csv line 3: names tyre T shoulder 1 location 0 again; line 2 has it already");
        let error = parsed("T,1,0,maybe\n").unwrap_err().to_string();
        assert_eq!(error, "truth.csv line 2: cracked is \"maybe\"; it must be 0, 1, false or true");
    }
}
