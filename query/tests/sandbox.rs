//! What the tests share: archives, a folder of its own for each test, and the built program in it.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use tapline_query::Place;
use tapline_query::reprocess::Committed;
use tapline_testing::program::Done;
use tapline_testing::skip;
use tempfile::TempDir;

/// Casings of the shared archives.
pub(crate) const CASINGS: usize = 11;

/// A name among those of the archives that sorts between them.
pub(crate) const TRUNCATED: &str = "2/SIM-0007-cut.h5";

/// Small tyres, an odd number of them, so that partitions differ in size.
const CONFIG: &str = "
[scan]
locations = 24
offsets_mm = [0.0, 5.0]
velocities_m_per_s = [1.5]
[fuse]
reference = \"self\"
";

/// Archives that are made once, and removed with the last test that uses them.
static ARCHIVES: Mutex<Weak<TempDir>> = Mutex::new(Weak::new());

/// The everyday program, beside this one; `None`, and a skip, where it is not built.
pub(crate) fn tapline() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_BIN_EXE_tapline-query")).with_file_name("tapline");
    if !path.is_file() {
        skip(&format!("{} is not built: cargo build -p tapline", path.display()));
        return None;
    }
    Some(path)
}

fn archives() -> Option<Arc<TempDir>> {
    let tapline = tapline()?;
    let mut made = ARCHIVES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(folder) = made.upgrade() {
        return Some(folder);
    }
    let folder = Arc::new(TempDir::new().unwrap());
    let config = folder.path().join("line.toml");
    fs::write(&config, CONFIG).unwrap();
    let mut command = Command::new(tapline);
    command.args(["run", "--quiet", "--config"]).arg(&config).arg("--out").arg(folder.path().join("made"));
    let done = Done::from(command.args(["--stations", &CASINGS.to_string()]).output().unwrap());
    done.expect(0);
    *made = Arc::downgrade(&folder);
    Some(folder)
}

/// A folder with links to the archives, half of them in one subfolder and half in another.
pub(crate) struct Sandbox {
    folder: TempDir,
    /// What programs find in their environment besides.
    pub(crate) variables: Vec<(String, String)>,
    _archives: Arc<TempDir>,
}

impl Sandbox {
    /// `None`, and a skip, where archives cannot be made.
    pub(crate) fn new() -> Option<Self> {
        let (archives, folder) = (archives()?, TempDir::new().unwrap());
        let made = archives.path().join("made");
        for (k, name) in (1..=CASINGS).map(|k| (k, format!("SIM-{k:04}.h5"))) {
            let day = folder.path().join("in").join(if k < CASINGS / 2 { "1" } else { "2" });
            fs::create_dir_all(&day).unwrap();
            symlink(made.join(&name), day.join(&name)).unwrap();
        }
        Some(Self { folder, variables: Vec::new(), _archives: archives })
    }

    /// Adds an archive that was cut off in the middle.
    pub(crate) fn truncate_one(&self) {
        let whole = fs::read(self.path("in/1/SIM-0001.h5")).unwrap();
        fs::write(self.path("in").join(TRUNCATED), &whole[..whole.len() / 2]).unwrap();
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Makes a `tapline` that first sleeps, so that a job lasts, and returns its path.
    pub(crate) fn slow_tapline(&self, sleep_s: f64) -> PathBuf {
        self.tapline_after(&format!("sleep {sleep_s}"))
    }

    /// Makes one that sleeps and adds a line to the file `runs` whenever it is run.
    pub(crate) fn counting_tapline(&self, sleep_s: u32) -> PathBuf {
        self.tapline_after(&format!("echo run >> '{}'\nsleep {sleep_s}", self.path("runs").display()))
    }

    /// Makes one that does `first` before, as the shell understands it.
    pub(crate) fn tapline_after(&self, first: &str) -> PathBuf {
        let (path, real) = (self.path("tapline"), tapline().unwrap());
        fs::write(&path, format!("#!/bin/sh\n{first}\nexec '{}' \"$@\"\n", real.display())).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    /// The program with `arguments`, in this folder.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tapline-query"));
        command.args(arguments).current_dir(self.folder.path()).env("TAPLINE", tapline().unwrap());
        // What a killed process leaves goes with the folder.
        command.env("TMPDIR", self.folder.path()).envs(self.variables.iter().cloned());
        command
    }

    /// Runs the program to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Done {
        Done::from(self.command(arguments).output().unwrap())
    }

    /// Rows that answer a question, as CSV, those after the header sorted.
    pub(crate) fn ask(&self, sql: &str, engine: &str, more: &[&str]) -> Vec<String> {
        self.ask_of("in", sql, engine, more)
    }

    /// The same, of another place. The exit code tells whether an archive was cut off.
    pub(crate) fn ask_of(&self, place: &str, sql: &str, engine: &str, more: &[&str]) -> Vec<String> {
        let arguments = ["sql", sql, place, "--format", "csv", "--engine", engine];
        let code = if self.path("in").join(TRUNCATED).exists() { 3 } else { 0 };
        let done = self.run(&[&arguments[..], more].concat()).expect(code);
        let mut lines: Vec<_> = done.out.lines().map(str::to_owned).collect();
        lines[1..].sort();
        lines
    }

    /// The only job that is committed in `out`, and that nothing else is there.
    pub(crate) fn only_job(&self, out: &str) -> PathBuf {
        let mut left = self.names(out);
        left.retain(|name| name != ".lock");
        assert!(left.len() == 1 && left[0].starts_with("run="), "{left:?}");
        self.path(out).join(&left[0])
    }

    pub(crate) fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder)).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }
}

/// The commit file in `folder`.
pub(crate) fn committed(folder: &Path) -> Committed {
    let place = Place::from(folder);
    let read = Committed::read(&place);
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(read).unwrap().unwrap()
}

/// Every file below `folder`, with what it holds.
pub(crate) fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut to_do = vec![folder.to_owned()];
    while let Some(next) = to_do.pop() {
        for path in fs::read_dir(next).unwrap().map(|entry| entry.unwrap().path()) {
            match path.is_dir() {
                true => to_do.push(path),
                false => _ = found.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap()),
            }
        }
    }
    found
}
