//! What the tests share: a folder of its own for each, the built program in it, and what it left behind.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tapline_store::{OwnedSamples, Reader};
use tapline_wire::{DamageCell, Discriminators, Judgement, Stamp, TapHeader, TapState};
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

    /// Writes a file into the folder.
    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// The program with `arguments`, split at spaces.
    ///
    /// A run must name its reference; where a test does not care, each tyre is its own.
    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = self.plain(arguments);
        let is_judged = ["run ", "line "].iter().any(|verb| arguments.starts_with(verb));
        if is_judged && !self.names_reference(arguments) {
            command.args(["--reference", "self"]);
        }
        command
    }

    /// The program with `arguments` and nothing else.
    pub(crate) fn plain(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tapline"));
        command.args(arguments.split_whitespace()).current_dir(self.folder.path()).stdin(Stdio::null());
        // Private and short: its lines work below it.
        command.env("XDG_RUNTIME_DIR", self.folder.path());
        command
    }

    /// Whether the arguments, or the configuration they name, say what shoulders are compared with.
    fn names_reference(&self, arguments: &str) -> bool {
        let config = arguments.split_whitespace().skip_while(|&word| word != "--config").nth(1);
        let text = config.map(|name| fs::read_to_string(self.path(name)).unwrap_or_default());
        arguments.contains("--reference")
            || arguments.contains("--help")
            || text.is_some_and(|t| t.contains("reference ="))
    }

    /// Runs the program to its end.
    pub(crate) fn run(&self, arguments: &str) -> Done {
        Done::from(self.command(arguments).output().unwrap())
    }

    /// Starts the program and goes on.
    pub(crate) fn start(&self, arguments: &str) -> Child {
        self.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Folders that lines have left; while one is there, shared memory may be too.
    pub(crate) fn left(&self) -> Vec<String> {
        let files = fs::read_dir(self.folder.path()).unwrap().flatten();
        files
            .map(|f| f.file_name().to_string_lossy().into_owned())
            .filter(|name| name.starts_with("tapline-"))
            .collect()
    }
}

/// How a program ended and what it said.
#[derive(Debug)]
pub(crate) struct Done {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl From<Output> for Done {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Done {
    /// The program's JSON, of a run the last, which is its summary, after checking that it ended with `code`.
    pub(crate) fn json(&self, code: i32) -> Value {
        assert_eq!(self.code, Some(code), "{self:#?}");
        let values = serde_json::Deserializer::from_str(&self.out).into_iter();
        values.map(Result::unwrap).last().unwrap_or_else(|| panic!("no JSON: {self:#?}"))
    }

    pub(crate) fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self:#?}");
        self
    }
}

/// The process that is the stage `name` (`store`, `acquire-0`) of the line `parent`, once it is there.
pub(crate) fn stage(parent: &Child, name: &str) -> i32 {
    let deadline = Instant::now() + Duration::from_secs(10);
    while Instant::now() < deadline {
        if let Some(pid) = stage_now(parent, name) {
            return pid;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no stage {name:?}");
}

/// The process that is the stage `name` of the line `parent`, if it is there now.
pub(crate) fn stage_now(parent: &Child, name: &str) -> Option<i32> {
    fs::read_dir("/proc").unwrap().flatten().find_map(|entry| {
        let pid: i32 = entry.file_name().to_str()?.parse().ok()?;
        let stat = fs::read_to_string(entry.path().join("stat")).ok()?;
        let parent_pid: u32 = stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
        let line = fs::read_to_string(entry.path().join("cmdline")).ok()?.replace('\0', " ");
        let arguments = line.split_once(' ')?.1;
        (parent_pid == parent.id() && arguments.starts_with(&format!("stage {name} "))).then_some(pid)
    })
}

/// Sends `signal` to a process, which must be there.
pub(crate) fn signal(pid: i32, signal: rustix::process::Signal) {
    rustix::process::kill_process(rustix::process::Pid::from_raw(pid).unwrap(), signal).unwrap();
}

/// Everything in an archive that must not depend on when and how it was written.
#[derive(Debug, PartialEq)]
pub(crate) struct Contents {
    pub(crate) states: Vec<TapState>,
    pub(crate) taps: Vec<Option<(TapHeader, OwnedSamples)>>,
    pub(crate) discriminators: Vec<Option<String>>,
    pub(crate) judgements: Vec<Option<String>>,
}

/// Bytes of the archive's file that a table takes.
pub(crate) fn table_bytes(archive: &Path, table: &str) -> Range<usize> {
    let file = hdf5::File::open(archive).unwrap();
    let table = file.dataset(table).unwrap();
    let start = table.offset().unwrap() as usize;
    start..start + table.storage_size() as usize
}

/// Turns the lowest bit of byte `at` of a table.
pub(crate) fn bend(archive: &Path, table: &str, at: usize) {
    let start = table_bytes(archive, table).start;
    let mut bytes = fs::read(archive).unwrap();
    bytes[start + at] ^= 1;
    fs::write(archive, bytes).unwrap();
}

/// Reads an archive, leaving out what tells of the sending: sequence, epoch and the time of sending.
pub(crate) fn contents(archive: &Path) -> Contents {
    let reader = Reader::open(archive).unwrap();
    let rows = 0..reader.plan().taps().len() as u32;
    let tap = |row| {
        let (header, samples) = reader.tap(row).unwrap()?;
        Some((TapHeader { stamp: Stamp::default(), sent_ns: 0, ..header }, samples))
    };
    // As text, in which an absent value equals an absent value.
    let found = |record: Discriminators| format!("{record:?}");
    let judged = |(judgement, cells): (Judgement, Vec<DamageCell>)| {
        format!("{:?} {cells:?}", Judgement { stamp: Stamp::default(), ..judgement })
    };
    Contents {
        states: reader.ledger().taps().to_vec(),
        taps: rows.map(tap).collect(),
        discriminators: reader.discriminators().unwrap().into_iter().map(|r| r.map(found)).collect(),
        judgements: reader.judgements().unwrap().into_iter().map(|j| j.map(judged)).collect(),
    }
}

/// The finished files of a run, by the names of their casings as the files have them.
pub(crate) fn finished(out: &Path) -> BTreeMap<String, PathBuf> {
    let files = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    let files = files.filter(|path| path.extension().is_some_and(|ending| ending == "h5"));
    files.map(|path| (path.file_stem().unwrap().to_str().unwrap().to_owned(), path)).collect()
}

/// The files of a run that are under way.
pub(crate) fn under_way(out: &Path) -> Vec<PathBuf> {
    finished(&out.join("open")).into_values().collect()
}

/// What the finished files of a run hold, by casing.
pub(crate) fn casings(out: &Path) -> BTreeMap<String, Contents> {
    finished(out).into_iter().map(|(name, path)| (name, contents(&path))).collect()
}

/// Says of which casing two runs differ, and where.
pub(crate) fn assert_same_casings(a: &BTreeMap<String, Contents>, b: &BTreeMap<String, Contents>) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, contents) in a {
        eprintln!("comparing {name}");
        assert_same(contents, &b[name]);
    }
}

/// Says where two archives differ, without printing them.
pub(crate) fn assert_same(a: &Contents, b: &Contents) {
    assert_eq!(a.states, b.states, "states");
    for (row, (a, b)) in a.taps.iter().zip(&b.taps).enumerate() {
        let header = |tap: &Option<(TapHeader, OwnedSamples)>| format!("{:?}", tap.as_ref().map(|(header, _)| *header));
        assert_eq!(header(a), header(b), "header of row {row}");
        let samples = |tap: &Option<(TapHeader, OwnedSamples)>| tap.as_ref().map(|(_, samples)| samples.clone());
        assert!(samples(a) == samples(b), "samples of row {row}");
    }
    assert_eq!(a.discriminators, b.discriminators, "discriminators");
    assert_eq!(a.judgements, b.judgements, "judgements");
}

/// Columns of a CSV text by name, one map a row.
pub(crate) fn csv_rows(text: &str) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.unwrap()).collect()
}

/// A file or folder among the committed documents.
pub(crate) fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)
}

/// A file's text.
pub(crate) fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}
