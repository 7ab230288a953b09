//! Measures bias and spread of every estimator on taps whose truth is known, and writes the table.
//!
//! `cargo run --release --example estimators` writes `docs/estimators.csv` and `docs/estimators.md`: the same bytes each
//! time on processors with the same vector instructions. `tests/estimators.rs` measures a part of it again.

mod study;

use std::path::Path;

use anyhow::{Context as _, Result};

fn main() -> Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let rows = study::measure(|_| true)?;
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    };
    write("estimators.csv", study::csv(&rows)?)?;
    write("estimators.md", study::markdown(&rows))
}
