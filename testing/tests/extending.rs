//! `docs/extending.md` says which files name a part: those, and no others.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Catches a part whose name has spread to a file that the page does not name, and a file that is not there any more.
#[test]
fn parts_are_where_the_page_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let page = fs::read_to_string(root.join("docs/extending.md")).unwrap();
    let rows = page.lines().filter(|line| line.starts_with("| a"));
    let mut count = 0;
    for row in rows {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let part = cells[2].trim_matches('`');
        let named: BTreeSet<String> = cells[3].split('`').skip(1).step_by(2).map(str::to_owned).collect();
        let mut found = BTreeSet::new();
        // A part of the lab is known to no other crate: there its name is another thing's.
        let is_of_lab = named.iter().all(|file| file.starts_with("lab/"));
        let folders =
            [".", "wire", "model", "codec", "acquire", "process", "fuse", "store", "export", "import", "draw", "lab"];
        for folder in folders.iter().filter(|folder| !is_of_lab || **folder == "lab") {
            find(&root.join(folder).join("src"), root, part, &mut found);
        }
        assert_eq!(found, named, "{part}");
        count += 1;
    }
    assert_eq!(count, 6, "the rows of the page");
}

/// Adds the sources below `folder` that name `part` outside their tests and comments, and the configurations that have it as a key.
fn find(folder: &Path, root: &Path, part: &str, found: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() {
            if name != "tests" {
                find(&path, root, part, found);
            }
            continue;
        }
        let text = fs::read_to_string(&path).unwrap_or_default();
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let is_source = name.ends_with(".rs");
        // The value of a key only chooses among parts.
        let after: &[&str] = if is_source { &["//"] } else { &["#", "="] };
        let is_named = |line: &str| {
            let named = after.iter().fold(line, |rest, mark| rest.split(*mark).next().unwrap());
            names(&named.to_lowercase(), part)
        };
        let is_test = name.ends_with("tests.rs") || TESTS.contains(&name);
        let is_its_own = name.strip_suffix(".rs") == Some(part);
        if (is_source || name.ends_with(".toml")) && !is_test && (is_its_own || code.lines().any(is_named)) {
            found.insert(path.strip_prefix(root).unwrap().to_str().unwrap().to_owned());
        }
    }
}

/// Whether `part` begins a word of `line`: "refused" does not name an index that is called "fused".
fn names(line: &str, part: &str) -> bool {
    line.match_indices(part).any(|(at, _)| !line[..at].ends_with(|before: char| before.is_alphanumeric()))
}

/// Files that are no part of the program but tests.
const TESTS: [&str; 1] = ["laws.rs"];
