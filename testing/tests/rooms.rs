//! The rooms of each crate, and which takes from which: a room is a folder or a file directly below `src`.
//!
//! `cargo test -p tapline-testing --test rooms -- --nocapture` prints them, the top level first.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Each crate's sources, and the most levels that its rooms may stand on.
const CRATES: [(&str, usize); 10] = [
    ("wire/src", 3),
    ("model/src", 3),
    ("codec/src", 4),
    ("acquire/src", 5),
    ("process/src", 7),
    ("store/src", 5),
    ("export/src", 5),
    ("draw/src", 2),
    ("lab/src", 3),
    ("src", 5),
];

/// For each room the rooms that it takes from.
type Imports = BTreeMap<String, BTreeSet<String>>;

/// Catches a room that takes from one above it, or from one that takes from it, and a crate that grows another level.
#[test]
fn rooms_take_from_rooms_below_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    for (name, levels_max) in CRATES {
        let levels = levels(&imports(&root.join(name))).unwrap_or_else(|circle| panic!("{name}: {circle} in a circle"));
        println!("{name}");
        for (level, rooms) in levels.iter().enumerate().rev() {
            println!("  {} {}", level + 1, rooms.join(" "));
        }
        assert!(levels.len() <= levels_max, "{name}: {} levels; at most {levels_max}: {levels:?}", levels.len());
    }
}

#[test]
fn a_circle_is_found() {
    let of = |pairs: &[(&str, &[&str])]| -> Imports {
        pairs.iter().map(|(room, to)| ((*room).to_owned(), to.iter().map(|&to| to.to_owned()).collect())).collect()
    };
    assert_eq!(levels(&of(&[("a", &["b"]), ("b", &[]), ("c", &["a", "b"])])).unwrap(), [["b"], ["a"], ["c"]]);
    assert!(levels(&of(&[("a", &["b"]), ("b", &["c"]), ("c", &["b"])])).unwrap_err().contains("b, c"));
}

/// The rooms level by level, each above all that it takes from; the rooms that cannot be placed where some form a circle.
fn levels(imports: &Imports) -> Result<Vec<Vec<String>>, String> {
    let (mut placed, mut levels) = (BTreeSet::new(), Vec::new());
    while placed.len() < imports.len() {
        let is_next = |(room, to): &(&String, &BTreeSet<String>)| !placed.contains(*room) && to.is_subset(&placed);
        let level: Vec<String> = imports.iter().filter(is_next).map(|(room, _)| room.clone()).collect();
        if level.is_empty() {
            let rest: Vec<&str> = imports.keys().filter(|&room| !placed.contains(room)).map(String::as_str).collect();
            return Err(rest.join(", "));
        }
        placed.extend(level.iter().cloned());
        levels.push(level);
    }
    Ok(levels)
}

/// What each room of the crate in `src` takes from the others.
fn imports(src: &Path) -> Imports {
    let facade = ["lib.rs", "main.rs"].map(|name| fs::read_to_string(src.join(name)).unwrap_or_default()).concat();
    let mut imports = Imports::new();
    for file in sources(src) {
        let room = room_of(file.strip_prefix(src).unwrap());
        let text = without_tests_and_comments(&fs::read_to_string(&file).unwrap());
        imports.entry(room).or_default().extend(paths_from_the_root(&text));
    }
    let rooms: BTreeSet<String> = imports.keys().cloned().collect();
    for (room, to) in &mut imports {
        let named = std::mem::take(to);
        *to = named.iter().filter_map(|name| owner(name, &rooms, &facade)).filter(|owner| owner != room).collect();
    }
    imports
}

/// The room that `name`, directly below the crate's root, is, or is exported from.
fn owner(name: &str, rooms: &BTreeSet<String>, facade: &str) -> Option<String> {
    if rooms.contains(name) {
        return Some(name.to_owned());
    }
    let exports = facade.split(';').filter_map(|item| item.trim_start().strip_prefix("pub use "));
    let mut of_name = exports.filter(|item| words(item).any(|word| word == name));
    let room = of_name.next()?.split("::").next()?.trim().to_owned();
    rooms.contains(&room).then_some(room)
}

/// The names that `text` takes from the crate's root.
fn paths_from_the_root(text: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for after in text.split("crate::").skip(1) {
        match after.strip_prefix('{') {
            Some(list) => names.extend(words(list.split(';').next().unwrap()).map(str::to_owned)),
            None => names.extend(words(after).next().map(str::to_owned)),
        }
    }
    names
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

fn without_tests_and_comments(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    code.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

fn room_of(path: &Path) -> String {
    let first = path.components().next().unwrap().as_os_str().to_str().unwrap();
    first.strip_suffix(".rs").unwrap_or(first).to_owned()
}

/// The files below `folder` that are no tests, without the crate's own page.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() && name != "tests" {
            files.extend(sources(&path));
        } else if name.ends_with(".rs")
            && !name.ends_with("tests.rs")
            && !["lib.rs", "main.rs", "testing.rs"].contains(&name.as_str())
        {
            files.push(path);
        }
    }
    files
}
