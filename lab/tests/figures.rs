//! `tapline-lab figures`: the committed figures are those that the program draws.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::sandbox::Sandbox;

const NUMBERS: [u8; 19] = [11, 12, 13, 16, 17, 18, 19, 20, 22, 23, 24, 25, 26, 27, 31, 32, 36, 37, 38];

fn committed() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/figures")
}

fn cells(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

/// Catches committed figures that went stale, one that is not written, and one without a file: numbers to 1e-6. And a picture that
/// is no XML (an attribute twice), is too large to keep, or does not say what it shows.
#[test]
fn committed_figures_are_up_to_date() {
    const BYTES_MOST: u64 = 60_000;
    let sandbox = Sandbox::new();
    let printed = sandbox.run("figures --out drawn").expect(0).out;
    assert_eq!(printed.lines().count(), 2 * NUMBERS.len(), "{printed}");
    assert_eq!(fs::read_dir(committed()).unwrap().count(), 2 * NUMBERS.len());
    for number in NUMBERS {
        let name = format!("fig{number}.csv");
        let (drawn, kept) = (cells(&sandbox.path("drawn").join(&name)), cells(&committed().join(&name)));
        assert_eq!((drawn.len(), &drawn[0]), (kept.len(), &kept[0]), "{name}");
        for (drawn, kept) in drawn.iter().zip(&kept).skip(1) {
            let number = |cell: &str| cell.parse::<f64>().unwrap();
            let is_same = drawn.len() == 5
                && drawn[..2] == kept[..2]
                && drawn[4] == kept[4]
                && (2..4).all(|i| (number(&drawn[i]) - number(&kept[i])).abs() <= 1e-6 * number(&kept[i]).abs());
            assert!(is_same, "{name}: {kept:?} is now {drawn:?}: run `tapline-lab figures --out docs/figures`");
        }
    }
    for folder in [sandbox.path("drawn"), committed()] {
        for number in NUMBERS {
            let path = folder.join(format!("fig{number}.svg"));
            assert!(fs::metadata(&path).unwrap().len() < BYTES_MOST, "{}", path.display());
            let text = fs::read_to_string(&path).unwrap();
            assert!(text.starts_with("<svg ") && text.ends_with("</svg>\n"), "{}", path.display());
            assert!(text.contains(&format!("Fig. {number}: ")) && text.contains("stroke-dasharray"), "Fig. {number}");
            for element in text.split('<') {
                let count = |attribute: &str| element.matches(attribute).count();
                assert!(count(" stroke-dasharray=") <= 1 && count(" stroke-width=") <= 1, "{element}");
            }
        }
    }
}

/// Catches one figure asked for that draws others, and a number that is let through.
#[test]
fn one_figure_can_be_asked_for() {
    let sandbox = Sandbox::new();
    let printed = sandbox.run("figures --figure 26").expect(0).out;
    assert_eq!(printed, "figures/fig26.svg\nfigures/fig26.csv\n");
    assert_eq!(fs::read_dir(sandbox.path("figures")).unwrap().count(), 2);
    let done = sandbox.run("figures --figure 28 --out none").expect(1);
    assert!(done.err.contains("28") && done.err.contains("36-38") && !sandbox.path("none").exists(), "{done:?}");
}

/// Catches a command of `docs/dissertation.md` that fails.
#[test]
fn the_pages_commands_run() {
    let sandbox = Sandbox::new();
    let page = fs::read_to_string(committed().join("../dissertation.md")).unwrap();
    let quoted = page.lines().flat_map(|line| line.split('`').skip(1).step_by(2));
    let commands: BTreeSet<&str> = quoted.filter_map(|text| text.strip_prefix("tapline-lab ")).collect();
    assert!(commands.len() > 6, "{commands:?}");
    for command in commands {
        assert!(!sandbox.run(command).expect(0).out.is_empty(), "{command}");
    }
}
