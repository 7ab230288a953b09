//! `tapline-lab study`: a seeded Monte Carlo over simulated tyres, which compares indices and references.

mod candidates;
mod detection;
mod false_calls;
mod gauge;
mod judge;
mod page;
mod parallel;
mod pictures;
mod published;
mod readings;
mod sets;
mod size;
mod summary;

pub(crate) use self::readings::by_readings;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use rayon::ThreadPoolBuilder;
use tapline_host::arguments::ForceArgs;
use tapline_host::atomic_file::{Existing, check_folder, check_writable, write_texts};
use tapline_host::messages::say;

use self::candidates::{Candidate, SingleDiscriminator, Split};
use self::false_calls::FalseCalls;
use self::gauge::GaugeResult;
use self::size::Size;
use self::summary::OfSet;
use crate::evaluation::{Detection, Table, files_of, print_tables};

/// Options of a study.
#[derive(Debug, clap::Args)]
pub struct StudyArgs {
    /// Tyres of each simulated set, of which half are the reference and half are judged; 16, or 8 with --quick, when left out.
    #[arg(long)]
    pub tyres: Option<usize>,
    /// Seed of all random numbers; the same seed gives the same bytes on processors with the same vector
    /// instructions.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Threads; one for every core when left out. They change no result.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Do a little of everything, to see that it works.
    #[arg(long)]
    pub quick: bool,
    /// Print the tables as JSON.
    #[arg(long)]
    pub json: bool,
    /// Folder to write tables (CSV) and figures (SVG) into, with a page beside it; created if it does not exist.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Whether existing files are replaced.
    #[command(flatten)]
    pub force: ForceArgs,
}

/// Tyres of a set when nothing else is asked for.
const TYRES: usize = 16;
const TYRES_QUICK: usize = 8;
/// Most tyres of a set: some days of work.
const TYRES_MAX: usize = 10_000;

/// Steps of a study that only use the first set: detection, false calls, gauge.
const PARTS_OF_ONE_SET: usize = 3;

#[derive(Debug)]
struct Findings {
    sets: Vec<&'static str>,
    candidates: Vec<Candidate>,
    alone: Vec<SingleDiscriminator>,
    detection: Vec<Detection>,
    calls: Vec<FalseCalls>,
    gauge: Vec<GaugeResult>,
    of_sets: Vec<OfSet>,
    tables: Vec<Table>,
}

/// Does the study, prints its tables, and writes them with figures and a page if asked for.
///
/// # Errors
/// Too few tyres, threads that cannot be started, a computation that fails, or an error of the file system.
pub fn study(args: &StudyArgs) -> Result<()> {
    let tyres = args.tyres.unwrap_or(if args.quick { TYRES_QUICK } else { TYRES });
    ensure!(
        (8..=TYRES_MAX).contains(&tyres),
        "--tyres is {tyres}; it must be from 8 (two sound and two cracked ones are then judged) to {TYRES_MAX}"
    );
    let size = if args.quick { Size::quick(tyres) } else { Size::full_study(tyres) };
    if let Some(folder) = &args.out {
        check_folder(folder, args.force.existing())?;
        check_writable(&folder.with_added_extension("md"), args.force.existing())?;
    }
    let threads = ThreadPoolBuilder::new().num_threads(args.threads).build()?;
    let found = threads.install(|| Findings::compute(&size, args.seed))?;
    print_tables(&found.tables, args.json)?;
    if let Some(folder) = &args.out {
        found.write(folder, args.seed, args.force.existing())?;
    }
    Ok(())
}

impl Findings {
    fn compute(size: &Size, seed: u64) -> Result<Self> {
        let all: Vec<sets::Set> = sets::sets().into_iter().take(size.set_count).collect();
        let first = all.first().context("there is no set")?;
        let names: Vec<&'static str> = all.iter().map(|set| set.name).collect();
        let (mut candidates, mut alone) = (Vec::new(), Vec::new());
        let (mut begun, count) = (0, all.len() + PARTS_OF_ONE_SET);
        let mut begin = |what: &str| {
            begun += 1;
            say(&format!("step {begun} of {count}: {what}"));
        };
        for (number, set) in (0..).zip(&all) {
            begin(&format!("the set {}", set.name));
            let (of_set, alone_of_set) = candidates::candidates(&Split::scan(set, number, size, seed)?)?;
            candidates.extend(of_set);
            alone.extend(alone_of_set);
        }
        begin("probability of detection");
        let detection = detection::detection(first, size, seed)?;
        let mut about = Table::new("sets", "The simulated sets", ["set", "about"]);
        all.iter().for_each(|set| about.push([set.name.into(), set.about.into()]));
        begin("false calls");
        let calls = false_calls::false_calls(first, size, seed)?;
        begin("gauge study");
        let gauge = gauge::gauge(first, size, seed)?;
        let of_sets = summary::of_sets(&candidates, &alone, &names, seed);
        let tables = vec![
            about,
            summary::table(&of_sets),
            candidates::overlap_table(&candidates),
            false_calls::table(&calls)?,
            detection::table(&detection),
            published::table(&detection, &of_sets),
            gauge::table(&gauge),
            candidates::table(&candidates, seed)?,
            candidates::alone_table(&alone, seed),
            detection::targets_table(&detection),
        ];
        Ok(Self { sets: names, candidates, alone, detection, calls, gauge, of_sets, tables })
    }

    /// Writes tables and figures into `folder`, and the page beside it.
    fn write(&self, folder: &Path, seed: u64, existing: Existing) -> Result<()> {
        let name = folder.file_name().and_then(|name| name.to_str());
        let name =
            name.with_context(|| format!("--out is {}; it must end with the name of a folder", folder.display()))?;
        let pictures = pictures::pictures(&self.candidates, &self.alone, &self.detection, &self.sets, seed);
        let mut files = files_of(&self.tables, &pictures, folder)?;
        files.push((folder.with_added_extension("md"), page::page(self, &pictures, name)));
        Ok(write_texts(&files, existing)?)
    }
}
