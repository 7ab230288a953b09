//! `tapline-lab experiment`: the committed page, figures and tables are those that the program writes.

use std::collections::{BTreeMap, BTreeSet};

use crate::sandbox::{Sandbox, columns, difference, files};
use tapline_testing::documents::{csv_rows, docs, text};

const FIGURES: [&str; 10] =
    ["fig60", "fig61", "fig62", "fig63-64", "fig66-67", "fig68", "fig69", "fig70-71", "fig73-75", "fig76"];

/// Catches a committed page or list of claims that went stale, and a figure without a file.
///
/// Numbers are written to three digits; transforms differ in their last from machine to machine.
#[test]
fn what_is_committed_is_what_the_program_finds() {
    let sandbox = Sandbox::new();
    let printed = sandbox.run("experiment --out experiment").expect(0).out;
    let (kept, made) = (files(&docs("experiment")), files(&sandbox.path("experiment")));
    // The tables of the pictures are not kept.
    let is_kept = |name: &&String| !name.starts_with("fig") || name.ends_with(".svg");
    let names = |files: &BTreeMap<String, String>| files.keys().filter(is_kept).cloned().collect::<Vec<_>>();
    assert_eq!(names(&kept), names(&made));
    assert_eq!((printed.lines().count(), made.len()), (2 * FIGURES.len() + 2, 2 * FIGURES.len() + 2));
    let columns = columns(&made);
    let rough = |of: &str| of.lines().filter(|line| line.starts_with("fig76")).collect::<Vec<_>>().join("\n");
    let exact = |of: &str| of.lines().filter(|line| !line.starts_with("fig76")).collect::<Vec<_>>().join("\n");
    let kept_columns = include_str!("experiment.csv");
    let differs = difference(&exact(kept_columns), &exact(&columns), |number| 1e-6 * number.abs()).or(difference(
        &rough(kept_columns),
        &rough(&columns),
        |number| 0.011 * number.abs(),
    ));
    if let Some(difference) = differs {
        panic!("{difference}: these are the columns now:\n{columns}");
    }
    for name in ["claims.csv", "experiment.md"] {
        if let Some(difference) = difference(&kept[name], &made[name], |number| 0.011 * number.abs()) {
            panic!("{name}: {difference}: run `tapline-lab experiment --out docs/experiment --force`");
        }
    }
}

/// Catches a regression that was written onto the page: what the index must find on the simulated tyres, and how well.
#[test]
fn the_index_finds_the_planted_cracks() {
    const AUC_MIN: [(&str, f64); 3] =
        [("index-follows-damage", 0.99), ("slight-tyre-found", 0.97), ("one-normalisation", 0.97)];
    const MUST_AGREE: [&str; 9] = [
        "force", "contact-time", "severity-force", "severity-sound", "boxes-apart", "new-tyre-zero",
        "slight-tyre-other-shoulder", "second-shoulder-calm", "b-scan",
    ];
    let sandbox = Sandbox::new();
    sandbox.run("experiment --seed 11 --out experiment").expect(0);
    let claims = csv_rows(&text(&sandbox.path("experiment/claims.csv")));
    let claim = |id: &str| claims.iter().find(|claim| claim["claim"] == id).unwrap_or_else(|| panic!("no {id}"));
    for (id, auc_min) in AUC_MIN {
        let ours = &claim(id)["ours"];
        let auc: f64 = ours.split(';').next().unwrap().parse().unwrap();
        assert!(auc >= auc_min && claim(id)["agrees"] == "yes", "{id}: {ours}");
    }
    for id in MUST_AGREE {
        assert_eq!(claim(id)["agrees"], "yes", "{id}: {}", claim(id)["ours"]);
    }
}

/// Catches a verdict that depends on chance without the page saying so, a claim twice, bytes that depend on more than the seed, and a file that
/// does not depend on it.
#[test]
fn verdicts_hang_on_the_seed_only_where_the_page_says_so() {
    const BY_CHANCE: [&str; 4] =
        ["e_f-repeats-better-than-p_f", "force-fluctuates", "sound-tells-better", "repeats-small"];
    let page = text(&docs("experiment.md"));
    assert!(BY_CHANCE.iter().all(|name| page.matches(&format!("`{name}`")).count() == 2));
    let sandbox = Sandbox::new();
    let verdicts = |table: &str| -> Vec<(String, String)> {
        let printed = csv_rows(table).into_iter().map(|row| (row["claim"].clone(), row["agrees"].clone()));
        printed.filter(|(name, _)| !BY_CHANCE.contains(&name.as_str())).collect()
    };
    let kept = verdicts(&text(&docs("experiment/claims.csv")));
    let names: BTreeSet<&String> = kept.iter().map(|(name, _)| name).collect();
    assert!(names.len() == kept.len() && kept.len() > 30, "{kept:?}");
    let made = |seed: u32, folder: &str| {
        sandbox.run(&format!("experiment --seed {seed} --out {folder}/it")).expect(0);
        files(&sandbox.path(folder).join("it"))
    };
    let [second, third, ..] = [2, 3, 4, 5].map(|seed| {
        let made = made(seed, &format!("seed-{seed}"));
        assert_eq!(verdicts(&made["claims.csv"]), kept, "seed {seed}");
        made
    });
    assert!(made(2, "again") == second);
    let same: Vec<&String> = second.keys().filter(|name| second[*name] == third[*name]).collect();
    assert!(same.is_empty(), "{same:?}");
}

/// Catches a picture that is no XML, does not say what it shows, or is too large to keep.
#[test]
fn pictures_are_small_and_whole() {
    for (name, text) in files(&docs("experiment")) {
        if let Some(name) = name.strip_suffix(".svg") {
            assert!(FIGURES.contains(&name), "{name}");
            assert!(text.starts_with("<svg ") && text.ends_with("</svg>\n"), "{name}");
            let number = name.trim_start_matches("fig").split('-').next().unwrap();
            assert!(text.contains(&format!("Fig. {number}")) || text.contains(&format!("Figs. {number}")), "{name}");
            assert!(!text.contains("NaN") && !text.contains("inf") && text.len() < 200_000, "{name}");
        }
    }
}

/// Catches a folder without a name, beside which no page can stand.
#[test]
fn a_folder_without_a_name_is_refused() {
    let sandbox = Sandbox::new();
    let done = sandbox.run("experiment --out ..").expect(1);
    assert!(done.err.contains("--out is ..; it must end with the name of a folder"), "{done:?}");
}
