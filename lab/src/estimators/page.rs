//! The table as a page.

use super::Row;

/// The page above its tables, with conclusions from them.
const HEAD: &str = include_str!("head.md");

/// A table of the page: the table and quantity whose rows it shows, and its heading.
const TABLES: [(&str, &str, &str); 9] = [
    ("force", "f_max", "## F_max"),
    ("force", "tau_s", "## tau, relative to the contact time"),
    ("clip", "f_max", "## F_max of a clipped force"),
    ("clip", "tau_s", "## tau of a clipped force, from the width at 10 % of that F_max"),
    ("droop", "f_max", "## F_max after an AC coupling"),
    ("droop", "tau_s", "## tau after an AC coupling"),
    ("sound", "pr", "## PR"),
    ("sound", "p_f", "## P_f"),
    ("sound", "e_f", "## E_f"),
];

/// The page of `rows`: a line per cell, a column per estimator, bias and spread in % of the truth.
pub(crate) fn markdown(rows: &[Row]) -> String {
    let mut page = HEAD.to_owned();
    for (table, quantity, title) in TABLES {
        let shown: Vec<&Row> = rows.iter().filter(|row| row.table == table && row.quantity == quantity).collect();
        page.push_str(&section(title, &shown));
    }
    page
}

fn section(title: &str, rows: &[&Row]) -> String {
    let mut estimators: Vec<&str> = Vec::new();
    for row in rows {
        if !estimators.contains(&row.estimator.as_str()) {
            estimators.push(&row.estimator);
        }
    }
    let mut text =
        format!("\n{title}\n\n| tap | {} |\n|---|{}\n", estimators.join(" | "), "---|".repeat(estimators.len()));
    for line in rows.chunks(estimators.len().max(1)) {
        let cells: Vec<String> = line.iter().map(|row| shown(row)).collect();
        text.push_str(&format!("| {} | {} |\n", name(line[0]), cells.join(" | ")));
    }
    text
}

fn name(row: &Row) -> String {
    let snr = row.snr_db.map_or_else(|| "no noise".to_owned(), |db| format!("{db} dB"));
    let fault = if row.fault.is_empty() { String::new() } else { format!(", {}", row.fault) };
    format!("{}, {} kHz, {snr}{fault}", row.signal, (f64::from(row.rate_hz) / 1e3).round())
}

fn shown(row: &Row) -> String {
    if row.absent_percent >= 100.0 {
        return "absent".to_owned();
    }
    let absent =
        if row.absent_percent > 0.0 { format!(" ({:.0} % absent)", row.absent_percent) } else { String::new() };
    format!("{} ± {}{absent}", digits(row.bias_percent, true), digits(row.spread_percent, false))
}

/// Two decimals for small values, none for large ones.
fn digits(percent: f64, has_sign: bool) -> String {
    let places = match percent.abs() {
        ..0.9995 => 2,
        ..9.995 => 1,
        _ => 0,
    };
    let text = if has_sign { format!("{percent:+.places$}") } else { format!("{percent:.places$}") };
    if text.trim_start_matches(['+', '-']).chars().all(|c| c == '0' || c == '.') {
        return text.trim_start_matches(['+', '-']).to_owned();
    }
    text
}
