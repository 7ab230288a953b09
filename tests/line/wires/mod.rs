//! Verdicts on their way out: the outbox, and each wire with an independent client.

mod modbus;
mod mqtt;
mod opcua;
mod outbox;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::sandbox::Sandbox;
use crate::sandbox::running::Running;

/// A client of a wire, in Python, which prints a line of JSON for all that it sees.
fn client(python: &OsStr, script: &str, arguments: &[&str]) -> Running {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/line/wires").join(script);
    let mut command = Command::new(python);
    command.arg("-u").arg(path).args(arguments);
    Running::of(command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
}

/// Where the line serves over the wire called `name`, after it has said so.
fn address_of(line: &mut Running, name: &str) -> String {
    let said = line.log_line(&["verdicts are served over", name]);
    said.rsplit_once(" at ").unwrap().1.trim().to_owned()
}

/// By id, and that none comes twice.
fn by_id(verdicts: &[Value]) -> BTreeMap<String, Value> {
    let all: BTreeMap<String, Value> =
        verdicts.iter().map(|verdict| (verdict["id"].as_str().unwrap().to_owned(), verdict.clone())).collect();
    assert_eq!(all.len(), verdicts.len(), "{verdicts:?}");
    all
}

/// Names of the notes of verdicts that are still to be reported.
fn unreported(sandbox: &Sandbox) -> Vec<String> {
    let entries = std::fs::read_dir(sandbox.path("out/unreported")).into_iter().flatten().flatten();
    entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
}

/// The status of the line that writes to `out`; null while there is none.
pub(super) fn status(sandbox: &Sandbox) -> Value {
    serde_json::from_str(sandbox.run("status --out out --json").out.trim()).unwrap_or_default()
}
