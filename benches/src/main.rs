//! Writes `docs/performance.md`: one table of what the benches have measured, with the machine.

use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use anyhow::Result;
use tapline_bench::{Beside, Row, Sheet, Spread, root};

/// The benches, in the order of the page.
const BENCHES: [&str; 4] = ["kernels", "line", "hop", "archive"];

fn main() -> Result<()> {
    let sheets: Vec<Sheet> = BENCHES.into_iter().map(Sheet::kept).collect::<Result<_>>()?;
    fs::write(root().join("docs/performance.md"), page(&sheets)?)?;
    Ok(())
}

fn page(sheets: &[Sheet]) -> Result<String> {
    let mut page = String::from(
        "# Performance\n\n`make bench` measures all of this and writes this page. Each yardstick takes turns with what it is compared with. A value is the \
         median over rounds, with the quartiles in brackets. Times of one run may be compared with each \
         other, not with those of another: the machine is shared, and other work only ever slows down.\n\n",
    );
    let date = jiff::Zoned::now().strftime("%Y-%m-%d").to_string();
    let commit = printed("git", &["rev-parse", "--short", "HEAD"]);
    writeln!(
        page,
        "Measured on {date} after commit {commit}, on {}; {}.\n",
        machine(),
        printed("rustc", &["--version"])
    )?;
    page.push_str("| what | value | | beside | aim |\n|---|--:|---|---|---|\n");
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
    let cells = |beside: &Beside| format!("{} {} | {}", text(&beside.ratio), beside.what, beside.aim);
    let mut rest = beside.iter().map(cells);
    let first = rest.next().unwrap_or_else(|| " | ".to_owned());
    let begin = format!("| {what} | {} | {unit} | {first} |\n", text(value));
    rest.fold(begin, |lines, cells| lines + &format!("| | | | {cells} |\n"))
}

fn text(of: &Spread) -> String {
    let Spread { median, low, high } = *of;
    let digits = match median.abs() {
        size if size < 0.095 => 3,
        size if size < 9.95 => 2,
        size if size < 99.5 => 1,
        _ => 0,
    };
    format!("{median:.digits$} ({low:.digits$}–{high:.digits$})")
}

/// Processor, cores and system.
fn machine() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let value = |key: &str| {
        let line = info.lines().find(|line| line.starts_with(key))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let system = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let vectors = value("flags").is_some_and(|flags| flags.split(' ').any(|flag| flag == "avx512f"));
    let name = value("model name").unwrap_or_else(|| "an unknown processor".to_owned());
    let vectors = if vectors { "with AVX-512" } else { "without AVX-512" };
    format!("{cores} cores of {name} ({vectors}), Linux {}", system.trim())
}

/// The first line that a command prints.
fn printed(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).current_dir(root()).output();
    let text = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
    text.lines().next().unwrap_or_default().to_owned()
}
