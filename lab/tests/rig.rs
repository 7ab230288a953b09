//! What the tests share: a folder of its own for each, the built program in it, and what it left behind.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

/// A fresh folder in which the built program is run.
pub(crate) struct Rig {
    folder: TempDir,
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self { folder: TempDir::new().unwrap() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program with `arguments`, split at spaces, to its end.
    pub(crate) fn run(&self, arguments: &str) -> Done {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tapline-lab"));
        let output = command.args(arguments.split_whitespace()).current_dir(self.folder.path()).output().unwrap();
        let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        Done { code: output.status.code(), out, err }
    }
}

/// How the program ended and what it said.
#[derive(Debug)]
pub(crate) struct Done {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Done {
    /// The program's JSON, after checking that it ended with `code`.
    pub(crate) fn json(&self, code: i32) -> Value {
        assert_eq!(self.code, Some(code), "{self:#?}");
        serde_json::from_str(&self.out).unwrap()
    }

    pub(crate) fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self:#?}");
        self
    }
}

/// Columns of a CSV text by name, one map a row.
pub(crate) fn csv_rows(text: &str) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.unwrap()).collect()
}

/// A file or folder among the committed documents.
pub(crate) fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name)
}

/// A file's text.
pub(crate) fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The files in `folder`, and the page beside it, by name.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, String> {
    let inside = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let page = folder.with_added_extension("md");
    inside.chain([page]).map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), text(&path))).collect()
}
