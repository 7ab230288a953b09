//! Finished casing files go to a centre: `tapline uplink` and `tapline collect`, over a real server of NATS.

mod hosts;
mod killed;
mod refused;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::sandbox::{Sandbox, short_scan};

/// The finished files of a run of `count` casings in the folder `made`, by their names.
fn made(sandbox: &Sandbox, count: usize) -> BTreeMap<PathBuf, Vec<u8>> {
    let tyres: String = (1..=count).map(|n| format!("[[scan.tyre]]\nserial = \"C{n}\"\n")).collect();
    sandbox.write("scan.toml", &format!("{}{tyres}", short_scan(24)));
    sandbox.run("run --config scan.toml --out made").expect(0);
    files(&sandbox.path("made"))
}

/// The files below `folder` that end in `.h5`, also hidden ones, by their paths, with their bytes; not those under way.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut folders = vec![folder.to_owned()];
    let mut files = BTreeMap::new();
    while let Some(at) = folders.pop() {
        for entry in fs::read_dir(&at).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() && !path.ends_with("open") {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "h5") {
                // A file under way may be renamed meanwhile; it is there the next time.
                let Ok(bytes) = fs::read(&path) else { continue };
                files.insert(path.strip_prefix(folder).unwrap().to_owned(), bytes);
            }
        }
    }
    files
}
