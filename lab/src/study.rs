//! `tapline-lab study`: a seeded Monte Carlo over simulated tyres, which says what the indices and plans are worth.

mod areas;
mod detection;
mod draw;
mod false_calls;
mod gauge;
mod judged;
mod left_out;
mod page;
mod plans;
mod rivals;
mod sets;
mod sheets;
mod size;
mod summary;
mod table;
mod taken;
mod work;

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use serde_json::{Map, Value};

use self::detection::Detection;
use self::false_calls::Calls;
use self::plans::Tried;
use self::rivals::{Alone, Halves, Rival};
use self::size::Size;
use self::table::Table;

/// What a study is asked for.
#[derive(Debug, clap::Args)]
pub struct StudyArgs {
    /// Tyres of each simulated set, of which a half trains and a half is judged; 16, or 8 with --quick, when left out.
    #[arg(long)]
    pub tyres: Option<usize>,
    /// Decides all that is left to chance; the same seed gives the same bytes on processors with the same vector
    /// instructions.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Threads; one for every core when left out. They change no result.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Do little of everything, to see that it works.
    #[arg(long)]
    pub quick: bool,
    /// Print the tables as JSON.
    #[arg(long)]
    pub json: bool,
    /// Folder to write tables (CSV) and figures (SVG) into, with a page beside it; made when it is not there.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Tyres of a set when nothing else is asked for.
const TYRES: usize = 16;
const TYRES_QUICK: usize = 8;

/// All that is found.
#[derive(Debug)]
struct Found {
    sets: Vec<&'static str>,
    rivals: Vec<Rival>,
    alone: Vec<Alone>,
    detection: Vec<Detection>,
    plans: Vec<Tried>,
    calls: Vec<Calls>,
    tables: Vec<Table>,
}

/// Does the study, prints its tables, and writes them with figures and a page where that is asked for.
///
/// # Errors
/// Too few tyres, a computation that fails, or what the system says of a file.
pub fn study(args: &StudyArgs) -> Result<()> {
    let tyres = args.tyres.unwrap_or(if args.quick { TYRES_QUICK } else { TYRES });
    ensure!(tyres >= 8, "--tyres is {tyres}; at least 8 are needed, for two of each kind to train and to be judged");
    let size = if args.quick { Size::quick(tyres) } else { Size::whole(tyres) };
    let found = Found::of(&size, args.seed, args.threads)?;
    let mut out = io::stdout().lock();
    if args.json {
        let tables = found.tables.iter().map(|table| (table.name.to_owned(), table.json()));
        writeln!(out, "{:#}", Value::Object(tables.collect::<Map<_, _>>()))?;
    } else {
        for table in found.tables.iter().filter(|table| !table.is_long) {
            writeln!(out, "{}", table.text())?;
        }
    }
    if let Some(folder) = &args.out {
        found.write(folder, args.seed)?;
    }
    Ok(())
}

impl Found {
    fn of(size: &Size, seed: u64, threads: usize) -> Result<Self> {
        let all: Vec<sets::Set> = sets::sets().into_iter().take(size.set_count).collect();
        let first = all.first().context("there is no set")?;
        let names: Vec<&'static str> = all.iter().map(|set| set.name).collect();
        let (mut rivals, mut alone, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        let mut overlaps = Vec::new();
        let mut tried = Vec::new();
        for (number, set) in (0..).zip(&all) {
            // The first set is scanned by the full plan, of which its own is a part.
            let turns = if number == 0 { &size.full } else { &size.turns };
            let halves = Halves::of(set, number, size, turns, seed, threads)?;
            if number == 0 {
                tried = plans::plans(&halves, &size.full, threads)?;
            }
            let halves = halves.with(&size.turns)?;
            let (of_set, alone_of_set) = rivals::rivals(&halves, threads)?;
            overlaps.push(rivals::overlaps(&halves)?);
            rivals.extend(of_set);
            alone.extend(alone_of_set);
            left_out.extend(left_out::left_out(&halves, threads)?);
        }
        let detection = detection::detection(first, size, seed, threads)?;
        let cheapest = plans::cheapest(&tried).map(|t| t.turns.clone());
        let full = tried.last().map(|t| t.turns.clone());
        let is_named = |t: &Tried| [&cheapest, &full].into_iter().flatten().any(|turns| *turns == t.turns);
        let of_note = "The full plan, the cheapest within 0.01 AUC of it, and those that no plan beats in time and AUC";
        let mut about = Table::new("sets", "The simulated sets", &["set", "about"]);
        all.iter().for_each(|set| about.push([set.name.to_owned(), set.about.to_owned()]));
        let calls = false_calls::false_calls(first, size, seed, threads)?;
        let tables = vec![
            about,
            summary::default_table(&rivals, &alone, &names, seed),
            summary::largest_table(&rivals, &names, seed),
            summary::ways_table(&rivals, &names),
            summary::left_out_table(&left_out, &names),
            rivals::overlaps_table(&overlaps),
            false_calls::table(&calls)?,
            detection::table(&detection),
            gauge::table(&gauge::gauge(first, size, seed, threads)?),
            plans::table("plans_of_note", of_note, &tried, |t| t.is_on_front || is_named(t), seed),
            plans::table("plans", "Every part of the full plan", &tried, |_| true, seed).into_long(),
            rivals::table(&rivals, &alone, seed)?,
            rivals::alone_table(&alone),
            left_out::table(&left_out),
            detection::targets_table(&detection),
        ];
        Ok(Self { sets: names, rivals, alone, detection, plans: tried, calls, tables })
    }

    /// Writes tables and figures into `folder`, and the page beside it.
    fn write(&self, folder: &Path, seed: u64) -> Result<()> {
        let name = folder.file_name().and_then(|name| name.to_str());
        let name =
            name.with_context(|| format!("--out is {}; it must end with the name of a folder", folder.display()))?;
        let mut files = Vec::new();
        for table in &self.tables {
            files.push((folder.join(format!("{}.csv", table.name)), table.csv()?));
        }
        let sheets = sheets::sheets(&self.rivals, &self.alone, &self.detection, &self.plans, &self.sets, seed);
        for sheet in &sheets {
            files.push((folder.join(format!("{}.svg", sheet.name)), sheet.svg()?));
        }
        files.push((folder.with_added_extension("md"), page::page(self, &sheets, name)));
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for (path, text) in files {
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }
}
