//! Draws the breakdown curves: how wrong each discriminator and each contact model gets as a disturbance grows.
//!
//! `tapline-lab stability` writes `docs/stability`: a picture and a table per curve, and an index.

mod curves;
mod draw;
mod tap;

pub(crate) use self::tap::{Tap, add_hum, add_neighbour, add_offset};

use std::path::Path;

use anyhow::Result;

use crate::written::WrittenArgs;

/// Draws every curve, and writes pictures, tables and their index into the folder `out`.
///
/// # Errors
/// An error of the file system or of the drawing library.
pub fn write(out: &Path, written: WrittenArgs) -> Result<()> {
    written.check(&out.join("README.md"))?;
    let mut files = Vec::new();
    let mut index = String::from(
        "# Breakdown curves\n\nHow wrong a number gets as a disturbance grows: relative errors against the undisturbed tap, or against the full rung of the contact models. `tapline-lab stability --force` writes this page. Axes span the data; an error too small for its axis is drawn on the lowest line (\"below\" next to a name: all its errors are), and a line ends where the value is absent. The configuration is the default, except that every policy is `keep`: by default a flag would make doubtful values absent. The background is grey where a flag is raised; the legend and the tables name the flags.\n",
    );
    for curve in curves::curves() {
        files.push((out.join(format!("{}.csv", curve.name)), curve.csv()?));
        files.push((out.join(format!("{}.svg", curve.name)), draw::picture(&curve)?.svg()?));
        let (title, name, sentence) = (curve.title, curve.name, curve.sentence);
        index.push_str(&format!(
            "\n## {title}\n\n{sentence} Table: [{name}.csv]({name}.csv)\n\n![{title}]({name}.svg)\n"
        ));
    }
    files.push((out.join("README.md"), index));
    written.write(&files)
}

#[cfg(test)]
mod tests;
