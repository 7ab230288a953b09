//! Shared by all tests: each runs the built program in its own folder, and examines the files that it leaves.

pub(crate) mod archives;
pub(crate) mod broker;
pub(crate) mod browser;
pub(crate) mod cut;
pub(crate) mod nats;
pub(crate) mod recordings;
pub(crate) mod running;
pub(crate) mod stages;

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use tapline_testing::program::Done;
use tempfile::TempDir;

use crate::sandbox::archives::names;

/// `[scan]` of casings that take a second: two shoulders of `locations` taps, the first again, and no others.
pub(crate) fn short_scan(locations: u32) -> String {
    format!("[scan]\nlocations = {locations}\nconfirm = false\n")
}

/// A new folder in which the built program runs.
pub(crate) struct Sandbox {
    folder: TempDir,
}

impl Sandbox {
    pub(crate) fn new() -> Self {
        Self { folder: TempDir::new().unwrap() }
    }

    /// One with the certificates of a server and of who vouches for it; `None`, and a skip, where no Python can make them.
    pub(crate) fn with_certificates() -> Option<Self> {
        let (python, sandbox) = (tapline_testing::python_with("cryptography")?, Self::new());
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/line/wires/certificates.py");
        Done::from(Command::new(python).arg(script).arg(sandbox.path("")).output().unwrap()).expect(0);
        Some(sandbox)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file into the folder.
    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Writes a file that only its user may read.
    pub(crate) fn write_secret(&self, name: &str, text: &str) {
        self.write(name, text);
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(0o600)).unwrap();
    }

    /// What `python` prints in the folder when it runs `script` with more `arguments`.
    pub(crate) fn python(&self, python: &OsStr, script: &str, arguments: &[&str]) -> String {
        let mut command = Command::new(python);
        command.args(["-c", script]).args(arguments).current_dir(self.folder.path());
        Done::from(command.output().unwrap()).expect(0).out
    }

    /// The program with `arguments`, split at spaces.
    ///
    /// A run must name its reference; if a test names none, each tyre is its own reference.
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
        // A private folder, where lines have theirs.
        command.env("XDG_RUNTIME_DIR", self.folder.path());
        command
    }

    /// Whether the arguments, or the configuration that they name, have a reference.
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

    /// Starts the program without waiting for it.
    pub(crate) fn start(&self, arguments: &str) -> Child {
        self.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Folders that lines have left; while one exists, shared memory may exist too.
    pub(crate) fn left(&self) -> Vec<String> {
        names(self.folder.path()).into_iter().filter(|name| name.starts_with("tapline-")).collect()
    }
}
