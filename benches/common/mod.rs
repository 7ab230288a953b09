//! Order statistics and a plain table, for all benches.

/// Value below which the fraction `q` of `values` lies, NaN if there are none; sorts them.
pub(crate) fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a place in the list, q being 0 to 1"
    )]
    let place = (q * last as f64).round() as usize;
    values.get(place).copied().unwrap_or(f64::NAN)
}

/// Prints `rows` under `head`, the first column left-aligned and numbers right-aligned.
pub(crate) fn print_table<const N: usize>(title: &str, head: [&str; N], rows: &[[String; N]]) {
    let cells_of = |k: usize| std::iter::once(head[k].len()).chain(rows.iter().map(move |row| row[k].chars().count()));
    let widths: [usize; N] = std::array::from_fn(|k| cells_of(k).fold(0, |most, n| if n > most { n } else { most }));
    println!("\n{title}");
    let line = |cells: &[String; N]| {
        let padded = cells.iter().zip(widths).enumerate();
        padded.map(|(k, (cell, w))| if k == 0 { format!("{cell:<w$}") } else { format!("  {cell:>w$}") }).collect()
    };
    for row in std::iter::once(&head.map(str::to_owned)).chain(rows) {
        let text: String = line(row);
        println!("  {text}");
    }
}
