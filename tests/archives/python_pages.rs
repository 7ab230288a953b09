//! The pages for people with Python: their code runs as printed, in order, on an archive of the program.

use std::ffi::OsStr;
use std::fs;
use std::process::Command;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::{bend, names};
use tapline_testing::documents::{csv_rows, docs, text};
use tapline_testing::program::Done;

/// The scan of the picture on the page.
const SCAN: &str = "
[scan]
locations = 100
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
[[scan.tyre]]
serial = \"A-17\"
crack = [{ shoulder = 2, first_location = 40, location_count = 9, depth_mm = 6.0, length_mm = 22.0 }]
[fuse]
reference = \"self\"
";

/// The Python code of a page, each line at its line number on the page, so that an error names that line.
fn python_of(page: &str) -> String {
    let mut is_code = false;
    let lines = page.lines().map(|line| {
        let begins = line == "```python";
        let was_code = is_code;
        is_code = begins || (is_code && line != "```");
        if was_code && is_code { format!("{line}\n") } else { "\n".to_owned() }
    });
    lines.collect()
}

/// A folder with an archive, and newer results of it beside it.
fn scanned() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("line.toml", SCAN);
    sandbox.write("again.toml", "[process]\nf_c_hz = 600.0\n[fuse]\nreference = \"self\"\n");
    sandbox.run("run --config line.toml --out scanned").expect(0);
    // A finished file needs nothing else, wherever it is and whatever its name.
    fs::copy(sandbox.path("scanned/A-17.h5"), sandbox.path("run.h5")).unwrap();
    sandbox.run("reprocess run.h5 --config again.toml").expect(0);
    sandbox
}

/// What the page prints if `python` runs it in the folder of `sandbox`.
fn run_page(sandbox: &Sandbox, python: &OsStr, page: &str) -> String {
    run_code(sandbox, python, &page.replace(".md", ".py"), &python_of(&text(&docs(page))))
}

/// What `code` prints as the file `name` in the folder of `sandbox`.
fn run_code(sandbox: &Sandbox, python: &OsStr, name: &str, code: &str) -> String {
    sandbox.write(name, code);
    let mut command = Command::new(python);
    command.arg(name).current_dir(sandbox.path("")).env("PYTHONIOENCODING", "utf-8");
    Done::from(command.env("MPLCONFIGDIR", sandbox.path("mpl")).output().unwrap()).expect(0).out
}

/// Catches code on the page that does not run, or finds other taps, verdicts or regions than the program.
#[test]
fn reading_archives_runs_as_it_stands() {
    let Some(python) = tapline_testing::python_with("h5py, hdf5plugin, pandas, matplotlib") else { return };
    let sandbox = scanned();
    let said = run_page(&sandbox, &python, "reading-archives.md");
    println!("{said}");
    let rows = csv_rows(&sandbox.run("export run.h5 discriminators").expect(0).out);
    assert!(said.contains(&format!("clipped: 0 of {}", rows.len())), "{said}");
    for verdict in csv_rows(&sandbox.run("export run.h5 verdicts").expect(0).out) {
        let line = said.lines().find(|line| line.starts_with("A-17 ") && line.contains(&verdict["verdict"]));
        let line = line.unwrap_or_else(|| panic!("no {verdict:?} in {said}"));
        assert!(line.contains(&verdict["reasons"]), "{line} {verdict:?}");
    }
    let regions = csv_rows(&sandbox.run("export run.h5 regions").expect(0).out);
    assert_eq!(regions.len(), 1);
    assert!(said.contains(&format!("[{}, ", regions[0]["first_location"])), "{said} {regions:?}");
    assert!(said.contains("of the taps of run.h5 (402, 2, 2048)"), "{said}");
    let differs = said.lines().find_map(|line| line.strip_prefix("PR differs by at most ")).unwrap();
    assert!(differs.parse::<f64>().unwrap() > 1e-3, "{differs}");
    let picture = fs::read(sandbox.path("reading-archives.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 10_000, "{} bytes", picture.len());
    let kept = docs("reading-archives.png").metadata().unwrap().len();
    assert!((10_000..150_000).contains(&kept), "{kept} bytes are committed");
}

/// Catches a page that rescues no taps of an archive that the program refuses, or takes altered ones.
#[test]
fn taps_of_a_damaged_archive_are_rescued_as_the_page_says() {
    let Some(python) = tapline_testing::python_with("h5py, hdf5plugin, pandas, blake3") else { return };
    let sandbox = scanned();
    let page = text(&docs("reading-archives.md"));
    let first = page.split("## Every tap").next().unwrap();
    let rescue = page.split("## Rescue taps").nth(1).unwrap().split("\n## ").next().unwrap();
    let rescued = |name| run_code(&sandbox, &python, name, &python_of(&format!("{first}{rescue}")));
    let count = csv_rows(&sandbox.run("export run.h5 discriminators").expect(0).out).len();
    let said = rescued("whole.py");
    assert!(said.ends_with(&format!("rescued {count} taps\n")), "{said}");
    // A byte of a table, for which every verb refuses the file, and one of the samples of tap 5.
    bend(&sandbox.path("run.h5"), "discriminators", 700);
    let chunk =
        hdf5::File::open(sandbox.path("run.h5")).unwrap().dataset("taps/samples").unwrap().chunk_info(5).unwrap();
    let mut bytes = fs::read(sandbox.path("run.h5")).unwrap();
    bytes[usize::try_from(chunk.addr + chunk.size / 2).unwrap()] ^= 16;
    fs::write(sandbox.path("run.h5"), bytes).unwrap();
    sandbox.run("export run.h5 taps --out taps").expect(1);
    let said = rescued("damaged.py");
    assert!(said.ends_with(&format!("rescued {} taps\n", count - 1)), "{said}");
    let bytes = (count - 1) * 2 * 2048 * 2;
    assert!(sandbox.path("rescued.npz").metadata().unwrap().len() > bytes as u64);
}

/// Catches a page that computes checksums differently from the program, or finds no damage.
#[test]
fn checksums_are_computed_as_the_page_says() {
    let Some(python) = tapline_testing::python_with("h5py, hdf5plugin, blake3, xxhash") else { return };
    let sandbox = scanned();
    assert_eq!(run_page(&sandbox, &python, "archive-layout.md"), "corrupt: []\n");
    // Results have other attributes, which the digest covers too.
    let is_results = |name: &String| name.starts_with("run.") && name.ends_with(".h5") && name != "run.h5";
    let results = names(&sandbox.path("")).into_iter().find(is_results).unwrap();
    let code = python_of(&text(&docs("archive-layout.md"))).replace("run.h5", &results);
    assert_eq!(run_code(&sandbox, &python, "of-results.py", &code), "corrupt: []\n", "{results}");
    let bend = "import h5py\nwith h5py.File('run.h5', 'r+') as f:\n    row = f['discriminators'][7]\n    row['pr'] += 1e-9\n    \
                f['discriminators'][7] = row\n    f.attrs['geometry'] = 'line'\n";
    sandbox.python(&python, bend, &[]);
    let said = run_page(&sandbox, &python, "archive-layout.md");
    assert_eq!(said, "corrupt: [('discriminators', 7), ('root', 0)]\n");
    // A byte of the last block of a tap, whose checksum is only in the head.
    let block = "import h5py\nwith h5py.File('run.h5', 'r') as f:\n    chunk = f['taps/samples'].id.get_chunk_info(5)\n\
                 with open('run.h5', 'r+b') as f:\n    f.seek(chunk.byte_offset + chunk.size - 9)\n    \
                 byte = f.read(1)[0]\n    f.seek(-1, 1)\n    f.write(bytes([byte ^ 4]))\n";
    sandbox.python(&python, block, &[]);
    let said = run_page(&sandbox, &python, "archive-layout.md");
    assert_eq!(said, "corrupt: [('discriminators', 7), ('stored', 5), ('root', 0)]\n");
}

/// Catches a table of flags in the page's code that is out of date.
#[test]
fn words_on_the_page_are_the_program_s() {
    let page = text(&docs("reading-archives.md"));
    let reasons: Vec<String> = tapline_wire::Reasons::ALL.iter().map(|(_, name)| format!("\"{name}\"")).collect();
    let list = page.split("REASONS = [").nth(1).unwrap().split(']').next().unwrap();
    let listed: Vec<&str> = list.split(',').map(str::trim).collect();
    assert_eq!(listed, reasons);
    let verdicts: Vec<String> = tapline_wire::Verdict::ALL.iter().map(|verdict| format!("\"{verdict}\"")).collect();
    assert!(page.contains(&format!("VERDICTS = [\"none\", {}]", verdicts.join(", "))));
}
