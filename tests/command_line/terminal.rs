//! What people see: colour, progress, tables, and help with slips.

use crate::sandbox::Sandbox;

const SMALL: &str = "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 3\nlocations = 20\n[fuse]\nreference = \"self\"\n";

/// Catches a table that runs over the 80 columns of a terminal.
#[test]
fn tables_fit_80_columns() {
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", SMALL);
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
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", SMALL);
    sandbox.run("run --config c.toml --out x").expect(0);
    let done = sandbox.run("verify x/SIM-0001.h5").expect(0);
    assert!(!done.out.contains('\x1b') && done.err.is_empty(), "{done:?}");
    let on_terminal = |environment: &str| {
        let mut script = std::process::Command::new("script");
        let command = format!("{environment} {} verify x/SIM-0001.h5", env!("CARGO_BIN_EXE_tapline"));
        script.args(["-qec", &command, "/dev/null"]).current_dir(sandbox.path("."));
        script.env_remove("NO_COLOR").env("TERM", "xterm").stdin(std::process::Stdio::null());
        String::from_utf8(script.output().unwrap().stdout).unwrap()
    };
    assert!(on_terminal("").contains("\x1b[32mcomplete"), "{:?}", on_terminal(""));
    let plain = on_terminal("NO_COLOR=1");
    assert!(plain.contains("complete") && !plain.contains("\x1b[32m"), "{plain:?}");
}

/// Catches a program that says more than errors with -q, and no more with -v.
#[test]
fn people_choose_how_much_is_said() {
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", SMALL);
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
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", SMALL);
    sandbox.run("run --config c.toml --out x").expect(0);
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
