//! `tapline report`: one page a tyre and one a shift, from the archive alone, to be read offline and printed.

mod boxes;
mod bscan;
mod chart;
mod colour;
mod condition;
mod evidence;
mod inline;
mod marks;
mod offsets;
mod page;
mod polar;
mod rounds;
mod samples;
mod scale;
mod shift;
mod small;
mod spectra;
mod strip;
mod taps;
mod ticked;
mod tyre;
mod words;

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use tapline_store::Reader;

use self::evidence::{Evidence, Tyre};
use crate::whole::whole_file;

/// Name of the page of the shift.
const SHIFT: &str = "shift.html";

/// Writes the pages of `archive` into the folder `out`, or into one named after the archive.
pub(crate) fn report(archive: &Path, out: Option<&Path>) -> Result<bool> {
    let reader = Reader::open(archive)?;
    let evidence = Evidence::of(&reader)?;
    let folder = out.map_or_else(|| default_folder(archive), Path::to_owned);
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut told = io::stdout().lock();
    let mut put = |name: &str, page: &str| -> Result<()> {
        let path = folder.join(name);
        whole_file(&path, |mut file| file.write_all(page.as_bytes()))?;
        writeln!(told, "{}", path.display())?;
        Ok(())
    };
    let names = names(&evidence.tyres);
    for (tyre, name) in evidence.tyres.iter().zip(&names) {
        put(name, &tyre::page(&reader, &evidence, tyre)?)?;
    }
    // Last, as it names the others.
    put(SHIFT, &shift::page(&reader, &evidence, &names)?)?;
    Ok(!reader.is_torn())
}

fn default_folder(archive: &Path) -> PathBuf {
    PathBuf::from(format!("{}-report", archive.file_stem().unwrap_or_default().to_string_lossy()))
}

/// The file of each tyre's page: its serial with what a file name or an address may not hold replaced, and numbered
/// where two would be the same on some file system.
fn names(tyres: &[Tyre]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let name = |tyre: &Tyre| {
        let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
        let stem = format!("tyre-{}", tyre.serial.as_str().chars().map(plain).collect::<String>());
        let numbered = (2..).map(|number: u32| format!("{stem}-{number}"));
        let free = std::iter::once(stem.clone()).chain(numbered).find(|name| taken.insert(name.to_lowercase()));
        format!("{}.html", free.unwrap_or(stem))
    };
    tyres.iter().map(name).collect()
}

#[cfg(test)]
mod tests {
    use tapline_wire::Serial;

    use super::*;

    /// Catches a page that overwrites another's, or lies in another folder.
    #[test]
    fn every_tyre_has_a_file_of_its_own() {
        let tyre = |serial: &str| Tyre { serial: Serial::new(serial).unwrap(), shoulders: Vec::new(), condition: None };
        let tyres = ["A 1", "A_1", "a<1", "..\\x", "A_1-2"].map(tyre);
        assert_eq!(
            names(&tyres),
            ["tyre-A_1.html", "tyre-A_1-2.html", "tyre-a_1-3.html", "tyre-.._x.html", "tyre-A_1-2-2.html"]
        );
    }
}
