//! `tapline-lab figures`: the dissertation's figures of its theory, as SVG and CSV.

mod curves;
mod draw;
mod labels;
#[cfg(test)]
mod slips;

use std::fs;
use std::io::{self, Write as _};
use std::path::Path;

use self::curves::{Figure, figure};
use anyhow::{Context as _, Result};

/// Writes figure `only`, or all of them, into the folder `out`.
///
/// # Errors
/// A number of no figure, a model outside of its domain, or an error of the file system.
pub fn figures(out: &Path, only: Option<u8>) -> Result<()> {
    let numbers = only.map_or_else(|| Figure::NUMBERS.to_vec(), |number| vec![number]);
    let figures = numbers.into_iter().map(figure).collect::<Result<Vec<_>, _>>()?;
    fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let mut out_text = io::stdout().lock();
    for figure in &figures {
        for (extension, text) in [("svg", draw::svg(figure)?), ("csv", csv(figure)?)] {
            let path = out.join(format!("fig{}.{extension}", figure.number));
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
            writeln!(out_text, "{}", path.display())?;
        }
    }
    Ok(())
}

/// One row a point, in SI units.
fn csv(figure: &Figure) -> Result<String> {
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(["curve", "rung", figure.x.name, figure.y.name, "in_domain"])?;
    for curve in &figure.curves {
        for point in &curve.points {
            let (x, y) = (significant(point.x), significant(point.y));
            out.write_record([curve.name, curve.rung.name(), &x, &y, if point.in_domain { "1" } else { "0" }])?;
        }
    }
    Ok(String::from_utf8(out.into_inner()?)?)
}

/// `value` to nine digits, without those that the next machine may compute otherwise.
pub(crate) fn significant(value: f64) -> String {
    let text = format!("{value:.8e}");
    text.parse::<f64>().map_or(text, |rounded| rounded.to_string())
}
