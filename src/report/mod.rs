//! `tapline report`: one page per tyre and one per shift, made only from archives, to read offline and to print.

mod evidence;
mod figures;
mod pages;
mod span;

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};
use serde_json::json;
use tapline_host::atomic_file::{check_folder, write_atomically};
use tapline_host::messages::counted;
use tapline_host::stdout::Stdout;
use tapline_store::Reader;

use crate::archives::several::{cores, each};
use crate::archives::work::Work;
use crate::archives::{ArchiveFile, Archives};
use crate::cli::archives::ReportArgs;
use crate::config::Config;
use crate::config::reference::KeptReferences;
use crate::config::report::ReportConfig;
use crate::report::evidence::{Evidence, Tyre};
use crate::report::pages::shift::Shift;
use crate::report::span::Span;

/// Name of the page of the shift.
const SHIFT: &str = "shift.html";

/// Writes the pages of the archives in `args` into a folder; if none is given, it is named after the first archive.
pub(crate) fn report(args: &ReportArgs) -> Result<bool> {
    let printed = args.config.as_deref().map(|path| Config::read(path).map(|(config, _)| config.report)).transpose()?;
    printed.iter().try_for_each(ReportConfig::validate)?;
    let span = Span::new(args.from, args.to)?;
    let archives = Archives::find(&args.archives, args.results.which())?;
    let folder = args.out.clone().unwrap_or_else(|| default_folder(&args.archives[0]));
    check_folder(&folder, args.force.existing())?;
    let mut work = Work::on(&archives);
    let (mut shift, mut names, references) = (Shift::of(span), BTreeSet::new(), Mutex::default());
    let named = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    shift.unfinished = archives.unfinished.iter().map(|path| named(path)).collect();
    let pages_of =
        |(): &mut (), file: &ArchiveFile| Found::at(file, args.shift_only, printed.as_ref(), span, &references);
    let nothing = || Ok(());
    each(&archives.files, cores(), nothing, pages_of, |file, pages| {
        work.note_done(file);
        let Some(found) = work.take(file, pages)? else {
            shift.left_out.push(named(&file.path));
            return Ok(());
        };
        let Pages { reader, evidence, pages } = match found {
            Found::Pages(pages) => *pages,
            Found::OfOtherTime => {
                shift.others += 1;
                return Ok(());
            }
            Found::WithoutTime => {
                shift.timeless.push(named(&file.path));
                return Ok(());
            }
        };
        // If it cannot be in the shift it has no pages either.
        let Some(()) = work.take(file, shift.look_at(&reader, &evidence))? else {
            shift.left_out.push(named(&file.path));
            return Ok(());
        };
        for (tyre, page) in evidence.tyres.iter().zip(pages) {
            let name = page.is_some().then(|| name_for(&mut names, tyre, &file.casing()));
            if let (Some(name), Some(page)) = (&name, page) {
                work.beside(|| put(&folder, name, &page, args))?;
            }
            shift.add_page(name);
        }
        shift.add_tyres(evidence);
        Ok(())
    })?;
    let is_complete = work.end()?;
    if let Some(words) = span.words()
        && shift.is_empty()
    {
        let count = counted(shift.others, "archive", "archives");
        bail!(
            "no casing was last tapped {words}: {count} of other times, {} without a time, {} that cannot be read",
            shift.timeless.len(),
            shift.left_out.len()
        );
    }
    // Last, because it links to the others.
    let title = if archives.is_many { title_of(&args.archives) } else { String::new() };
    if let Some(page) = shift.page(title, args.shift.as_deref())? {
        put(&folder, SHIFT, &page, args)?;
    }
    Ok(is_complete)
}

/// What becomes of an archive.
enum Found {
    Pages(Box<Pages>),
    /// It was tapped last at a time that is not asked for.
    OfOtherTime,
    /// It is not known when it was tapped, and only some times are asked for.
    WithoutTime,
}

/// What an archive shows.
struct Pages {
    reader: Reader,
    evidence: Evidence,
    /// The page of each of its tyres; `None` if only that of the shift is written.
    pages: Vec<Option<String>>,
}

impl Found {
    /// Of the archive `file`, if it is of `span`, with the place and the people of `printed` if that is given.
    fn at(
        file: &ArchiveFile,
        is_shift_only: bool,
        printed: Option<&ReportConfig>,
        span: Span,
        references: &Mutex<KeptReferences>,
    ) -> Result<Self> {
        tracing::info!("reading {}", file.path.display());
        let reader = Reader::open(&file.path)?;
        match span.has(&reader)? {
            Some(true) => {}
            Some(false) => return Ok(Self::OfOtherTime),
            None => return Ok(Self::WithoutTime),
        }
        let reference = references.lock().unwrap_or_else(PoisonError::into_inner).of(&reader);
        let mut evidence = Evidence::read(&reader, reference.unwrap_or_default())?;
        if let Some(printed) = printed {
            evidence.config.report.clone_from(printed);
        }
        evidence.config.report.validate()?;
        let page = |tyre| (!is_shift_only).then(|| pages::tyre::page(&reader, &evidence, tyre)).transpose();
        let pages = evidence.tyres.iter().map(page).collect::<Result<_>>()?;
        Ok(Self::Pages(Box::new(Pages { reader, evidence, pages })))
    }
}

/// Title of the page of a shift with many archives.
fn title_of(paths: &[PathBuf]) -> String {
    let name = |path: &PathBuf| {
        let whole = std::path::absolute(path).unwrap_or_else(|_| path.clone());
        whole.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
    };
    match paths {
        [path] => name(path),
        [first, rest @ ..] => format!("{} and {} more", name(first), rest.len()),
        [] => String::new(),
    }
}

/// Writes a page and prints its path.
fn put(folder: &Path, name: &str, page: &str, args: &ReportArgs) -> Result<()> {
    let path = folder.join(name);
    write_atomically(&path, args.force.existing(), |mut file| file.write_all(page.as_bytes()))?;
    let path = path.display().to_string();
    writeln!(Stdout, "{}", if args.json { json!({ "page": path }).to_string() } else { path })?;
    Ok(())
}

fn default_folder(first: &Path) -> PathBuf {
    let whole = std::path::absolute(first).unwrap_or_else(|_| first.to_owned());
    let name = if whole.is_dir() { whole.file_name() } else { whole.file_stem() };
    PathBuf::from(format!("{}-report", name.unwrap_or_default().to_string_lossy()))
}

/// File name of a tyre's page: the serial, or the archive's name if that has a number after the serial. Characters
/// not allowed in file names or addresses are replaced; a number is added if it could be mistaken for one in `taken`.
fn name_for(taken: &mut BTreeSet<String>, tyre: &Tyre, archive: &str) -> String {
    let serial = tyre.serial.as_str();
    let is_numbered = archive.strip_prefix(serial).is_some_and(|number| number.starts_with('.'));
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name = if is_numbered { archive } else { serial };
    let stem = format!("tyre-{}", name.chars().map(plain).collect::<String>());
    let numbered = (2..).map(|number: u32| format!("{stem}-{number}"));
    let free = std::iter::once(stem.clone()).chain(numbered).find(|name| taken.insert(name.to_lowercase()));
    format!("{}.html", free.unwrap_or(stem))
}

#[cfg(test)]
mod tests {
    use tapline_wire::Serial;

    use super::*;

    /// Catches a page that overwrites another, or is in another folder.
    #[test]
    fn every_tyre_has_a_file_of_its_own() {
        let tyre = |serial: &str| Tyre { serial: Serial::new(serial).unwrap(), shoulders: Vec::new(), condition: None };
        let tyres = ["A 1", "A_1", "a<1", "..\\x", "A_1-2"].map(tyre);
        let mut taken = BTreeSet::new();
        assert_eq!(
            tyres.iter().map(|tyre| name_for(&mut taken, tyre, "A 1")).collect::<Vec<_>>(),
            ["tyre-A_1.html", "tyre-A_1-2.html", "tyre-a_1-3.html", "tyre-.._x.html", "tyre-A_1-2-2.html"]
        );
        // The second scan of a casing, whose archive comes first.
        assert_eq!(
            ["B.2", "B"].map(|archive| name_for(&mut taken, &tyre("B"), archive)),
            ["tyre-B.2.html", "tyre-B.html"]
        );
    }
}
