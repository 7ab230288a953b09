//! Tells the program what it is built from: a digest of the sources of each stage, and of the versions of all it depends on.
//!
//! Results carry these digests, so that numbers made by different sources are never taken for the same.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Folders whose sources decide what a stage computes, by the name under which their digest is known.
const STAGES: [&str; 6] = ["wire", "model", "acquire", "process", "fuse", "store"];

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    for stage in STAGES {
        let folder = root.join(stage);
        tell(stage, &digest(&[folder.join("src"), folder.join("Cargo.toml")])?);
    }
    tell("program", &digest(&[root.join("src")])?);
    tell("dependencies", &digest(&[root.join("Cargo.lock"), root.join("Cargo.toml")])?);
    Ok(())
}

fn tell(name: &str, digest: &str) {
    println!("cargo::rustc-env=TAPLINE_SOURCE_{}={digest}", name.to_uppercase());
}

/// BLAKE3 of the names and contents of all files in `places`, in the order of their names.
fn digest(places: &[PathBuf]) -> io::Result<String> {
    let mut files = Vec::new();
    for place in places {
        println!("cargo::rerun-if-changed={}", place.display());
        collect(place, &mut files)?;
    }
    files.sort();
    let mut hasher = blake3::Hasher::new();
    for file in files {
        let name = file.strip_prefix(places[0].parent().unwrap_or(Path::new(""))).unwrap_or(&file);
        for part in [name.to_string_lossy().as_bytes(), &fs::read(&file)?] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part);
        }
    }
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

fn collect(place: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if !place.is_dir() {
        files.push(place.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(place)? {
        collect(&entry?.path(), files)?;
    }
    Ok(())
}
