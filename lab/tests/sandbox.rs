//! What the tests share: a folder for each, the built program run in it, and the files it leaves.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tapline_testing::documents::{csv_rows, text};
use tapline_testing::program::Done;
use tempfile::TempDir;

/// A fresh folder in which the built program is run.
pub(crate) struct Sandbox {
    folder: TempDir,
}

impl Sandbox {
    pub(crate) fn new() -> Self {
        Self { folder: TempDir::new().unwrap() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program with `arguments`, split at spaces, to its end.
    pub(crate) fn run(&self, arguments: &str) -> Done {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tapline-lab"));
        Done::from(command.args(arguments.split_whitespace()).current_dir(self.folder.path()).output().unwrap())
    }
}

/// The files in `folder`, and the page beside it where there is one, by name.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, String> {
    let inside = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let page = folder.with_added_extension("md");
    inside
        .chain(Some(page).filter(|page| page.is_file()))
        .map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), text(&path)))
        .collect()
}

/// The first place at which two texts differ in a number by more than is `allowed` of it, or at all in anything else.
pub(crate) fn difference(kept: &str, made: &str, allowed: impl Fn(f64) -> f64) -> Option<String> {
    let words = |text: &str| -> Vec<String> {
        let is_between = |c: char| c.is_whitespace() || matches!(c, ',' | ';' | '|' | ':' | '"');
        text.split(is_between).filter(|word| !word.is_empty()).map(str::to_owned).collect()
    };
    let (kept, made) = (words(kept), words(made));
    if kept.len() != made.len() {
        return Some(format!("{} words are now {}", kept.len(), made.len()));
    }
    let differs = |(kept, made): &(&String, &String)| match (kept.parse::<f64>(), made.parse::<f64>()) {
        (Ok(kept), Ok(made)) => (kept - made).abs() > allowed(kept),
        _ => kept != made,
    };
    kept.iter().zip(&made).find(differs).map(|(kept, made)| format!("{kept} is now {made}"))
}

/// What identifies the tables of pictures, which are not kept: of each numeric column, how many numbers it has, the mean of their
/// magnitudes, and their root mean square.
pub(crate) fn columns(files: &BTreeMap<String, String>) -> String {
    let mut lines = String::new();
    for (name, table) in files.iter().filter(|(name, _)| name.starts_with("fig") && name.ends_with(".csv")) {
        let rows = csv_rows(table);
        let names: BTreeSet<&String> = rows.iter().flat_map(|row| row.keys()).collect();
        for column in names {
            let numbers: Vec<f64> = rows.iter().filter_map(|row| row[column].parse().ok()).collect();
            let count = numbers.len() as f64;
            let mean = numbers.iter().map(|x| x.abs()).sum::<f64>() / count;
            let rms = (numbers.iter().map(|x| x * x).sum::<f64>() / count).sqrt();
            if !numbers.is_empty() {
                lines.push_str(&format!("{name},{column},{count},{mean:.9e},{rms:.9e}\n"));
            }
        }
    }
    lines
}
