//! `docs/dissertation.md`: every command on the page can be run.

use std::fs;
use std::path::{Path, PathBuf};

use tapline_testing::documents::{docs, text};

use crate::sandbox::Sandbox;

/// Commands of the page: texts in backquotes that begin with the name of a program.
fn commands(program: &str) -> Vec<String> {
    let page = text(&docs("dissertation.md"));
    let quoted = page.lines().flat_map(|line| line.split('`').skip(1).step_by(2));
    let mut commands: Vec<String> = quoted.filter_map(|text| text.strip_prefix(program)).map(str::to_owned).collect();
    commands.sort();
    commands.dedup();
    commands
}

/// Catches a command that does not parse or fails.
#[test]
fn the_programs_commands_run() {
    let sandbox = Sandbox::new();
    let commands = commands("tapline ");
    assert!(commands.len() > 8, "{commands:?}");
    for command in commands {
        assert!(!sandbox.run(&command).expect(0).out.is_empty(), "{command}");
    }
}

/// Catches a test that was renamed: each `cargo test -p CRATE NAME` names a module or a function of that crate.
#[test]
fn the_tests_named_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let commands = commands("cargo test ");
    assert!(commands.len() > 5, "{commands:?}");
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().collect();
        let [.., name] = words[..] else { panic!("{command}") };
        let folder = match words[..] {
            ["-p", krate, _] => root.join(krate.strip_prefix("tapline-").unwrap()),
            ["--test", "integration", _] => root.join("tests"),
            _ => panic!("{command}"),
        };
        let name = name.rsplit("::").next().unwrap();
        let is_there =
            sources(&folder).iter().any(|path| fs::read_to_string(path).unwrap().contains(&format!("fn {name}(")));
        assert!(is_there, "no {name} in {}", folder.display());
    }
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut sources_found = Vec::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            sources_found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            sources_found.push(path);
        }
    }
    sources_found
}
