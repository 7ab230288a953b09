//! The modules of each crate form layers: each imports only from layers below its own. A module here is a folder or a file
//! directly below `src`.
//!
//! `cargo test -p tapline-testing --test layers -- --nocapture` prints them, the top layer first.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Each crate's sources, and how many layers its modules may have.
const CRATES: [(&str, usize); 14] = [
    ("wire/src", 3),
    ("model/src", 3),
    ("codec/src", 4),
    ("acquire/src", 5),
    ("process/src", 5),
    ("fuse/src", 7),
    ("store/src", 5),
    ("export/src", 5),
    ("import/src", 5),
    ("draw/src", 2),
    ("lab/src", 4),
    ("query/src", 5),
    ("uplink/src", 4),
    ("src", 5),
];

/// For each module the modules that it imports from.
type Imports = BTreeMap<String, BTreeSet<String>>;

/// Catches a module that imports from one above it, modules that import from each other, and a crate with another layer.
#[test]
fn modules_import_from_layers_below_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    for (name, layers_max) in CRATES {
        let layers = layers(&imports(&root.join(name))).unwrap_or_else(|circle| panic!("{name}: {circle} in a circle"));
        println!("{name}");
        for (layer, modules) in layers.iter().enumerate().rev() {
            println!("  {} {}", layer + 1, modules.join(" "));
        }
        assert!(layers.len() <= layers_max, "{name}: {} layers; at most {layers_max}: {layers:?}", layers.len());
    }
}

#[test]
fn a_circle_is_found() {
    let of = |pairs: &[(&str, &[&str])]| -> Imports {
        pairs.iter().map(|(module, to)| ((*module).to_owned(), to.iter().map(|&to| to.to_owned()).collect())).collect()
    };
    assert_eq!(layers(&of(&[("a", &["b"]), ("b", &[]), ("c", &["a", "b"])])).unwrap(), [["b"], ["a"], ["c"]]);
    assert!(layers(&of(&[("a", &["b"]), ("b", &["c"]), ("c", &["b"])])).unwrap_err().contains("b, c"));
}

/// The modules by layers, each above all that it imports from; an error with the modules that are in or above a circle.
fn layers(imports: &Imports) -> Result<Vec<Vec<String>>, String> {
    let (mut placed, mut layers) = (BTreeSet::new(), Vec::new());
    while placed.len() < imports.len() {
        let is_next = |(module, to): &(&String, &BTreeSet<String>)| !placed.contains(*module) && to.is_subset(&placed);
        let layer: Vec<String> = imports.iter().filter(is_next).map(|(module, _)| module.clone()).collect();
        if layer.is_empty() {
            let rest: Vec<&str> =
                imports.keys().filter(|&module| !placed.contains(module)).map(String::as_str).collect();
            return Err(rest.join(", "));
        }
        placed.extend(layer.iter().cloned());
        layers.push(layer);
    }
    Ok(layers)
}

/// What each module of the crate in `src` imports from the others.
fn imports(src: &Path) -> Imports {
    let facade = ["lib.rs", "main.rs"].map(|name| fs::read_to_string(src.join(name)).unwrap_or_default()).concat();
    let mut imports = Imports::new();
    for file in sources(src) {
        let module = module_of(file.strip_prefix(src).unwrap());
        let text = without_tests_and_comments(&fs::read_to_string(&file).unwrap());
        imports.entry(module).or_default().extend(paths_from_the_root(&text));
    }
    let modules: BTreeSet<String> = imports.keys().cloned().collect();
    for (module, to) in &mut imports {
        let named = std::mem::take(to);
        *to = named.iter().filter_map(|name| owner(name, &modules, &facade)).filter(|owner| owner != module).collect();
    }
    imports
}

/// The module that `name`, directly below the crate's root, is, or is exported from.
fn owner(name: &str, modules: &BTreeSet<String>, facade: &str) -> Option<String> {
    if modules.contains(name) {
        return Some(name.to_owned());
    }
    let exports = facade.split(';').filter_map(|item| item.trim_start().strip_prefix("pub use "));
    let mut of_name = exports.filter(|item| words(item).any(|word| word == name));
    let module = of_name.next()?.split("::").next()?.trim().to_owned();
    modules.contains(&module).then_some(module)
}

/// The names that `text` imports from the crate's root.
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
    // Of `a as b` the names alone: `as` is none.
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty() && *word != "as")
}

fn without_tests_and_comments(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    code.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

fn module_of(path: &Path) -> String {
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
