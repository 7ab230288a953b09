//! `tapline-lab chart`: the atlas: speed against accuracy of every choice, and whether each default is on its front.

mod casings;
mod cost;
mod draw;
mod front;
mod off;
mod page;
mod panel;
mod panels;
mod point;
pub mod provenance;
mod size;
mod stability;
mod table;
mod words;

use std::cell::{OnceCell, RefCell};
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, Result, bail, ensure};
use tapline_acquire::TapSet;
use tapline_host::arguments::ForceArgs;
use tapline_host::atomic_file::{check_folder, write_texts};
use tapline_host::progress::{Progress, Unit};
use tapline_host::stdout::Stdout;

use self::casings::Group;
use self::panel::{Facet, Panel, Skipped};
use self::panels::{Entry, PANELS};
use self::provenance::Provenance;
use self::size::Size;

/// Options of a chart.
#[derive(Debug, clap::Args)]
pub struct ChartArgs {
    /// Folder to write the page, pictures (SVG) and the table of points (CSV) into; created if it does not exist. It is docs/atlas
    /// if left out; with --panel it must be given.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// First of the seeds of all random numbers.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Measure a little of each, to see that it works.
    #[arg(long)]
    pub quick: bool,
    /// Panels to measure, by name; all if left out.
    #[arg(long, value_delimiter = ',')]
    pub panel: Vec<String>,
    /// Folder of recorded tap sets; if they are missing, what needs them is left out, with a notice.
    #[arg(long, default_value = "../shared/data")]
    pub recordings: PathBuf,
    /// Whether existing files are replaced.
    #[command(flatten)]
    pub force: ForceArgs,
}

/// What panels measure with.
pub(crate) struct Bench {
    size: Size,
    seed: u64,
    progress: RefCell<Progress>,
    recordings: PathBuf,
    groups: OnceCell<Vec<Group>>,
    skipped: RefCell<Vec<Skipped>>,
}

impl Bench {
    /// The casings that several panels judge.
    fn groups(&self) -> Result<&[Group]> {
        if let Some(groups) = self.groups.get() {
            return Ok(groups);
        }
        let groups = casings::groups(self)?;
        Ok(self.groups.get_or_init(|| groups))
    }

    /// Leaves something out, with a notice.
    fn skip(&self, panel: &'static str, why: &str) {
        self.progress.borrow().print(&format!("chart: NOTICE: {panel}: {why}"));
        self.skipped.borrow_mut().push(Skipped { panel, why: why.to_owned() });
    }

    /// The recorded taps in `folder`; if they are missing, `panel` leaves them out, with a notice.
    fn recorded(&self, panel: &'static str, folder: &str) -> Result<Option<TapSet>> {
        let path = self.recordings.join(folder);
        if path.is_dir() {
            return Ok(Some(TapSet::open(&path, 1).with_context(|| format!("cannot read {}", path.display()))?));
        }
        self.skip(panel, &format!("no recorded taps in {} (--recordings names their folder)", path.display()));
        Ok(None)
    }

    /// A facet without points: by all seeds, of cracks that were planted unless it says otherwise.
    fn facet(&self, name: impl Into<String>, title: impl Into<String>) -> Facet {
        let truth = "the cracks that were planted".to_owned();
        Facet { name: name.into(), title: title.into(), truth, seeds: self.seeds().collect(), ..Facet::default() }
    }

    fn seeds(&self) -> impl Iterator<Item = u64> + use<> {
        self.seed..self.seed + self.size.seed_count
    }
}

/// Measures the panels that are asked for, and writes page, pictures and table.
///
/// # Errors
/// An unknown panel, a computation that fails, or an error of the file system.
pub fn chart(args: &ChartArgs) -> Result<()> {
    let folder = match (&args.out, args.panel.is_empty()) {
        (Some(out), _) => out.clone(),
        (None, true) => PathBuf::from("docs/atlas"),
        (None, false) => {
            bail!("--panel without --out: only all panels together may replace docs/atlas; name another folder")
        }
    };
    check_folder(&folder, args.force.existing())?;
    let wanted = wanted(&args.panel)?;
    let bench = Bench::new(args, &wanted);
    let mut done_s = 0.0;
    let mut begin = |name: &str, expected_s: f64| {
        let mut progress = bench.progress.borrow_mut();
        progress.print(&format!("chart: {name}, {expected_s:.0} s expected"));
        progress.update(done_s as u64);
        done_s += expected_s;
    };
    if wanted.iter().any(|entry| entry.uses_casings) {
        begin("casings", casings::expected_s(&bench.size));
        bench.groups()?;
    }
    let mut panels = Vec::new();
    for entry in wanted {
        begin(entry.name, entry.expected_s(&bench.size));
        let panel = (entry.measure)(&bench).with_context(|| format!("cannot measure the panel {}", entry.name))?;
        let panel = Panel { name: entry.name, ..panel };
        // A panel whose recordings are missing has nothing to show; the notice stays.
        if !panel.facets.is_empty() {
            panels.push(panel);
        }
    }
    let files = files(&panels, &bench.skipped.borrow(), &Provenance::here(args.seed, args.quick))?;
    let files: Vec<_> = files.into_iter().map(|(name, text)| (folder.join(name), text)).collect();
    write_texts(&files, args.force.existing())?;
    bench.progress.borrow().finish();
    print_defaults(&panels)?;
    Ok(())
}

impl Bench {
    fn new(args: &ChartArgs, wanted: &[&Entry]) -> Self {
        let size = if args.quick { Size::quick() } else { Size::full() };
        let casings_s = if wanted.iter().any(|entry| entry.uses_casings) { casings::expected_s(&size) } else { 0.0 };
        let total_s = casings_s + wanted.iter().map(|entry| entry.expected_s(&size)).sum::<f64>();
        Self {
            size,
            seed: args.seed,
            // Of the seconds that the parts are expected to take, those of parts that are done.
            progress: RefCell::new(Progress::new(Some(total_s.ceil() as u64), Unit::Part)),
            recordings: args.recordings.clone(),
            groups: OnceCell::new(),
            skipped: RefCell::default(),
        }
    }
}

/// The files of a chart: name and contents.
fn files(panels: &[Panel], skipped: &[Skipped], provenance: &Provenance) -> Result<Vec<(String, String)>> {
    let mut files = vec![
        ("index.html".to_owned(), page::html(panels, skipped, provenance)?),
        ("README.md".to_owned(), page::markdown(panels, skipped, provenance)),
        ("points.csv".to_owned(), table::csv(panels, provenance)?),
    ];
    for panel in panels {
        files.push((format!("{}.svg", panel.name), draw::sheet(panel, false)?));
        files.push((format!("{}-narrow.svg", panel.name), draw::sheet(panel, true)?));
        for table in &panel.tables {
            files.push((format!("{}.csv", table.name), table.csv()?));
        }
    }
    Ok(files)
}

fn print_defaults(panels: &[Panel]) -> Result<()> {
    let mut out = Stdout;
    for row in words::defaults(panels) {
        writeln!(out, "{}, {}: {}: {}", row.panel, row.facet, row.default, row.words)?;
    }
    Ok(())
}

/// The panels called `names`; all if none is.
fn wanted(names: &[String]) -> Result<Vec<&'static Entry>> {
    for name in names {
        let known: Vec<&str> = PANELS.iter().map(|entry| entry.name).collect();
        ensure!(known.contains(&name.as_str()), "--panel is {name}; there are {}", known.join(", "));
    }
    Ok(PANELS.iter().filter(|entry| names.is_empty() || names.iter().any(|name| name == entry.name)).collect())
}

#[cfg(test)]
mod tests;
