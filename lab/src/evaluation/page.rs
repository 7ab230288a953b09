//! Tables as text or JSON on the terminal, and as a page with their figures.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::{Map, Value};
use tapline_host::stdout::Stdout;

use crate::evaluation::{Picture, Table};

/// Prints `tables`: as one JSON object of all, or as text without the long ones.
pub(crate) fn print_tables(tables: &[Table], as_json: bool) -> Result<()> {
    let mut out = Stdout;
    if as_json {
        let each = tables.iter().map(|table| (table.name.to_owned(), table.json()));
        writeln!(out, "{}", Value::Object(each.collect::<Map<_, _>>()))?;
    } else {
        for table in tables.iter().filter(|table| !table.is_long) {
            writeln!(out, "{}", table.text())?;
        }
    }
    Ok(())
}

/// The files of `tables` and `pictures` in `folder`.
pub(crate) fn files_of(tables: &[Table], pictures: &[Picture], folder: &Path) -> Result<Vec<(PathBuf, String)>> {
    let tables = tables.iter().map(|table| Ok((folder.join(format!("{}.csv", table.name)), table.csv()?)));
    let pictures = pictures.iter().map(|picture| Ok((folder.join(format!("{}.svg", picture.name)), picture.svg()?)));
    tables.chain(pictures).collect()
}

/// A page: `head`, the findings in short, and the tables under their `heading`s with the pictures that belong to them. Files are
/// in `folder`, which is empty or ends with a slash.
pub(crate) fn page_of(
    head: &str,
    conclusions: &[String],
    (tables, pictures): (&[Table], &[Picture]),
    heading: impl Fn(&str) -> &'static str,
    folder: &str,
) -> String {
    let mut page = format!("{head}\n## In short\n\n");
    for line in conclusions {
        page.push_str(&format!("- {line}\n"));
    }
    page.push('\n');
    for table in tables.iter().filter(|table| !table.is_long) {
        page.push_str(&format!("## {}\n\n{}\n", heading(table.name), table.title));
        page.push_str(&format!("([{0}.csv]({folder}{0}.csv))\n\n{1}\n", table.name, table.markdown()));
        for picture in pictures.iter().filter(|picture| picture.beside == table.name) {
            page.push_str(&format!("![{}]({folder}{}.svg)\n\n", picture.title, picture.name));
        }
    }
    let link = |table: &Table| format!("[{0}.csv]({folder}{0}.csv)", table.name);
    let long: Vec<String> = tables.iter().filter(|table| table.is_long).map(link).collect();
    page.push_str(&format!("Longer tables: {}.\n", long.join(", ")));
    page
}
