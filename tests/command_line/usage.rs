//! The command line: usage, files that are read and written, and the dissertation's tables.

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, symlink};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::io::ioctl_fionread;

use crate::command_line::scanned;
use crate::sandbox::Sandbox;
use crate::sandbox::archives::bend;

#[test]
fn wrong_usage_has_its_own_exit_code() {
    let sandbox = Sandbox::new();
    sandbox.run("").expect(2);
    sandbox.run("rum").expect(2);
    sandbox.run("export archive.h5 verdict").expect(2);
    sandbox.run("--help").expect(0);
    for verb in ["run", "line", "status", "rig", "export", "reference", "verify", "report", "model table"] {
        assert!(sandbox.run(&format!("{verb} --help")).expect(0).out.contains("Usage"));
    }
}

/// Catches a level of the log that is misspelt, and then nothing is logged.
#[test]
fn a_level_that_is_none_is_refused() {
    let sandbox = Sandbox::new();
    let with = |level: &str| {
        let done = sandbox.plain("completions bash").env("TAPLINE_LOG", level).output().unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    let (code, text) = with("warning");
    let expected =
        "TAPLINE_LOG=warning: \"warning\" is not one of off, error, warn, info, debug, trace; did you mean \"warn\"?";
    assert!(code == Some(2) && text.contains(expected), "{text}");
    assert_eq!(with("tapline=inf").0, Some(2));
    for level in ["", "warn", "INFO", "error,tapline=debug"] {
        assert_eq!(with(level).0, Some(0), "{level}");
    }
}

/// Catches a missing or other file that is taken for an archive; an error without its name, or with its cause twice
/// or not at all; and a folder that is made for nothing.
#[test]
fn what_is_no_archive_is_named() {
    const ABSENT: &str = "No such file or directory";
    let sandbox = Sandbox::new();
    sandbox.write("text.h5", "not an archive");
    for (command, code, message) in [
        ("export absent.h5 verdicts", 1, ABSENT),
        ("verify absent.h5", 1, ABSENT),
        ("export text.h5 ledger", 1, "text.h5 is not an HDF5 file"),
        ("report text.h5", 1, "text.h5 is not an HDF5 file"),
        // A wrong file in place of an archive is a finding of verify, which it prints.
        ("verify text.h5", 1, "text.h5: UNREADABLE"),
    ] {
        let done = sandbox.run(command).expect(code);
        let said = if message == ABSENT || !command.starts_with("verify") { &done.err } else { &done.out };
        let name = command.split(' ').nth(1).unwrap();
        assert!(said.contains(name) && said.matches(message).count() == 1, "{command}: {done:?}");
    }
    assert!(!sandbox.path("text-report").exists());
}

/// A table must not be written over the archive it comes from.
#[test]
fn an_export_does_not_destroy_its_archive() {
    let sandbox = scanned(1);
    let done = sandbox.run("export x/SIM-0001.h5 ledger --out ./x/SIM-0001.h5").expect(1);
    assert!(done.err.contains("SIM-0001.h5"), "{done:?}");
    sandbox.run("verify x/SIM-0001.h5").expect(0);
    sandbox.run("export x/SIM-0001.h5 ledger --out ledger.csv").expect(0);
    assert_eq!(
        fs::read_to_string(sandbox.path("ledger.csv")).unwrap(),
        sandbox.run("export x/SIM-0001.h5 ledger").expect(0).out
    );
    assert!(!sandbox.path("ledger.csv.new").exists());
}

/// Catches an archive that is overwritten by a reference, under its own name or through a link.
#[test]
fn a_reference_does_not_take_an_archives_place() {
    let sandbox = scanned(1);
    fs::copy(sandbox.path("x/SIM-0002.h5"), sandbox.path("x.json")).unwrap();
    symlink("x/SIM-0002.h5", sandbox.path("link.json")).unwrap();
    let shoulder = "--shoulder SIM-0002/1 --shoulder SIM-0002/2";
    for out in ["x.json", "link.json"] {
        let done = sandbox.run(&format!("reference x/SIM-0002.h5 {shoulder} --out {out}")).expect(1);
        assert!(done.err.contains("is an HDF5 file"), "{done:?}");
    }
    sandbox.run("verify x/SIM-0002.h5").expect(0);
    sandbox.run("verify x.json").expect(0);
    sandbox.run(&format!("reference x/SIM-0002.h5 {shoulder} --out r.json")).expect(0);
}

/// Catches a file that replaces a device, which would take it from the whole machine, or a link.
#[test]
fn an_export_writes_to_pipes_and_where_links_lead() {
    let sandbox = scanned(1);
    let ledger = sandbox.run("export x/SIM-0001.h5 ledger").expect(0).out;

    // Opened for reading and writing, so that neither this test nor the program waits for the other.
    mknodat(CWD, sandbox.path("pipe"), FileType::Fifo, Mode::RWXU, 0).unwrap();
    let mut pipe = fs::OpenOptions::new().read(true).write(true).open(sandbox.path("pipe")).unwrap();
    sandbox.run("export x/SIM-0001.h5 ledger --out pipe").expect(0);
    assert!(fs::metadata(sandbox.path("pipe")).unwrap().file_type().is_fifo());
    assert_eq!(ioctl_fionread(&pipe).unwrap(), ledger.len() as u64);
    let mut read = vec![0; ledger.len()];
    pipe.read_exact(&mut read).unwrap();
    assert_eq!(read, ledger.as_bytes());

    sandbox.write("elsewhere.csv", &"longer than what is new\n".repeat(1000));
    symlink("elsewhere.csv", sandbox.path("link.csv")).unwrap();
    // A failed export leaves the old file unchanged.
    fs::copy(sandbox.path("x/SIM-0001.h5"), sandbox.path("bent.h5")).unwrap();
    bend(&sandbox.path("bent.h5"), "discriminators", 0);
    sandbox.run("export bent.h5 discriminators --out link.csv --force").expect(1);
    assert!(fs::read_to_string(sandbox.path("elsewhere.csv")).unwrap().starts_with("longer than"));
    sandbox.run("export x/SIM-0001.h5 ledger --out link.csv --force").expect(0);
    assert!(fs::symlink_metadata(sandbox.path("link.csv")).unwrap().is_symlink());
    assert_eq!(fs::read_to_string(sandbox.path("elsewhere.csv")).unwrap(), ledger);
    // To a link, also to one whose target does not exist yet.
    symlink("link.csv", sandbox.path("links.csv")).unwrap();
    symlink("later.csv", sandbox.path("early.csv")).unwrap();
    for (link, file) in [("links.csv", "elsewhere.csv"), ("early.csv", "later.csv")] {
        fs::write(sandbox.path("elsewhere.csv"), "").unwrap();
        sandbox.run(&format!("export x/SIM-0001.h5 ledger --out {link} --force")).expect(0);
        assert!(fs::symlink_metadata(sandbox.path(link)).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(sandbox.path(file)).unwrap(), ledger, "{link}");
    }
    // Others that share the output continue after it.
    symlink("/dev/stdout", sandbox.path("out.csv")).unwrap();
    for out in ["/dev/stdout", "/dev/fd/1", "out.csv"] {
        let mut shared = fs::File::create(sandbox.path("shared.txt")).unwrap();
        shared.write_all(b"before\n").unwrap();
        let mut export = sandbox.command(&format!("export x/SIM-0001.h5 ledger --out {out}"));
        assert!(export.stdout(shared.try_clone().unwrap()).status().unwrap().success());
        shared.write_all(b"after\n").unwrap();
        assert_eq!(
            fs::read_to_string(sandbox.path("shared.txt")).unwrap(),
            format!("before\n{ledger}after\n"),
            "{out}"
        );
    }
}

/// Catches a table that the program lacks, another length in it than was asked for, and a number that is let through.
#[test]
fn the_dissertations_tables() {
    let sandbox = Sandbox::new();
    for number in [4, 5, 6, 8, 9, 10, 11] {
        let [printed, other] = ["", " --effective-length table1"]
            .map(|length| sandbox.run(&format!("model table {number}{length}")).expect(0).out);
        // The first three are of the sound rubber.
        assert!(printed.lines().count() > 3 && (number < 8) == (printed == other), "table {number}: {printed}{other}");
    }
    sandbox.run("model table 7").expect(1);
}
