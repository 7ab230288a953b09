//! `tapline reprocess`, `explain` and `diff`: new results beside archives, and the origin of numbers.

use std::fs::{self, OpenOptions};
use std::io::BufRead as _;
use std::os::unix::fs::FileExt as _;
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use tapline_store::{Reader, verify};
use tapline_wire::TapState;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::{assert_same, contents, names};

/// A cracked tyre.
const CONFIG: &str = "
[scan]
locations = 40
offsets_mm = [0.0, 5.0]
velocities_m_per_s = [1.5]
repetitions = 2
confirm = false
[[scan.tyre]]
serial = \"CRACKED\"
crack = [{ shoulder = 1, first_location = 10, location_count = 8, depth_mm = 5.0 }]
[fuse]
reference = \"self\"
";

fn scanned() -> (Sandbox, PathBuf) {
    let sandbox = Sandbox::new();
    let archive = scan(&sandbox, CONFIG);
    (sandbox, archive)
}

/// The file of a run's only casing, moved away; newer results are written beside it.
fn scan(sandbox: &Sandbox, config: &str) -> PathBuf {
    sandbox.write("line.toml", config);
    sandbox.run("run --config line.toml --out run").expect(0);
    fs::rename(sandbox.path("run/CRACKED.h5"), sandbox.path("run.h5")).unwrap();
    fs::remove_dir_all(sandbox.path("run")).unwrap();
    sandbox.path("run.h5")
}

/// The file that `reprocess` with `arguments` prints.
fn again(sandbox: &Sandbox, arguments: &str) -> PathBuf {
    let done = sandbox.run(&format!("reprocess {arguments}")).expect(0);
    sandbox.path(done.out.trim())
}

/// Catches results that differ by a bit from the line's, or depend on the number of threads, and an archive that is
/// changed.
#[test]
fn the_same_lineage_gives_the_same_bits() {
    let (sandbox, archive) = scanned();
    let before = fs::read(&archive).unwrap();
    let one = again(&sandbox, "run.h5 --from-samples --jobs 1");
    let (live, redone) = (Reader::open(&archive).unwrap(), Reader::open(&one).unwrap());
    assert_eq!(live.lineage_key().unwrap(), redone.lineage_key().unwrap());
    assert!(redone.is_results() && one.to_string_lossy().contains(&live.lineage_key().unwrap()[..12]));
    assert_same(&contents(&archive), &contents(&one));
    assert!(verify(&one).unwrap().is_complete());
    let bytes = fs::read(&one).unwrap();
    for arguments in ["run.h5 --from-samples --jobs 3", "run.h5"] {
        fs::remove_file(&one).unwrap();
        assert_eq!(again(&sandbox, arguments), one);
        assert!(fs::read(&one).unwrap() == bytes, "{arguments} gives other bytes");
    }
    assert!(fs::read(&archive).unwrap() == before, "the archive has changed");
    // Every other verb reads results like an archive.
    for verb in ["verdicts", "damage", "discriminators"] {
        let exported = |path: &PathBuf| sandbox.run(&format!("export {} {verb}", path.display())).expect(0).out;
        assert_eq!(exported(&archive), exported(&one), "{verb}");
    }
    sandbox.run(&format!("report {} --out pages", one.display())).expect(0);
    let refused = sandbox.run(&format!("reprocess {}", one.display()));
    assert!(refused.code == Some(1) && refused.err.contains("only results"), "{}", refused.err);
}

/// Catches a difference between the beginning of a record that is unpacked alone, and the same beginning on the line,
/// which had the whole record.
#[test]
fn beginnings_give_the_same_bits() {
    let sandbox = Sandbox::new();
    let config = format!("{CONFIG}[process]\nrecord_s = 0.025\n");
    scan(&sandbox, &config);
    let redone = again(&sandbox, "run.h5 --from-samples --jobs 2");
    assert_same(&contents(&sandbox.path("run.h5")), &contents(&redone));
    sandbox.write("whole.toml", "[process]\nrecord_s = 0.0\n");
    let whole = again(&sandbox, "run.h5 --config whole.toml");
    let printed = sandbox.run(&format!("diff run.h5 {}", whole.display())).expect(0).out;
    assert!(printed.contains("process.record_s: 0.025 -> 0.0"), "{printed}");
    // The pulse is in the beginning; the power is scaled to the record's length.
    assert!(printed.contains("f_max      the same") && printed.contains("e_f        328 differ"), "{printed}");
}

/// Catches options that change numbers but not the lineage, new weights that need the samples, and a difference that is
/// not printed.
#[test]
fn other_options_stand_beside() {
    let (sandbox, archive) = scanned();
    sandbox.write("index.toml", "[fuse]\nindex = \"dissertation\"\nreference = \"self\"\n");
    // If no reference is named, the archive's own is used.
    sandbox.write("bands.toml", "[process]\nf_c_hz = 600.0\n");
    let weights = again(&sandbox, "run.h5 --config index.toml");
    let bands = again(&sandbox, "run.h5 --config bands.toml");
    let key = |path: &PathBuf| Reader::open(path).unwrap().lineage_key().unwrap();
    assert!(key(&archive) != key(&weights) && key(&weights) != key(&bands) && key(&archive) != key(&bands));

    let printed = |here: &PathBuf| sandbox.run(&format!("diff run.h5 {}", here.display())).expect(0).out;
    let of_weights = printed(&weights);
    assert!(of_weights.contains("fuse.index: \"fused\" -> \"dissertation\""), "{of_weights}");
    assert!(of_weights.contains("pr         the same") && of_weights.contains("index differs"), "{of_weights}");
    let of_bands = printed(&bands);
    assert!(of_bands.contains("process.f_c_hz: 550.0 -> 600.0"), "{of_bands}");
    assert!(of_bands.contains("f_max      the same") && of_bands.contains("pr         328 differ"), "{of_bands}");
    let of_itself = printed(&archive);
    assert!(of_itself.contains("lineage    the same") && !of_itself.contains("differ"), "{of_itself}");

    let said = sandbox.run(&format!("explain {} --shoulder CRACKED/1 --location 12", bands.display())).expect(0).out;
    for words in
        [&key(&bands)[..], "process.f_c_hz = 600.0 (default 550.0)", "this program's own sources", "REJECT", "tau_s"]
    {
        assert!(said.contains(words), "{words} is not in {said}");
    }
    // Each discriminator over a crack, by its own score.
    let score = said.lines().find(|line| line.starts_with(" f_max ")).and_then(|line| line.split_whitespace().last());
    assert!(score.unwrap().parse::<f64>().unwrap() > 3.0, "{said}");
    let velocities = said.lines().find(|line| line.contains("velocity_m_per_s   ")).unwrap();
    assert_eq!(velocities.matches("1.5").count(), 4, "four taps: {said}");
}

/// Catches taps that are not compared because other recordings of them came by way of a tap set, and an error that does not say
/// which taps differ.
#[test]
fn the_same_taps_are_compared_wherever_they_come_from() {
    let (sandbox, _) = scanned();
    sandbox.run("export run.h5 taps --out taps").expect(0);
    sandbox.run("run --taps taps --reference self --out twin").expect(0);
    let printed = sandbox.run("diff run.h5 twin/CRACKED.h5").expect(0).out;
    assert!(
        printed.contains("or in their station, plan or kind of source") && printed.contains("REJECT, index the same"),
        "{printed}"
    );
    assert!(!printed.contains("units or angles differ"), "{printed}");
    // Recordings from elsewhere are other recordings, but their numbers are the same.
    fs::create_dir(sandbox.path("before")).unwrap();
    fs::copy(sandbox.path("run.h5"), sandbox.path("before/CRACKED.h5")).unwrap();
    let end = sandbox.run("diff before twin --summary").expect(0).out;
    assert_eq!(end, "1 casing compared: 1 has the same numbers, 0 verdicts differ\n");
    let turned = fs::read_to_string(sandbox.path("taps/taps.csv")).unwrap().replace(",1,9,", ",1,9.5,");
    sandbox.write("taps/taps.csv", &turned);
    sandbox.run("run --taps taps --reference self --out turned").expect(0);
    let printed = sandbox.run("diff run.h5 turned/CRACKED.h5").expect(0).out;
    assert!(printed.contains("units or angles differ"), "{printed}");
    scan(&sandbox, &CONFIG.replace("repetitions = 2", "repetitions = 1"));
    let refused = sandbox.run("diff run.h5 twin/CRACKED.h5").expect(1).err;
    assert!(refused.contains("0 taps are planned only in the first, 164 only in the second"), "{refused}");
}

/// Catches samples that are read for new weights or limits: the archive has no valid ones left.
#[test]
fn another_index_needs_no_samples() {
    let (sandbox, archive) = scanned();
    sandbox.write("index.toml", "[fuse]\nindex = \"dissertation\"\nre_inspect_rate = 0.01\nreference = \"self\"\n");
    let judged = || {
        let results = again(&sandbox, "run.h5 --config index.toml");
        let exported = |verb: &str| sandbox.run(&format!("export {} {verb}", results.display())).expect(0).out;
        let found = (exported("verdicts"), exported("damage"));
        fs::remove_file(results).unwrap();
        found
    };
    let whole = judged();
    let samples = hdf5::File::open(&archive).unwrap().dataset("taps/samples").unwrap();
    let chunks = (0..samples.num_chunks().unwrap()).map(|k| samples.chunk_info(k).unwrap());
    let spans: Vec<_> = chunks.map(|chunk| (chunk.addr, chunk.size)).collect();
    drop(samples);
    let file = OpenOptions::new().write(true).open(&archive).unwrap();
    for (start, size) in spans {
        file.write_all_at(&vec![0; usize::try_from(size).unwrap()], start).unwrap();
    }
    assert!(whole.0.contains("REJECT") && judged() == whole);
    // Results that cannot be finished are not left for the other verbs.
    let before = names(&sandbox.path("."));
    let refused = sandbox.run("reprocess run.h5 --from-samples");
    assert!(refused.code == Some(1) && refused.err.contains(": its samples "), "{}", refused.err);
    assert_eq!(names(&sandbox.path(".")), before);
}

/// Catches work that is lost or repeated when reprocessing is killed, and an incomplete file that passes for a complete
/// one.
#[test]
fn what_was_killed_goes_on() {
    let sandbox = Sandbox::new();
    scan(&sandbox, &CONFIG.replace("repetitions = 2", "repetitions = 8"));
    let whole = again(&sandbox, "run.h5 --from-samples --jobs 1");
    let bytes = contents(&whole);
    fs::remove_file(&whole).unwrap();
    // Killed later and earlier, until one has some of the taps but not all.
    let mut pause = Duration::from_millis(2);
    let was_cut = (0..100).any(|_| {
        drop(fs::remove_file(&whole));
        let mut child =
            sandbox.command("reprocess run.h5 --from-samples --jobs 1").stdout(Stdio::null()).spawn().unwrap();
        sleep(pause);
        child.kill().unwrap();
        child.wait().unwrap();
        let Ok(reader) = Reader::open_unfinished(&whole) else {
            pause = pause.mul_f64(1.1);
            return false;
        };
        assert!(reader.is_finished() || Reader::open(&whole).is_err(), "half-made, it passes for whole");
        assert_eq!(verify(&whole).unwrap().problems, []);
        let missing = reader.ledger().count(TapState::Missing);
        pause = pause.mul_f64(if missing > 0 { 1.1 } else { 0.8 });
        missing > 0 && missing < reader.plan().taps().len()
    });
    assert!(was_cut, "none was cut in the middle");
    assert_eq!(again(&sandbox, "run.h5 --from-samples"), whole);
    assert_same(&contents(&whole), &bytes);
}

/// Catches an archive that counts as failed because another process is judging it again, or has just done so.
#[test]
fn two_processes_share_the_work() {
    let (sandbox, archive) = scanned();
    fs::create_dir(sandbox.path("x")).unwrap();
    for k in 0..12 {
        fs::copy(&archive, sandbox.path(&format!("x/{k}.h5"))).unwrap();
    }
    let start = || {
        let mut command = sandbox.command("reprocess x --from-samples --jobs 2");
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for done in [start(), start()].map(|child| child.wait_with_output().unwrap()) {
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        assert_eq!(done.stdout.lines().count(), 12);
    }
    sandbox.run("verify x").expect(0);
}

/// Catches a program that dies by a signal, or that mistakes the rest for everything, when the archive that it reads is
/// truncated.
#[test]
fn an_archive_that_is_cut_meanwhile_is_reported() {
    let (sandbox, archive) = scanned();
    // Later and earlier, until the taps are being read.
    let mut pause = Duration::from_millis(12);
    let was_reported = (0..100).any(|round| {
        let cut = sandbox.path(&format!("cut-{round}.h5"));
        fs::copy(&archive, &cut).unwrap();
        let mut command = sandbox.command(&format!("reprocess cut-{round}.h5 --from-samples --jobs 2"));
        let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        sleep(pause);
        OpenOptions::new().write(true).open(&cut).unwrap().set_len(20_000).unwrap();
        let done = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.signal(), None, "{said}");
        let is_reported = done.status.code() != Some(0);
        assert!(!is_reported || said.contains(&format!("cut-{round}")), "{said}");
        pause = pause.mul_f64(if is_reported { 1.15 } else { 0.8 });
        // Others are truncated before they are opened, or are not opened as archives.
        said.contains("cannot read samples")
    });
    assert!(was_reported, "it was never cut while it was read");
}

/// Catches a missing reference, archives that cannot be compared, and places that do not exist, if their error names
/// nothing.
#[test]
fn what_cannot_be_done_is_an_error_with_names() {
    let (sandbox, _) = scanned();
    sandbox.write("wrong.toml", "[process]\nf_c_hz = -1.0\n[fuse]\nreference = \"self\"\n");
    for (arguments, words) in [
        ("reprocess run.h5 --jobs 5000", "5000"),
        ("reprocess run.h5 --config wrong.toml", "f_c_hz"),
        ("reprocess run.h5 --reference NONE/1", "NONE/1"),
        ("reprocess run.h5 --reference CRACKED/1", "CRACKED/1, which is known to be cracked"),
        ("reprocess gone.h5", "gone.h5"),
        ("explain run.h5 --shoulder NONE/1", "no shoulder \"NONE/1\""),
        ("explain run.h5 --shoulder CRACKED/2 --location 99", "no location 99"),
    ] {
        let done = sandbox.run(arguments);
        assert!(done.code == Some(1) && done.err.contains(words), "{arguments}: {:?} {}", done.code, done.err);
    }
    let done = sandbox.run("explain run.h5 --location 3");
    assert!(done.code == Some(2) && done.err.contains("--shoulder"), "{done:?}");
    let archives = names(&sandbox.path("")).into_iter().filter(|name| name.ends_with(".h5"));
    assert_eq!(archives.collect::<Vec<_>>(), ["run.h5"], "what is refused leaves no file");
}

/// Catches results that pass for those of other taps.
#[test]
fn results_hold_to_their_taps() {
    let (sandbox, archive) = scanned();
    let results = again(&sandbox, "run.h5");
    fs::remove_file(&archive).unwrap();
    scan(&sandbox, &CONFIG.replace("locations = 40", "locations = 40\nseed = 9"));
    let done = sandbox.run(&format!("explain {}", results.display()));
    assert!(done.code == Some(1), "{done:?}");
    assert!(done.err.contains("results of the taps") || done.err.contains("scan plan"), "{}", done.err);
    fs::remove_file(&archive).unwrap();
    let done = sandbox.run(&format!("verify {}", results.display()));
    assert!(done.code == Some(1) && done.err.contains("run.h5"), "{done:?}");
}

/// Catches two processes that write one file, so that one ends with half an archive and reports success.
#[test]
fn two_that_pack_under_one_name_do_no_harm() {
    let (sandbox, _) = scanned();
    let start = |codec: &str| sandbox.start(&format!("repack run.h5 --codec {codec} --out small.h5"));
    let both = [start("zstd"), start("gzip")].map(|child| child.wait_with_output().unwrap());
    let done = both.iter().filter(|out| out.status.success()).count();
    assert_eq!(done, 1, "{both:?}");
    sandbox.run("verify small.h5").expect(0);
    let ledger = sandbox.run("export small.h5 ledger").expect(0).out;
    assert_eq!(ledger.lines().filter(|line| line.contains(",archived,")).count(), 328);
}
