//! Writes `docs/performance.md`: one table of the benches' measurements, with the machine.

use std::fmt::Write as _;
use std::fs;

use anyhow::Result;
use tapline_bench::{Beside, Row, Sheet, root};
use tapline_lab::chart::provenance::{Provenance, output};

/// The benches, in the order of the page.
const BENCHES: [&str; 4] = ["kernels", "line", "hop", "archive"];

fn main() -> Result<()> {
    // The commit is that of this tree, wherever the program is called.
    std::env::set_current_dir(root())?;
    let sheets: Vec<Sheet> = BENCHES.into_iter().map(Sheet::kept).collect::<Result<_>>()?;
    fs::write(root().join("docs/performance.md"), page(&sheets)?)?;
    Ok(())
}

fn page(sheets: &[Sheet]) -> Result<String> {
    let mut page = String::from(
        "# Performance\n\nWhat each part of tapline costs, beside yardsticks. `make bench` measures it and writes this page. Each yardstick takes turns with what it is compared with. A value is the \
         median over rounds, with the quartiles in brackets. For kernels the fastest turn of each round counts. Compare times of one run \
         with each other, not with those of another: the machine is shared.\n\n",
    );
    // Seed and effort are only of charts: those of a bench are in its notes.
    let from = Provenance::here(0, false);
    let [cpu, vectors, system, commit, date] =
        ["cpu", "vectors", "system", "commit", "date"].map(|column| from.get(column));
    let compiler = output("rustc", &["--version"]).unwrap_or_else(|| "unknown compiler".to_owned());
    writeln!(page, "Measured on {date} after commit {commit}, on {cpu} ({vectors}), {system}; {compiler}.\n")?;
    page.push_str("| what | value | | compared with | aim |\n|---|--:|---|---|---|\n");
    for Sheet { title, rows, .. } in sheets {
        writeln!(page, "| **{title}** | | | | |")?;
        for row in rows {
            page.push_str(&lines(row));
        }
    }
    for Sheet { title, command, notes, .. } in sheets {
        writeln!(page, "\n## {title}\n\n`{command}`\n")?;
        for note in notes {
            writeln!(page, "- {note}")?;
        }
    }
    Ok(page)
}

/// A row, and a line for each further comparison.
fn lines(row: &Row) -> String {
    let Row { what, unit, value, beside } = row;
    let cells = |beside: &Beside| format!("{} {} | {}", beside.ratio, beside.what, beside.aim_text());
    let mut rest = beside.iter().map(cells);
    let first = rest.next().unwrap_or_else(|| " | ".to_owned());
    let begin = format!("| {what} | {value} | {unit} | {first} |\n");
    rest.fold(begin, |lines, cells| lines + &format!("| | | | {cells} |\n"))
}
