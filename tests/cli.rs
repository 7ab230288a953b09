//! The command line: usage, configuration, and the dissertation's tables.

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, symlink};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::io::ioctl_fionread;

use crate::rig::{Rig, bend};

#[test]
fn wrong_usage_has_its_own_exit_code() {
    let rig = Rig::new();
    rig.run("").expect(2);
    rig.run("rum").expect(2);
    rig.run("export archive.h5 verdict").expect(2);
    rig.run("--help").expect(0);
    for verb in ["run", "line", "status", "rig", "export", "reference", "verify", "report", "model table"] {
        assert!(rig.run(&format!("{verb} --help")).expect(0).out.contains("Usage"));
    }
}

#[test]
fn a_configuration_is_refused_by_name_of_what_is_wrong() {
    let rig = Rig::new();
    for (text, parts) in [
        ("[process]\nf_hi = 2000.0\n", &["f_hi", "c.toml"][..]),
        ("[fuse]\nindex = \"robst\"\n", &["robst", "robust"]),
        ("[process]\nf_c_hz = -1.0\n", &["f_c_hz", "-1"]),
        ("[fuse]\nreference = \"X/1\"\n", &["X/1"]),
        ("[scan]\nrepetitions = 0\n", &["scan.repetitions", "0"]),
        ("[acquire]\ntaps_per_s = 0.0\n", &["acquire.taps_per_s", "0"]),
        ("[scam]\n", &["scam"]),
        ("[scan\n", &["c.toml"]),
    ] {
        rig.write("c.toml", text);
        let done = rig.run("run --config c.toml --out x").expect(1);
        for part in parts {
            assert!(done.err.contains(part), "{part:?} is not in {:?}", done.err);
        }
        assert!(!rig.path("x").exists(), "{text}");
    }
    let done = rig.run("run --config none.toml").expect(1);
    assert!(done.err.contains("none.toml"), "{done:?}");
}

#[test]
fn an_archive_that_is_none_is_refused_by_name() {
    let rig = Rig::new();
    rig.write("text.h5", "not an archive");
    for arguments in ["verify text.h5", "export text.h5 ledger", "verify absent.h5", "export absent.h5 ledger"] {
        let name = arguments.split(' ').nth(1).unwrap();
        let done = rig.run(arguments).expect(1);
        assert!(done.err.contains(name), "{done:?}");
    }
}

/// A table must not be written over the archive it comes from.
#[test]
fn an_export_does_not_destroy_its_archive() {
    let rig = Rig::new();
    rig.write("c.toml", "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 1\nlocations = 9\n");
    rig.run("run --config c.toml --out x").expect(0);
    let done = rig.run("export x/SIM-0001.h5 ledger --out ./x/SIM-0001.h5").expect(1);
    assert!(done.err.contains("SIM-0001.h5"), "{done:?}");
    rig.run("verify x/SIM-0001.h5").expect(0);
    rig.run("export x/SIM-0001.h5 ledger --out ledger.csv").expect(0);
    assert_eq!(
        fs::read_to_string(rig.path("ledger.csv")).unwrap(),
        rig.run("export x/SIM-0001.h5 ledger").expect(0).out
    );
    assert!(!rig.path("ledger.csv.new").exists());
}

/// Catches an archive that a reference takes the place of, under its own name or by a link.
#[test]
fn a_reference_does_not_take_an_archives_place() {
    let rig = Rig::new();
    rig.write("c.toml", "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 1\nlocations = 20\n[fuse]\nreference = \"self\"\n");
    rig.run("run --config c.toml --stations 2 --out x").expect(0);
    fs::copy(rig.path("x/SIM-0002.h5"), rig.path("x.json")).unwrap();
    symlink("x/SIM-0002.h5", rig.path("link.json")).unwrap();
    let shoulder = "--shoulder SIM-0002/1 --shoulder SIM-0002/2";
    for out in ["x.json", "link.json"] {
        let done = rig.run(&format!("reference x/SIM-0002.h5 {shoulder} --out {out}")).expect(1);
        assert!(done.err.contains("is an HDF5 file"), "{done:?}");
    }
    rig.run("verify x/SIM-0002.h5").expect(0);
    rig.run("verify x.json").expect(0);
    rig.run(&format!("reference x/SIM-0002.h5 {shoulder} --out r.json")).expect(0);
}

/// Catches a file put in the place of a device, which takes that from the whole machine, or of a link.
#[test]
fn an_export_writes_to_pipes_and_where_links_lead() {
    let rig = Rig::new();
    rig.write("c.toml", "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 1\nlocations = 9\n");
    rig.run("run --config c.toml --out x").expect(0);
    let ledger = rig.run("export x/SIM-0001.h5 ledger").expect(0).out;

    // Opened to read and write it is there before the program is, and no one waits for anyone.
    mknodat(CWD, rig.path("pipe"), FileType::Fifo, Mode::RWXU, 0).unwrap();
    let mut pipe = fs::OpenOptions::new().read(true).write(true).open(rig.path("pipe")).unwrap();
    rig.run("export x/SIM-0001.h5 ledger --out pipe").expect(0);
    assert!(fs::metadata(rig.path("pipe")).unwrap().file_type().is_fifo());
    assert_eq!(ioctl_fionread(&pipe).unwrap(), ledger.len() as u64);
    let mut read = vec![0; ledger.len()];
    pipe.read_exact(&mut read).unwrap();
    assert_eq!(read, ledger.as_bytes());

    rig.write("elsewhere.csv", &"longer than what is new\n".repeat(1000));
    symlink("elsewhere.csv", rig.path("link.csv")).unwrap();
    // What fails leaves what was there.
    fs::copy(rig.path("x/SIM-0001.h5"), rig.path("bent.h5")).unwrap();
    bend(&rig.path("bent.h5"), "discriminators", 0);
    rig.run("export bent.h5 discriminators --out link.csv").expect(1);
    assert!(fs::read_to_string(rig.path("elsewhere.csv")).unwrap().starts_with("longer than"));
    rig.run("export x/SIM-0001.h5 ledger --out link.csv").expect(0);
    assert!(fs::symlink_metadata(rig.path("link.csv")).unwrap().is_symlink());
    assert_eq!(fs::read_to_string(rig.path("elsewhere.csv")).unwrap(), ledger);
    // To a link, and to nothing yet.
    symlink("link.csv", rig.path("links.csv")).unwrap();
    symlink("later.csv", rig.path("early.csv")).unwrap();
    for (link, file) in [("links.csv", "elsewhere.csv"), ("early.csv", "later.csv")] {
        fs::write(rig.path("elsewhere.csv"), "").unwrap();
        rig.run(&format!("export x/SIM-0001.h5 ledger --out {link}")).expect(0);
        assert!(fs::symlink_metadata(rig.path(link)).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(rig.path(file)).unwrap(), ledger, "{link}");
    }
    // Whoever shares the output goes on behind it.
    symlink("/dev/stdout", rig.path("out.csv")).unwrap();
    for out in ["/dev/stdout", "/dev/fd/1", "out.csv"] {
        let mut shared = fs::File::create(rig.path("shared.txt")).unwrap();
        shared.write_all(b"before\n").unwrap();
        let mut export = rig.command(&format!("export x/SIM-0001.h5 ledger --out {out}"));
        assert!(export.stdout(shared.try_clone().unwrap()).status().unwrap().success());
        shared.write_all(b"after\n").unwrap();
        assert_eq!(fs::read_to_string(rig.path("shared.txt")).unwrap(), format!("before\n{ledger}after\n"), "{out}");
    }
}

/// `export | head` is no failure.
#[test]
fn a_reader_that_leaves_is_no_failure() {
    let rig = Rig::new();
    rig.write(
        "c.toml",
        "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 9\n[simulation]\nsample_count = 1024\n",
    );
    rig.run("run --config c.toml --out x").expect(0);
    let mut export = rig.start("export x/SIM-0001.h5 discriminators");
    drop(export.stdout.take());
    assert_eq!(export.wait().unwrap().code(), Some(0));
}

/// All cells of Tables 4-6 and 8-10 within 1e-6 relative, of Table 11 within its rounding.
#[test]
fn the_dissertations_tables() {
    let Some(folder) = tapline_testing::shared("dissertation-tables") else { return };
    let rig = Rig::new();
    for number in [4, 5, 6, 8, 9, 10, 11] {
        let prefix = format!("table{number:02}");
        let printed = fs::read_dir(&folder).unwrap().flatten().map(|f| f.path());
        let printed = printed.into_iter().find(|p| p.file_name().unwrap().to_str().unwrap().starts_with(&prefix));
        let printed = fs::read_to_string(printed.unwrap()).unwrap();
        let computed = rig.run(&format!("model table {number}")).expect(0).out;
        let rows = |text: &str| -> Vec<Vec<String>> {
            text.lines().map(|line| line.split(',').map(|cell| cell.trim().to_owned()).collect()).collect()
        };
        let (printed, computed) = (rows(&printed), rows(&computed));
        assert_eq!(printed[0], computed[0], "columns of table {number}");
        assert_eq!(printed.len(), computed.len(), "rows of table {number}");
        for (line, (printed, computed)) in printed.iter().zip(&computed).enumerate().skip(1) {
            for (p, c) in printed.iter().zip(computed) {
                let (p, c): (f64, f64) = (p.parse().unwrap(), c.parse().unwrap());
                let bound = if number == 11 { 5.1e-4 } else { 1e-6 * p.abs() };
                assert!((p - c).abs() <= bound, "table {number}, line {line}: printed {p}, computed {c}");
            }
        }
        assert_ne!(rig.run(&format!("model table {number} --effective-length table1")).expect(0).out, "");
    }
    rig.run("model table 7").expect(1);
}

/// Catches an error that says its cause twice, or not at all.
#[test]
fn a_cause_is_told_once() {
    let rig = Rig::new();
    for arguments in ["export nothere.h5 verdicts", "verify nothere.h5"] {
        let done = rig.run(arguments).expect(1);
        assert_eq!(done.err.matches("No such file or directory").count(), 1, "{done:?}");
        assert!(done.err.contains("nothere.h5"), "{done:?}");
    }
}
