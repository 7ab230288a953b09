//! `tapline-lab experiment`: chapter 5 of the dissertation repeated on three simulated tyres.

mod claims;
mod dataset;
mod figures;
mod index;
mod spectrum;
mod tyres;

use std::path::Path;

use anyhow::{Context as _, Result};
use tapline_wire::Discriminator;

use self::dataset::Experiment;
use crate::written::WrittenArgs;

/// The dissertation's discriminators.
const SEVEN: [Discriminator; 7] = {
    use Discriminator::{A1, A2, Ef, FMax, Pf, Pr, Tau};
    [FMax, Tau, A1, A2, Pr, Pf, Ef]
};

/// Writes the figures, their tables and the claims into the folder `out`, and the page beside it.
///
/// # Errors
/// A folder without a name, a computation that fails, or an error of the file system.
pub fn experiment(out: &Path, seed: u64, written: WrittenArgs) -> Result<()> {
    let name = out.file_name().and_then(|name| name.to_str());
    let folder = name.with_context(|| format!("--out is {}; it must end with the name of a folder", out.display()))?;
    written.check(&out.with_added_extension("md"))?;
    let experiment = Experiment::take(seed)?;
    let figures = figures::figures(&experiment)?;
    let claims = claims::claims(&experiment)?;
    let mut files = Vec::new();
    for figure in &figures {
        files.push((out.join(format!("{}.svg", figure.table.name)), figure.picture.svg()?));
        files.push((out.join(format!("{}.csv", figure.table.name)), figure.table.csv()?));
    }
    files.push((out.join("claims.csv"), claims::csv(&claims)?));
    let titles: Vec<(&str, &str)> =
        figures.iter().map(|figure| (figure.table.name, figure.picture.title.as_str())).collect();
    files.push((out.with_added_extension("md"), claims::page(&claims, seed, &titles, folder)));
    written.write(&files)
}
