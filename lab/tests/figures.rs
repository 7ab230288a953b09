//! `tapline-lab figures`: the committed figures are those that the program draws.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use tapline_testing::documents::{docs, text};

use crate::sandbox::{Sandbox, columns, difference, files};

const NUMBERS: [u8; 19] = [11, 12, 13, 16, 17, 18, 19, 20, 22, 23, 24, 25, 26, 27, 31, 32, 36, 37, 38];

/// Catches committed figures that went stale, by more than rounding; one that is not written, and one without a file. And a picture that
/// is no XML (an attribute twice), is too large to keep, or does not say what it shows.
#[test]
fn committed_figures_are_up_to_date() {
    const BYTES_MOST: usize = 60_000;
    /// Of 3600 in the width of a picture.
    const PLACES_MOST: f64 = 1.0;
    let sandbox = Sandbox::new();
    let printed = sandbox.run("figures --out drawn").expect(0).out;
    assert_eq!(printed.lines().count(), 2 * NUMBERS.len(), "{printed}");
    let made = columns(&files(&sandbox.path("drawn")));
    if let Some(difference) = difference(include_str!("figures.csv"), &made, |number| 1e-6 * number.abs()) {
        panic!("{difference}: these are the columns now:\n{made}");
    }
    // Only the pictures are kept, not their tables.
    let pictures = |folder: &Path| -> BTreeMap<String, String> {
        files(folder).into_iter().filter(|(name, _)| name.ends_with(".svg")).collect()
    };
    let (kept, drawn) = (pictures(&docs("figures")), pictures(&sandbox.path("drawn")));
    assert_eq!(kept.keys().collect::<Vec<_>>(), drawn.keys().collect::<Vec<_>>());
    for number in NUMBERS {
        let name = format!("fig{number}.svg");
        let text = &drawn[&name];
        // What is written is the same, and what is drawn is where it was.
        let words = |text: &str, is_drawn: bool| {
            text.lines().filter(|line| line.starts_with('<') == is_drawn).collect::<Vec<_>>().join("\n")
        };
        assert_eq!(words(&kept[&name], false), words(text, false), "{name}");
        if let Some(difference) = difference(&words(&kept[&name], true), &words(text, true), |_| PLACES_MOST) {
            panic!("{name}: {difference}: run `tapline-lab figures --out docs/figures --force`");
        }
        assert!(text.len() < BYTES_MOST && text.starts_with("<svg ") && text.ends_with("</svg>\n"), "{name}");
        assert!(text.contains(&format!("Fig. {number}: ")) && text.contains("stroke-dasharray"), "{name}");
        for element in text.split('<') {
            let count = |attribute: &str| element.matches(attribute).count();
            assert!(count(" stroke-dasharray=") <= 1 && count(" stroke-width=") <= 1, "{element}");
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
    let page = text(&docs("dissertation.md"));
    let quoted = page.lines().flat_map(|line| line.split('`').skip(1).step_by(2));
    let commands: BTreeSet<&str> = quoted.filter_map(|text| text.strip_prefix("tapline-lab ")).collect();
    assert!(commands.len() > 6, "{commands:?}");
    for command in commands {
        assert!(!sandbox.run(command).expect(0).out.is_empty(), "{command}");
    }
}
