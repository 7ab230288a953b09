//! `tapline-lab figures`: the dissertation's figures of its theory, as SVG and CSV.

mod curves;
mod draw;
#[cfg(test)]
mod slips;

use std::path::Path;

use self::curves::{Figure, figure};
use anyhow::Result;

use crate::evaluation::{Table, rounded};
use crate::written::WrittenArgs;

/// Digits in tables, without those that may differ between machines.
pub(crate) const DIGITS: usize = 9;

/// Writes figure `only`, or all of them, into the folder `out`.
///
/// # Errors
/// An unknown figure, a model outside of its domain, or an error of the file system.
pub fn figures(out: &Path, only: Option<u8>, written: WrittenArgs) -> Result<()> {
    let numbers = only.map_or_else(|| Figure::NUMBERS.to_vec(), |number| vec![number]);
    let figures = numbers.into_iter().map(figure).collect::<Result<Vec<_>, _>>()?;
    let mut files = Vec::new();
    for figure in &figures {
        for (extension, text) in [("svg", draw::svg(figure)?), ("csv", csv(figure)?)] {
            files.push((out.join(format!("fig{}.{extension}", figure.number)), text));
        }
    }
    written.write(&files)
}

/// One row a point, in SI units.
fn csv(figure: &Figure) -> Result<String> {
    let mut table = Table::long("", "", ["curve", "rung", figure.x.name, figure.y.name, "in_domain"]);
    for curve in &figure.curves {
        for point in &curve.points {
            let [x, y] = [point.x, point.y].map(|value| rounded(value, DIGITS));
            let in_domain = if point.in_domain { "1" } else { "0" };
            table.push_texts([curve.name, curve.rung.name(), &x, &y, in_domain].map(str::to_owned));
        }
    }
    table.csv()
}
