//! What people see: colour, progress, tables, help with slips, and a standard output that cannot be written.

use std::fs::OpenOptions;
use std::io::pipe;
use std::process::Stdio;

use tapline_testing::program::Done;

use crate::command_line::{scanned, small};
use crate::sandbox::Sandbox;

/// Catches a table that runs over the 80 columns of a terminal.
#[test]
fn tables_fit_80_columns() {
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", &small(3));
    let summary = sandbox.run("run --config c.toml --stations 2 --out x").expect(0).out;
    let explained = sandbox.run("explain x/SIM-0001.h5 --shoulder SIM-0001/1 --location 3").expect(0).out;
    let reference = "reference x --shoulder SIM-0002/1 --shoulder SIM-0002/2 --out r.json";
    let is_of_table = |line: &&str| line.contains(['─', '═', '┄', '╌']);
    for text in [summary, explained, sandbox.run(reference).expect(0).out] {
        let rules: Vec<&str> = text.lines().filter(is_of_table).collect();
        assert!(!rules.is_empty(), "{text}");
        assert!(rules.iter().all(|rule| rule.chars().count() <= 80), "{text}");
    }
}

/// Catches colours in a file, or where NO_COLOR is set, none on a terminal, and progress in a file. The `script` of util-linux
/// gives the program a terminal.
#[test]
fn colour_is_for_terminals() {
    let sandbox = scanned(3);
    let done = sandbox.run("verify x/SIM-0001.h5").expect(0);
    assert!(!done.out.contains('\x1b') && done.err.is_empty(), "{done:?}");
    let on_terminal = |environment: &str| {
        let mut script = std::process::Command::new("script");
        let command = format!("{environment} {} verify x/SIM-0001.h5", env!("CARGO_BIN_EXE_tapline"));
        script.args(["-qec", &command, "/dev/null"]).current_dir(sandbox.path("."));
        script.env_remove("NO_COLOR").env("TERM", "xterm").stdin(Stdio::null());
        String::from_utf8(script.output().unwrap().stdout).unwrap()
    };
    assert!(on_terminal("").contains("\x1b[32mcomplete"), "{:?}", on_terminal(""));
    let plain = on_terminal("NO_COLOR=1");
    assert!(plain.contains("complete") && !plain.contains("\x1b[32m"), "{plain:?}");
}

/// Catches a program that prints more than errors with -q, or nothing more with -v.
#[test]
fn people_choose_how_much_is_said() {
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", &small(3));
    let usual = sandbox.run("run --config c.toml --out x").expect(0).err;
    assert!(usual.contains("scanning"), "{usual}");
    let quiet = sandbox.run("run -q --config c.toml --out y").expect(0).err;
    assert_eq!(quiet, "");
    assert!(sandbox.run("verify -q none.h5").expect(1).err.contains("none.h5"));
    let said = |command: &str| sandbox.run(command).expect(0).err;
    assert_eq!(said("verify x"), "");
    assert!(said("verify x -v").contains("SIM-0001.h5"));
    assert!(said("export x ledger --out l.csv -vv").contains("l.csv"));
    sandbox.run("verify -q -v none.h5").expect(2);
}

/// Catches a slip that is not recognised, wherever it is.
#[test]
fn slips_are_recognised() {
    let sandbox = scanned(3);
    for (command, code, meant) in [
        ("verfy x", 2, "verify"),
        ("export x verdicts --fromat csv", 2, "--format"),
        ("export x discriminator", 2, "discriminators"),
        ("run --config wrong.toml", 1, "f_hi_hz"),
        ("explain x/SIM-0001.h5 --shoulder SIM-001/1", 1, "SIM-0001/1"),
    ] {
        sandbox.write("wrong.toml", "[process]\nf_hi = 2000.0\n");
        let done = sandbox.run(command).expect(code);
        assert!(done.err.contains(meant), "{command}: {done:?}");
    }
}

/// Catches a standard output that cannot be written and is taken for a fault of each archive, and a reader that ends early, like
/// `head`, and makes a verb fail that does nothing but print.
#[test]
fn a_standard_output_that_cannot_be_written_is_reported_once() {
    let sandbox = scanned(3);
    let to_full = |command: &str| {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        Done::from(sandbox.plain(command).stdout(full).output().unwrap()).expect(1).err
    };
    let to_closed = |command: &str| {
        let (reader, writer) = pipe().unwrap();
        drop(reader);
        Done::from(sandbox.plain(command).stdout(writer).output().unwrap())
    };
    let prints =
        ["explain x", "diff x x", "export x verdicts", "export x discriminators", "config --example", "model table 4"];
    for command in prints {
        let done = to_closed(command).expect(0);
        assert_eq!(done.err, "", "{command}");
    }
    for command in prints.into_iter().chain(["verify x --json", "verify x"]) {
        let err = to_full(command);
        assert!(err.ends_with("cannot write to standard output: No space left on device (os error 28)\n"), "{err}");
        assert!(err.lines().count() == 1 && !err.contains(".h5"), "{command}: {err}");
    }
    // What is not printed was not checked for anyone.
    let err = to_closed("verify x").expect(1).err;
    assert_eq!(err, "tapline: cannot write to standard output: Broken pipe (os error 32)\n");
    // The product of these is files.
    for (command, folder, file_count) in [
        ("run --config c.toml --reference self --stations 2 --out made", "made", 3),
        ("report x --out pages", "pages", 3),
        ("reprocess -q x", "x", 5),
        ("repack x --codec none --out packed", "packed", 2),
    ] {
        assert!(!to_closed(command).expect(0).err.contains("Broken pipe"), "{command}");
        let files = std::fs::read_dir(sandbox.path(folder)).unwrap().flatten();
        assert_eq!(files.filter(|file| file.path().is_file()).count(), file_count, "{command}");
    }
}
