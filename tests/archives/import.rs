//! A simulated casing goes through every format that is imported, and its taps come out as they were.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use tapline_testing::documents::{csv_rows, docs, text};
use tapline_testing::program::Done;

use crate::archives::export_taps::run;
use crate::sandbox::Sandbox;

/// What the recordings of the simulated rig do not contain.
const CONFIG: &str = "table = \"taps.csv\"\npre_trigger_samples = 512\nmicrophone_distance_m = DISTANCE\n";

/// Discriminators in the export of a table.
const FOUND: [&str; 8] = ["f_max", "tau_s", "a_1", "a_2", "pr", "p_f", "e_f", "centroid_hz"];

/// Writes the counts of an archive as HDF5, TDMS and MATLAB files with integers, and as CSV in N and V.
const WRITE: &str = r#"
import csv, os, hdf5plugin, h5py, numpy as np, scipy.io
from nptdms import ChannelObject, TdmsWriter
archive = h5py.File("run.h5")
samples, header = archive["taps/samples"][:], archive["taps/header"][:]
rows = list(csv.DictReader(open("wav/taps.csv", encoding="utf-8")))
def table(folder, place):
    with open(folder + "/taps.csv", "w", newline="", encoding="utf-8") as out:
        names = [name for name in rows[0] if not name.endswith(("_n", "_v", "distance_m"))] + ["part"]
        lines = csv.DictWriter(out, names, extrasaction="ignore")
        lines.writeheader()
        for k, row in enumerate(rows):
            lines.writerow({**row, **dict(zip(("file", "part"), place(k)))})
for folder in ["hdf5", "tdms", "mat5", "csv"]:
    os.mkdir(folder)
with h5py.File("hdf5/all.h5", "w") as file:
    file["force"], file["sound"] = samples[:, 0], samples[:, 1]
table("hdf5", lambda k: ("all.h5", k + 1))
with TdmsWriter("tdms/all.tdms") as file:
    for k, tap in enumerate(samples):
        file.write_segment([ChannelObject(f"tap {k}", name, v) for name, v in zip(["force", "sound"], tap)])
table("tdms", lambda k: ("all.tdms", f"tap {k}"))
scipy.io.savemat("mat5/all.mat", {f"tap_{k}": {"force": t[0], "sound": t[1]} for k, t in enumerate(samples)}, do_compression=True)
table("mat5", lambda k: ("all.mat", f"tap_{k}"))
for k, tap in enumerate(samples):
    np.savetxt(f"csv/{k}.csv", (tap * header[k]["unit_per_count"][:2, None]).T, "%.17g", ",", header="force,sound", comments="")
table("csv", lambda k: (f"{k}.csv", ""))
"#;

/// Runs an import of all recordings in `folder`.
fn import(sandbox: &Sandbox, folder: &str, config: &str) -> Done {
    sandbox.write(&format!("{folder}/import.toml"), config);
    let mut files: Vec<PathBuf> = Vec::new();
    let mut folders = vec![sandbox.path(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            match entry.is_dir() {
                true => folders.push(entry),
                false if entry.extension().is_some_and(|ending| ending != "toml") && !entry.ends_with("truth.csv") => {
                    files.push(entry)
                }
                false => {}
            }
        }
    }
    let arguments = format!("import --config {folder}/import.toml --out {folder}-set");
    Done::from(sandbox.command(&arguments).args(files).output().unwrap())
}

/// Catches a sample, a scale, a rate or a tap that an import changes: discriminators of integers must be the very same, those of
/// physical values in floats the same to six digits.
#[test]
fn a_casing_comes_back_from_every_format() {
    let Some(python) = tapline_testing::python_with("hdf5plugin, h5py, nptdms, scipy") else { return };
    let sandbox = run();
    let table = |archive: &str| sandbox.run(&format!("export {archive} discriminators")).expect(0).out;
    let before = table("run.h5");
    for format in ["wav", "uff", "mat"] {
        sandbox.run(&format!("export run.h5 taps --format {format} --out {format}")).expect(0);
    }
    sandbox.python(&python, WRITE, &[]);
    let scan = fs::read_to_string(sandbox.path("wav/scan.toml")).unwrap();
    let value = |key: &str| scan.lines().find_map(|l| l.strip_prefix(&format!("{key} = "))).unwrap().to_owned();
    let config = CONFIG.replace("DISTANCE", &value("microphone_distance_m"));
    let names = "channels = { force = \"force\", sound = \"sound\" }\n";
    let numbers = "channels = { force = 1, sound = 2 }\n";
    let rate = format!("sample_rate_hz = {}\n", value("sample_rate_hz"));
    let [force, sound] = ["force_full_scale_n", "sound_full_scale_v"].map(|key| format!("{key} = {}\n", value(key)));
    let scales = format!("{force}{sound}");
    let si = "force_full_scale_n = 1\nsound_full_scale_v = 1\n";
    for (folder, more, is_exact) in [
        ("wav", format!("{numbers}{scales}"), true),
        ("hdf5", format!("{names}{rate}{scales}time_axis = 2\n"), true),
        ("tdms", format!("{names}{rate}{scales}"), true),
        ("mat5", format!("{names}{rate}{scales}"), true),
        ("csv", format!("{names}{rate}{si}"), false),
        // These say rate, trigger, units and distance themselves.
        ("uff", "channels = { force = \"Force\", sound = \"Sound\" }\n".to_owned(), false),
        ("mat", names.to_owned(), false),
    ] {
        let own = ["uff", "mat"].contains(&folder);
        let config = if own { CONFIG.lines().next().unwrap() } else { &config };
        let done = import(&sandbox, folder, &format!("{config}\n{more}")).expect(0);
        assert_eq!(done.out, format!("{folder}-set: 124 taps written, 0 refused\n"));
        assert_eq!(done.err, "", "{folder}");
        fs::copy(sandbox.path("wav/truth.csv"), sandbox.path(&format!("{folder}-set/truth.csv"))).unwrap();
        sandbox.run(&format!("run --taps {folder}-set --config wav/config.toml --out {folder}-again")).expect(0);
        let after = table(&format!("{folder}-again/CRACKED.h5"));
        if is_exact {
            assert_eq!(before, after, "{folder}");
            continue;
        }
        let (before, after) = (csv_rows(&before), csv_rows(&after));
        assert_eq!(before.len(), after.len());
        for (before, after) in before.iter().zip(&after) {
            for name in FOUND {
                let [was, is] = [before, after].map(|row| row[name].parse::<f64>().unwrap());
                assert!(((is - was) / was).abs() < 1e-5, "{folder}: {name} was {was}, is {is}");
            }
            assert_eq!(before["location"], after["location"]);
        }
    }
}

/// Catches an example whose command does not work as it is printed, or ends without a verdict on its cracks.
#[test]
fn the_example_works_as_printed() {
    let sandbox = Sandbox::new();
    let printed = sandbox.run("import --example start").expect(0).out;
    let commands: Vec<&str> = printed.lines().filter(|line| line.starts_with("tapline ")).collect();
    assert_eq!(commands.len(), 2, "{printed}");
    let mut last = String::new();
    for command in commands {
        // As a shell would, which expands the pattern.
        let program = env!("CARGO_BIN_EXE_tapline");
        let line = command.replacen("tapline", &format!("'{program}'"), 1);
        let mut shell = Command::new("sh");
        shell.args(["-c", &line]).current_dir(sandbox.path("")).env("XDG_RUNTIME_DIR", sandbox.path(""));
        last = Done::from(shell.output().unwrap()).expect(0).out;
    }
    assert!(sandbox.path("start/judged/A-17.h5").exists());
    assert!(last.starts_with("REJECT     A-17/1\n"), "the cracks that were planted: {last}");
    // The lines to copy of the page are those of the example.
    let page = text(&docs("import.md"));
    let blocks: Vec<&str> = page.split("```toml\n").skip(1).filter_map(|block| block.split("```").next()).collect();
    sandbox.write("start/recordings/import.toml", blocks[0]);
    fs::remove_dir_all(sandbox.path("start/taps")).unwrap();
    let done = import(&sandbox, "start/recordings", blocks[0]).expect(0);
    assert_eq!(done.out, "start/recordings-set: 100 taps written, 0 refused\n");
    // One that is cut short is refused, and the others are imported.
    sandbox.write("start/recordings/A-17_1_003.wav", "RIFF");
    fs::remove_dir_all(sandbox.path("start/recordings-set")).unwrap();
    let done = import(&sandbox, "start/recordings", blocks[0]).expect(3);
    assert!(
        done.err.starts_with("refused: ")
            && done.err.contains("A-17_1_003.wav: not a WAV file: it ends at byte 4, within its header"),
        "{done:?}"
    );
    let said = "start/recordings-set: 99 taps written, 1 refused; taps.csv lists them with the reason\n";
    assert_eq!(done.out, said);
    // The other one is valid too: what is missing is the file.
    sandbox.write("plan.toml", blocks[1]);
    let done = sandbox.run("import A-17.tdms --config plan.toml --out none").expect(1);
    assert!(done.err.contains("none of the 808 taps can be imported: A-17.tdms: cannot be read"), "{done:?}");
    let again = sandbox.run("import --example start").expect(1);
    assert!(again.err.contains("start: cannot be written: it has files in it"), "{again:?}");
    sandbox.run("import a.wav --out x").expect(2);
}
