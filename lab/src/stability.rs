//! Draws the breakdown curves: how wrong each discriminator and each contact model gets as a disturbance grows.
//!
//! `tapline-lab stability` writes `docs/stability`: a picture and a table each, and an index.

mod curves;
mod draw;
mod tap;

pub(crate) use self::tap::{COUNT, PRE_TRIGGER, RATE_HZ, Tap, add_hum, add_offset};

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};

/// Draws every curve, and writes pictures, tables and their index into the folder `out`.
///
/// # Errors
/// An error of the file system, or the library of a picture.
pub fn write(out: &Path) -> Result<()> {
    let folder = out;
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let write = |name: String, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    };
    let mut index = String::from(
        "# Breakdown curves\n\nHow wrong a number gets as a disturbance grows: relative errors against the undisturbed tap, or against the full rung of the contact models. `tapline-lab stability` writes this page. Errors below 1e-9 are drawn at 1e-9; a line ends where the value is absent. The configuration is the default, except that every policy is `keep`: by default a flag would make doubtful values absent. Grey squares at the bottom mark where a flag is raised; the tables name it.\n",
    );
    for curve in curves::curves() {
        write(format!("{}.csv", curve.name), &curve.csv())?;
        write(format!("{}.svg", curve.name), &draw::svg(&curve)?)?;
        let (title, name, sentence) = (curve.title, curve.name, curve.sentence);
        index.push_str(&format!(
            "\n## {title}\n\n{sentence} Table: [{name}.csv]({name}.csv)\n\n![{title}]({name}.svg)\n"
        ));
    }
    write("README.md".to_owned(), &index)
}

#[cfg(test)]
mod tests;
