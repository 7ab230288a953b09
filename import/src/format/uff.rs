//! Universal Files: datasets 58 and 58b, functions of time.
//!
//! Source: the records of datasets 58 and 58b as the Structural Dynamics Research Laboratory of the University of Cincinnati
//! publishes them.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use crate::error::{Fault, broken, listed};
use crate::format::{Pick, Recorded, place_of};
use crate::series::{Series, checked_count};

/// Longest line, of text with 80 characters.
const LINE_BYTES_MAX: u64 = 1024;

/// Error of a time step that has six digits.
const STEP_ERROR: f64 = 1e-5;

/// A Universal File.
#[derive(Debug)]
pub(crate) struct Uff {
    file: BufReader<File>,
    functions: Vec<Function>,
}

/// One dataset 58: how its values lie in the file, and what they are.
#[derive(Debug)]
struct Function {
    /// Label of the ordinate, first ID line, name of the response.
    names: [String; 3],
    /// 1 for a time response, 0 for a general function.
    kind: i64,
    /// 2 and 4 for real values of single and double precision.
    value_type: i64,
    is_even: bool,
    count: u64,
    first_s: f64,
    step_s: f64,
    /// The exact rate, in the ID lines of an export of this program.
    stated_rate_hz: Option<f64>,
    unit: String,
    /// Of values that are not text, whether they are big-endian.
    binary: Option<bool>,
    at: u64,
    bytes: u64,
}

impl Function {
    /// The names that it is found by, in words. `NONE` stands for none.
    fn names_in_words(&self) -> String {
        let known: Vec<&String> = self.names.iter().filter(|name| !name.is_empty() && *name != "NONE").collect();
        let distinct = known.iter().enumerate().filter(|(place, name)| !known[..*place].contains(name));
        let quoted: Vec<String> = distinct.map(|(_, name)| format!("{name:?}")).collect();
        if quoted.is_empty() { "one without a name".to_owned() } else { quoted.join(" or ") }
    }
}

impl Uff {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut uff = Self { file: BufReader::new(File::open(path)?), functions: Vec::new() };
        let file_bytes = uff.file.get_ref().metadata()?.len();
        let mut is_uff = false;
        while let Some(line) = uff.line()? {
            if line.trim() != "-1" {
                continue;
            }
            let Some(kind) = uff.line()? else { break };
            is_uff = true;
            match field(&kind, 0, 6) {
                "58" => {
                    let function = uff.function(&kind, file_bytes)?;
                    uff.functions.push(function);
                }
                _ => uff.skip_to_end()?,
            }
        }
        match (is_uff, uff.functions.is_empty()) {
            (false, _) => broken("is not a Universal File: none of its lines is -1"),
            (true, true) => broken("has no dataset 58"),
            _ => Ok(uff),
        }
    }

    /// The next line; `None` at the end.
    fn line(&mut self) -> Result<Option<String>, Fault> {
        let mut line = Vec::new();
        self.file.by_ref().take(LINE_BYTES_MAX).read_until(b'\n', &mut line)?;
        match line.len() {
            0 => Ok(None),
            n if n as u64 == LINE_BYTES_MAX && line.last() != Some(&b'\n') => {
                broken(format!("has a line of more than {LINE_BYTES_MAX} bytes; Universal Files have 80"))
            }
            // One character for each byte, so that fields keep their places.
            _ => Ok(Some(line.iter().map(|&byte| char::from(byte)).filter(|c| !"\r\n".contains(*c)).collect())),
        }
    }

    fn needed(&mut self) -> Result<String, Fault> {
        self.line()?.ok_or_else(|| Fault::Broken("ends within a dataset 58".to_owned()))
    }

    fn skip_to_end(&mut self) -> Result<(), Fault> {
        while let Some(line) = self.line()? {
            if line.trim() == "-1" {
                return Ok(());
            }
        }
        broken("ends within a dataset")
    }

    /// The dataset whose first line is `kind`.
    fn function(&mut self, kind: &str, file_bytes: u64) -> Result<Function, Fault> {
        let binary = match kind.get(6..7) {
            Some("b" | "B") => Some(match (integer(kind, 7, 6)?, integer(kind, 13, 6)?) {
                (1, 2) => false,
                (2, 2) => true,
                (order, form) => {
                    return broken(format!(
                        "a dataset 58b has byte order {order} and floating point format {form}; orders 1 and 2 of format 2 are read"
                    ));
                }
            }),
            _ => None,
        };
        let mut id = Vec::new();
        for _ in 0..5 {
            id.push(self.needed()?);
        }
        let (dof, form) = (self.needed()?, self.needed()?);
        let abscissa = self.needed()?;
        let ordinate = self.needed()?;
        // Denominator and third axis.
        self.needed()?;
        self.needed()?;
        let kind_of_abscissa = integer(&abscissa, 0, 10)?;
        if ![0, 17].contains(&kind_of_abscissa) && [0, 1].contains(&integer(&dof, 0, 5)?) {
            return broken(format!(
                "a dataset 58 is a function of quantity {kind_of_abscissa}; functions of time (17) are read"
            ));
        }
        let at = self.file.stream_position()?;
        let bytes = match binary {
            Some(_) => {
                let bytes = u64::try_from(integer(kind, 31, 12)?).unwrap_or(0);
                let got = file_bytes.saturating_sub(at);
                if bytes > got {
                    return broken(format!(
                        "is cut short: a dataset 58b promises {bytes} bytes of values; {got} follow"
                    ));
                }
                self.file.seek(SeekFrom::Start(at + bytes))?;
                bytes
            }
            None => 0,
        };
        self.skip_to_end()?;
        let bytes = if binary.is_some() { bytes } else { self.file.stream_position()? - at };
        Ok(Function {
            names: [field(&ordinate, 26, 20), id[0].trim(), field(&dof, 31, 10)].map(str::to_owned),
            kind: integer(&dof, 0, 5)?,
            value_type: integer(&form, 0, 10)?,
            is_even: integer(&form, 20, 10)? == 1,
            count: u64::try_from(integer(&form, 10, 10)?).unwrap_or(0),
            first_s: number(field(&form, 30, 13))?,
            step_s: number(field(&form, 43, 13))?,
            stated_rate_hz: id[4]
                .split_once("sample_rate_hz ")
                .and_then(|(_, rest)| rest.split(' ').next()?.parse().ok()),
            unit: field(&ordinate, 47, 20).to_owned(),
            binary,
            at,
            bytes,
        })
    }

    /// The place of a channel among the functions.
    fn place(&self, part: &str, channel: &Pick) -> Result<usize, Fault> {
        let count = self.functions.len();
        let first = match part {
            "" => 0,
            part => {
                part.parse::<usize>().ok().and_then(|n| n.checked_sub(1)).filter(|&n| n < count).ok_or_else(|| {
                    let known = format!("{count} functions, whose numbers, from 1, are their parts");
                    Fault::Missing { what: "part", name: format!("{part:?}"), known }
                })?
            }
        };
        // A tap ends where its first channel comes again.
        let label = |place: usize| &self.functions[place].names[0];
        let end = match part {
            "" => count,
            _ => (first + 1..count).find(|&place| label(place) == label(first)).unwrap_or(count),
        };
        let missing = || {
            let known = listed(self.functions[first..end].iter().map(Function::names_in_words));
            Fault::Missing { what: "channel", name: channel.to_string(), known }
        };
        match channel {
            Pick::Number(number) => {
                number.checked_sub(1).map(|n| first + n).filter(|&place| place < end).ok_or_else(missing)
            }
            Pick::Name(name) => {
                let labels = self.functions[first..end].iter().flat_map(|of| of.names.iter().map(String::as_str));
                let labels: Vec<&str> = labels.collect::<BTreeSet<_>>().into_iter().collect();
                // As it is written there, where its case is another.
                let name = place_of(name, labels.iter().copied()).map_or(name.as_str(), |place| labels[place]);
                let mut found =
                    (first..end).filter(|&place| self.functions[place].names.iter().any(|known| known == name));
                match (found.next(), found.count()) {
                    (None, _) => Err(missing()),
                    (Some(place), 0) => Ok(place),
                    (Some(_), more) => broken(format!(
                        "has {} functions called {name:?}; say which by the part, the number of a tap's first function",
                        more + 1
                    )),
                }
            }
        }
    }
}

/// The field of `width` characters from `from` on, without blanks.
fn field(line: &str, from: usize, width: usize) -> &str {
    // A line holds one character for each byte, some of them of two bytes.
    let at = |n: usize| line.char_indices().nth(n).map_or(line.len(), |(at, _)| at);
    line[at(from)..at(from + width)].trim()
}

fn integer(line: &str, from: usize, width: usize) -> Result<i64, Fault> {
    let text = field(line, from, width);
    text.parse().or_else(|_| broken(format!("a dataset 58 has {text:?} where a whole number belongs")))
}

/// A number of Fortran, whose exponent may be written with D.
fn number(text: &str) -> Result<f64, Fault> {
    let plain = text.trim().replace(['D', 'd'], "E");
    plain.parse().or_else(|_| broken(format!("a dataset 58 has {text:?} where a number belongs")))
}

impl Recorded for Uff {
    fn parts(&self, _depth: usize) -> Result<Vec<String>, Fault> {
        broken("the parts of a Universal File are numbers of functions, which name no tap: list them in a table")
    }

    fn series(&mut self, part: &str, channel: &Pick, _time_axis: Option<u8>) -> Result<Series, Fault> {
        let place = self.place(part, channel)?;
        let &Function { kind, value_type, is_even, count, first_s, step_s, stated_rate_hz, binary, at, bytes, .. } =
            &self.functions[place];
        let what = |what: String| broken(format!("function {} {what}", place + 1));
        if ![0, 1].contains(&kind) {
            return what(format!("is of type {kind}; time responses (1) are read"));
        }
        if ![2, 4].contains(&value_type) {
            return what(format!("has values of type {value_type}; real ones (2 and 4) are read"));
        }
        if !is_even {
            return what("has samples at uneven times; a tap set needs a rate".to_owned());
        }
        let sample_count = checked_count(count)?;
        self.file.seek(SeekFrom::Start(at))?;
        let mut series = match binary {
            Some(is_big_endian) => {
                let value_bytes = if value_type == 2 { 4 } else { 8 };
                if count * value_bytes > bytes {
                    return broken(format!("function {} promises {count} values in {bytes} bytes", place + 1));
                }
                let mut values = vec![0; sample_count * usize::try_from(value_bytes).unwrap_or(8)];
                self.file.read_exact(&mut values)?;
                if value_type == 2 {
                    let read = if is_big_endian { f32::from_be_bytes } else { f32::from_le_bytes };
                    Series::of_floats(values.as_chunks().0.iter().map(|&value| read(value)).collect())?
                } else {
                    let read = if is_big_endian { f64::from_be_bytes } else { f64::from_le_bytes };
                    Series::of_doubles(&values.as_chunks().0.iter().map(|&value| read(value)).collect::<Vec<_>>())?
                }
            }
            None => {
                // Values are 13 or 20 characters wide, with nothing between them.
                let width = if value_type == 2 { 13 } else { 20 };
                let mut values = Vec::new();
                while values.len() < sample_count {
                    let line = self.line()?.filter(|line| line.trim() != "-1");
                    let Some(line) = line.filter(|_| self.file.stream_position().is_ok_and(|now| now <= at + bytes))
                    else {
                        return broken(format!(
                            "function {} promises {count} values; it has {}",
                            place + 1,
                            values.len()
                        ));
                    };
                    let line = line.trim_end();
                    for k in 0..line.len().div_ceil(width).min(sample_count - values.len()) {
                        values.push(number(field(line, k * width, width))?);
                    }
                }
                Series::of_doubles(&values)?
            }
        };
        series.sample_rate_hz = rate_of(step_s, stated_rate_hz);
        series.pre_trigger_samples = samples_before(first_s, step_s);
        let unit = &self.functions[place].unit;
        series.unit = (!["", "NONE"].contains(&unit.as_str())).then(|| unit.clone());
        Ok(series)
    }
}

/// The rate of a time step that has six digits: the stated rate if it agrees, else whole hertz if they agree.
fn rate_of(step_s: f64, stated_hz: Option<f64>) -> Option<f64> {
    let rate_hz = 1.0 / step_s;
    let candidates = [stated_hz, Some(rate_hz.round())].into_iter().flatten();
    let found = candidates.into_iter().find(|hz| ((hz - rate_hz) / rate_hz).abs() < STEP_ERROR);
    Some(found.unwrap_or(rate_hz)).filter(|hz| hz.is_finite() && *hz > 0.0)
}

fn samples_before(first_s: f64, step_s: f64) -> Option<u32> {
    let before = -first_s / step_s;
    let whole = before.round();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in bounds")]
    let count = (0.0..1e9).contains(&whole).then_some(whole as u32);
    // Both times have six digits.
    count.filter(|_| (before - whole).abs() <= 2.0 * STEP_ERROR * whole + 1e-6 && (whole > 0.0 || first_s == 0.0))
}
