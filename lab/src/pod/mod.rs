//! `tapline-lab pod`: probability of detection, ROC, false calls and gauge studies from the archives of casings that a plant has
//! scanned, compared with what other means found.
//!
//! A number that the data cannot support is not printed; a remark says which and why.

mod agreement;
mod archives;
mod basis;
mod calls;
mod cracks;
mod inspected;
mod page;
mod pictures;
mod repeats;
mod roc;
mod scatter;
mod truth;

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow};
use tapline_host::arguments::ForceArgs;
use tapline_host::atomic_file::{Existing, check_folder, write_texts};
use tapline_host::messages::{print_line, say};

use self::agreement::Agreement;
use self::archives::Scans;
use self::calls::CallRate;
use self::repeats::Repeated;
use self::roc::Roc;
use self::scatter::Scatter;
use self::truth::KnownTruth;
use crate::evaluation::{Detection, Table, files_of, print_tables};

/// Options of `pod`.
#[derive(Debug, clap::Args)]
pub struct PodArgs {
    /// Folders with finished archives, also in subfolders.
    #[arg(required = true, value_name = "FOLDER")]
    pub folders: Vec<PathBuf>,
    /// What other means found: a CSV file with the columns tyre, shoulder, first_location, location_count and, where it is
    /// known, size_mm; a row with location_count 0 states that a shoulder was inspected and is sound. A column scanned_on has the
    /// days from which on rows hold. If left out, the truth in the archives (simulated tyres, tap sets with truth) is used.
    #[arg(long)]
    pub truth: Option<PathBuf>,
    /// Use each casing's newest `tapline reprocess` results instead of its archive.
    #[arg(long)]
    pub results: bool,
    /// Seed of the intervals' random numbers.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print the tables as JSON.
    #[arg(long)]
    pub json: bool,
    /// Folder to write tables (CSV), figures (SVG) and `page.md` into; created if it does not exist.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Whether existing files are replaced.
    #[command(flatten)]
    pub force: ForceArgs,
}

#[derive(Debug)]
struct Findings {
    detections: Vec<Detection>,
    rocs: [Roc; 2],
    calls: Vec<CallRate>,
    repeated: Vec<Repeated>,
    agreements: Vec<Agreement>,
    scatter: Scatter,
    tables: Vec<Table>,
}

/// Reads archives and truth, prints tables, and writes them with figures and a page if asked for. Returns whether every archive
/// could be read.
///
/// # Errors
/// A truth that contradicts itself or the archives; without a truth, archives that contradict each other; no archive that can be
/// read; or an error of the file system.
pub fn pod(args: &PodArgs) -> Result<bool> {
    if let Some(folder) = &args.out {
        check_folder(folder, args.force.existing())?;
    }
    let mut scans = Scans::read(&args.folders, args.results)?;
    scans.remarks.iter().for_each(|remark| say(&format!("tapline-lab: {remark}")));
    scans.unreadable.iter().for_each(|why| print_line(&format!("tapline-lab: {why}")));
    let truth = match &args.truth {
        Some(file) => {
            let mut truth = KnownTruth::read(file)?;
            scans.split(&truth);
            let scanned = scans.extents();
            if !truth.ignored.is_empty() {
                say(&format!("{}: unknown columns are ignored: {}", file.display(), truth.ignored.join(", ")));
            }
            truth.leave_out(&scanned, |shoulder| scans.may_be_left_out(shoulder));
            truth.check(&scanned).map_err(|error| anyhow!("{} {error:#}", file.display()))?;
            if !truth.not_scanned.is_empty() {
                let names = basis::names(&truth.not_scanned);
                let why = "they are in none of the archives that were read";
                say(&format!("{}: rows of {names} are left out: {why}", file.display()));
            }
            if let Some(why) = &scans.contradiction {
                say(&format!(
                    "{why}; --truth replaces what archives know of cracks, and both count as scans of one shoulder unless its \
                     scanned_on tells them apart"
                ));
            }
            truth
        }
        None => {
            scans.contradiction.as_ref().map_or(Ok(()), |why| Err(anyhow!("{why}")))?;
            scans.truth()
        }
    };
    let found = Findings::compute(&scans, &truth, args);
    print_tables(&found.tables, args.json)?;
    if let Some(folder) = &args.out {
        found.write(folder, args.force.existing())?;
    }
    Ok(scans.unreadable.is_empty())
}

impl Findings {
    fn compute(scans: &Scans, truth: &KnownTruth, args: &PodArgs) -> Self {
        let inspected = inspected::inspected(scans, truth);
        let detections = cracks::detections(&inspected);
        let rocs = roc::rocs(&inspected, args.seed);
        let calls = calls::calls(&inspected);
        let repeated = repeats::repeated(scans);
        let (agreements, scatter) = (agreement::agreements(scans), scatter::scatter(scans));
        let tables = vec![
            basis::table(scans, truth, &inspected, args),
            cracks::table(&detections),
            roc::table(&rocs),
            calls::table(&calls),
            repeats::table(&repeated),
            agreement::table(&agreements),
            scatter::table(&scatter),
            cracks::all(&inspected),
            inspected::table(&inspected),
        ];
        Self { detections, rocs, calls, repeated, agreements, scatter, tables }
    }

    fn write(&self, folder: &Path, existing: Existing) -> Result<()> {
        let pictures = pictures::pictures(self);
        let mut files = files_of(&self.tables, &pictures, folder)?;
        files.push((folder.join("page.md"), page::page(self, &pictures)));
        Ok(write_texts(&files, existing)?)
    }
}
