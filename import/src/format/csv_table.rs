//! CSV files with a header: a column for each channel.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

use csv::{Reader, ReaderBuilder, Trim};

use crate::error::{Fault, broken};
use crate::format::{Pick, Recorded, no_parts};
use crate::series::{SAMPLES_MAX, Series};

/// Longest header.
const HEADER_BYTES_MAX: u64 = 1 << 20;

/// A CSV file. Cells are separated by commas, semicolons or tabs, whichever the header has most of.
#[derive(Debug)]
pub(crate) struct CsvTable {
    path: PathBuf,
    delimiter: u8,
    names: Vec<String>,
}

impl CsvTable {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut header = Vec::new();
        std::io::Read::take(BufReader::new(File::open(path)?), HEADER_BYTES_MAX).read_until(b'\n', &mut header)?;
        let count = |delimiter: u8| header.iter().filter(|&&byte| byte == delimiter).count();
        let delimiter = [b',', b';', b'\t'].into_iter().rev().max_by_key(|&byte| count(byte)).unwrap_or(b',');
        let mut table = Self { path: path.to_owned(), delimiter, names: Vec::new() };
        let header = table.reader()?.byte_headers().map_err(fault_of)?.clone();
        let name = |cell: &[u8]| {
            let text = std::str::from_utf8(cell).map_err(|_no_text| Fault::Broken("its header is not UTF-8".into()))?;
            Ok(text.trim_start_matches('\u{feff}').trim_matches('"').to_owned())
        };
        table.names = header.iter().map(name).collect::<Result<_, Fault>>()?;
        if table.names.iter().all(|name| name.parse::<f64>().is_ok()) {
            return broken("its first line has numbers, not names; it must be a header that names the columns");
        }
        Ok(table)
    }

    fn reader(&self) -> Result<Reader<File>, Fault> {
        let file = File::open(&self.path)?;
        Ok(ReaderBuilder::new().delimiter(self.delimiter).trim(Trim::All).from_reader(file))
    }
}

fn fault_of(error: csv::Error) -> Fault {
    Fault::Broken(error.to_string())
}

impl Recorded for CsvTable {
    fn series(&mut self, part: &str, channel: &Pick, _time_axis: Option<u8>) -> Result<Series, Fault> {
        no_parts(part, "CSV")?;
        let place = channel.find(self.names.iter().map(String::as_str))?;
        let mut reader = self.reader()?;
        let (mut record, mut values) = (csv::ByteRecord::new(), Vec::new());
        while reader.read_byte_record(&mut record).map_err(fault_of)? {
            let cell = record.get(place).unwrap_or_default();
            let number: Option<f32> = std::str::from_utf8(cell).ok().and_then(|text| match self.delimiter {
                b',' => text.parse().ok(),
                // If commas do not separate cells, they may be decimal commas.
                _ => text.replacen(',', ".", 1).parse().ok(),
            });
            let Some(number) = number else {
                let line = record.position().map_or(0, csv::Position::line);
                let (name, cell) = (&self.names[place], String::from_utf8_lossy(cell));
                return broken(format!("line {line}: {name} is {cell:?}; it must be a number"));
            };
            if values.len() as u64 == SAMPLES_MAX {
                return Err(Fault::TooMany { samples: SAMPLES_MAX + 1, most: SAMPLES_MAX });
            }
            values.push(number);
        }
        if values.is_empty() { Err(Fault::Empty) } else { Series::of_floats(values) }
    }
}
