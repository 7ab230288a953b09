//! Gives the program the digests of what computes its results: a digest of the sources of each crate that computes, and one of
//! the versions of what these crates use.
//!
//! Results carry these digests, so that numbers from different sources are never taken for the same. What only shows,
//! moves or stores numbers is not included.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Crates whose sources decide a number.
const CRATES: [&str; 5] = ["wire", "model", "acquire", "process", "fuse"];

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut direct = BTreeSet::new();
    for name in CRATES {
        let folder = root.join(name);
        set(name, &digest(&[folder.join("src"), folder.join("Cargo.toml")])?);
        direct.extend(dependencies(&fs::read_to_string(folder.join("Cargo.toml"))?));
    }
    let lock = root.join("Cargo.lock");
    println!("cargo::rerun-if-changed={}", lock.display());
    let versions = versions(&fs::read_to_string(lock)?, direct);
    set("dependencies", &blake3::hash(versions.as_bytes()).to_hex()[..32]);
    Ok(())
}

fn set(name: &str, digest: &str) {
    println!("cargo::rustc-env=TAPLINE_SOURCE_{}={digest}", name.to_uppercase());
}

/// Names of the crates that a manifest depends on, except those that only its tests need.
fn dependencies(manifest: &str) -> Vec<String> {
    let lines = manifest.lines().skip_while(|line| *line != "[dependencies]").skip(1);
    let lines = lines.take_while(|line| !line.starts_with('['));
    lines.filter_map(|line| line.split(['.', ' ', '=']).next()).filter(|n| !n.is_empty()).map(str::to_owned).collect()
}

/// The versions in the lock file `lock` of `direct` and of all that these depend on, one per line.
fn versions(lock: &str, direct: BTreeSet<String>) -> String {
    let mut packages: BTreeMap<&str, Vec<(&str, Vec<&str>)>> = BTreeMap::new();
    for package in lock.split("[[package]]").skip(1) {
        let value = |key: &str| package.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix(" = ")).unwrap_or("");
        let needs = package.lines().filter_map(|line| line.strip_prefix(" \"")?.split(['"', ' ']).next());
        let (name, version) = (value("name").trim_matches('"'), value("version"));
        packages.entry(name).or_default().push((version, needs.collect()));
    }
    let (mut found, mut open) = (BTreeSet::new(), Vec::from_iter(direct));
    while let Some(name) = open.pop() {
        // Those of the workspace have digests of their sources.
        if name.starts_with("tapline-") || !found.insert(name.clone()) {
            continue;
        }
        let needs = packages.get(name.as_str()).into_iter().flatten().flat_map(|(_, needs)| needs);
        open.extend(needs.map(|&need| need.to_owned()));
    }
    let of = |name: &String| {
        packages.get(name.as_str()).into_iter().flatten().map(|(v, _)| format!("{name} {v}\n")).collect::<String>()
    };
    found.iter().map(of).collect()
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
