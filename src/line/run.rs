//! `tapline run` and `tapline line`: the same line, on a list of casings and on casings as they come.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use tapline_acquire::StationSource;
use tapline_fuse::Reference;
use tapline_host::atomic_file::{Existing, write_atomically};
use tapline_host::messages::{counted, say};
use tapline_host::progress::{Progress, Unit};
use tapline_host::signals::stop_flag;
use tapline_store::{UNREPORTED_FOLDER, digest_of, hex_of, lineage_change};
use tapline_wire::{Line, LineAddress, Role, Services};

use crate::cli::line::{LineArgs, RunArgs};
use crate::config::job::Job;
use crate::config::report::ReportConfig;
use crate::line::check::{check_line, refuse_watched_results, remark_on_scan, require_reference};
use crate::line::listed::Listed;
use crate::line::out_folder::OutFolder;
use crate::line::process_name::name_process;
use crate::line::setup::{Arriving, Setup, absolute};
use crate::line::summary::summarise;
use crate::line::supervisor::{Audience, LineOutcome, ShowStatus, Supervisor};
use crate::shown::verdict::Form;
use crate::wires::{Receiver, Wires};

/// How long stages of an earlier line may take to end: a little more than any stage.
const GONE_WITHIN: Duration = Duration::from_secs(25);

/// The file that identifies the run whose results a folder has.
const RUN_FILE: &str = "run.toml";

/// `tapline run`: the casings of a list, until each has its verdict.
pub(crate) fn run(args: &RunArgs) -> Result<bool> {
    let job = Job::resolve(&args.source)?;
    let arriving = match &job.taps {
        Some(folder) => Arriving::TapSet { folder: absolute(folder)?, stations: job.stations.unwrap_or(1) },
        None => Arriving::Simulated,
    };
    let setup = Setup::new(&job, arriving, &absolute(&job.out)?)?;
    // Casings that cannot be judged, or not at once, are reported before anything is scanned.
    let listed = Listed::check(&job, &setup)?;
    let mut folder = OutFolder::take(&job.out)?;
    // Its casings under way would be taken for those of the list.
    ensure!(
        !folder.path().join(UNREPORTED_FOLDER).is_dir(),
        "{} is the folder of a `tapline line`: give another --out",
        folder.path().display()
    );
    RunFile::new(&job, &setup, &listed).check_or_write(folder.path())?;
    folder.clear_left(GONE_WITHIN)?;
    let places = setup.places();
    let finished = listed.names.iter().filter(|name| places.finished(name).is_some()).count();
    let is_done = finished == listed.names.len();
    if !is_done {
        setup.check_machine()?;
    }
    say_unsupported(&job);
    let outcome = if is_done {
        LineOutcome::default()
    } else {
        if job.taps.is_none() {
            remark_on_scan(&job.config.scan);
        }
        let stop = stop_at_signals()?;
        let progress = scanning(&job, &listed, finished);
        // The table at the end has more.
        let form = if args.json { Form::Json } else { Form::Short };
        let audience = Audience { progress, wires: None, form, show: None };
        operate(&setup, &mut folder, audience, Some(listed.names.len()), stop)?
    };
    drop(folder);
    summarise(&job, &setup, &listed.names, outcome, args.json)
}

/// Progress of the scan of `listed`, of which `finished` casings are done.
fn scanning(job: &Job, listed: &Listed, finished: usize) -> Progress {
    let progress = Progress::new(Some(listed.tap_count as u64), Unit::Things("taps"));
    let taps = counted(listed.tap_count, "tap", "taps");
    let again = if job.taps.is_none() && job.config.scan.confirm { AGAIN } else { "" };
    progress.print(&format!("scanning {taps}{again}; results go into {}", job.out.display()));
    if finished > 0 {
        let casings = counted(listed.names.len(), "casing", "casings");
        progress.print(&format!("of {casings}, {finished} {} done already", if finished == 1 { "is" } else { "are" }));
    }
    progress
}

/// What else is scanned.
const AGAIN: &str = ", plus second readings";

/// `tapline line`: casings as they come, until it is asked to stop.
pub(crate) fn line(args: &LineArgs) -> Result<bool> {
    let job = Job::of_line(args)?;
    let setup = check_line(&job)?;
    require_reference(&job)?;
    refuse_watched_results(&job)?;
    // What cannot be served is refused before a line begins.
    let (show, shown_at) = show_on_page(args, &job.config.report)?;
    let mut folder = OutFolder::take(&job.out)?;
    ensure!(
        !folder.path().join(RUN_FILE).exists(),
        "{} is the folder of a `tapline run`: give another --out",
        folder.path().display()
    );
    folder.clear_left(GONE_WITHIN)?;
    setup.check_machine()?;
    say_unsupported(&job);
    // Before anything is printed: from here on, a line that is asked to stop ends cleanly.
    let stop = stop_at_signals()?;
    let progress = Progress::new(None, Unit::Things("taps"));
    progress.print(&format!("waiting for casings; results go into {}", job.out.display()));
    if let (Some(Reference::File(path)), Some(file)) = (&job.config.fuse.reference, &job.reference) {
        let casings = counted(file.set.summary.casing_count, "casing", "casings");
        progress.print(&format!("compared with {}: {casings}, digest {:.12}", path.display(), file.set.digest()));
    }
    let scan = &job.config.scan;
    if job.config.station.iter().any(|station| station.source != StationSource::Folder) {
        let again = if scan.confirm { AGAIN } else { "" };
        progress
            .print(&format!("per casing {} are made{again}", counted(scan.taps_per_tyre() as usize, "tap", "taps")));
    }
    shown_at.iter().for_each(|address| progress.print(&format!("the line is shown at {address}")));
    folder.make_unreported()?;
    let form = if args.json { Form::Json } else { Form::Full };
    let (wires, said) = Wires::start(&job.config.line, &setup.limits.stations, &setup.places(), form)?;
    said.iter().for_each(|text| progress.print(text));
    let audience = Audience { progress, wires: Some(wires), form, show };
    let outcome = operate(&setup, &mut folder, audience, args.casings.map(|count| count as usize), stop)?;
    say_how_it_ended(&outcome);
    let is_printed = outcome.waiting.iter().all(|(receiver, _)| receiver != Receiver::Print.name());
    Ok(is_printed && outcome.left_out.is_empty())
}

/// Says what is still to be done, and what was left out.
fn say_how_it_ended(outcome: &LineOutcome) {
    let judged = counted(outcome.closed, "casing", "casings");
    say(&format!("the line has ended: {judged} judged"));
    outcome.unfinished.iter().for_each(|text| say(text));
    for (receiver, count) in &outcome.waiting {
        if receiver == Receiver::Print.name() {
            let count = counted(*count as usize, "verdict was", "verdicts were");
            tracing::error!("{count} not printed: the same command prints what nobody read");
            continue;
        }
        let count = counted(*count as usize, "verdict waits", "verdicts wait");
        say(&format!("{count} for {receiver}: the same command reports them"));
    }
    for text in &outcome.left_out {
        say(&format!("left out: {text}"));
    }
}

/// Starts to serve the page of the line, if `args` ask for it; returns what takes each status, and the address.
#[cfg(feature = "serve")]
fn show_on_page(args: &LineArgs, printed: &ReportConfig) -> Result<(Option<ShowStatus>, Option<String>)> {
    let Some(address) = args.serve else { return Ok((None, None)) };
    let server = crate::serve::Server::start(address, args.serve_token_file.as_deref(), printed)?;
    let address = server.url();
    Ok((Some(Box::new(move |status| server.show(status))), Some(address)))
}

/// This build has no page.
#[cfg(not(feature = "serve"))]
#[expect(clippy::unnecessary_wraps, reason = "as where there is a page")]
fn show_on_page(_: &LineArgs, _: &ReportConfig) -> Result<(Option<ShowStatus>, Option<String>)> {
    Ok((None, None))
}

/// Warns of what the reference cannot show, and of stated rates that it does not support.
fn say_unsupported(job: &Job) {
    if job.config.fuse.reference == Some(Reference::Own) {
        tracing::warn!("each casing is compared with itself: damage all round would not show");
    }
    job.fusions().unsupported().iter().for_each(|text| tracing::warn!("{text}"));
}

/// A flag that is set when this process is asked to end.
fn stop_at_signals() -> Result<Arc<AtomicBool>> {
    stop_flag().context("cannot listen for signals")
}

/// Runs the line that `setup` describes, until `stop` is set or `count` casings have their verdicts.
fn operate(
    setup: &Setup,
    folder: &mut OutFolder,
    audience: Audience,
    count: Option<usize>,
    stop: Arc<AtomicBool>,
) -> Result<LineOutcome> {
    name_process("tapline-line");
    let workplace = Workplace { address: LineAddress::fresh()? };
    let address = &workplace.address;
    folder.enter(address)?;
    let _lock = address.lock_folder()?;
    setup.write(address)?;
    // It stays to the end, even when the stages are asked to stop.
    let line = Line::join(address, Role::Supervisor, &setup.limits, Default::default())?;
    let _services = Services::open(&line)?;
    address.verify()?;
    let supervisor = Supervisor::start(&line, setup, address, folder, stop, audience)?;
    supervisor.until_done(count)
}

/// The line's place in shared memory, cleared away when dropped.
struct Workplace {
    address: LineAddress,
}

impl Drop for Workplace {
    fn drop(&mut self) {
        match self.address.clear() {
            Ok(true) => {}
            // The stages have ended: whoever still has something of it open needs only what is mapped.
            Ok(false) => self.address.remove(),
            Err(error) => tracing::warn!(%error, "cannot clear away the line's shared memory"),
        }
    }
}

/// The run whose results a folder has, so that no other run continues them.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct RunFile {
    /// How many casings.
    casings: usize,
    /// Folder of the recorded taps; absent for simulated ones.
    taps: Option<PathBuf>,
    /// Name and digest of the plan of each recorded casing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    plans: Vec<String>,
    /// The reference file, by its digest.
    reference: Option<String>,
    /// What the results are made by: the program's sources, and every option that affects them.
    made_by: Vec<String>,
}

impl RunFile {
    fn new(job: &Job, setup: &Setup, listed: &Listed) -> Self {
        let taps = match &setup.arriving {
            Arriving::TapSet { folder, .. } => Some(folder.clone()),
            Arriving::Simulated | Arriving::Stations => None,
        };
        Self {
            casings: listed.names.len(),
            taps,
            plans: listed.plans.clone(),
            reference: setup.reference.as_ref().map(|text| hex_of(&digest_of(text.as_bytes()))),
            made_by: job.made_by().lines().map(str::to_owned).collect(),
        }
    }

    /// Writes it into `folder`, unless that has results of another run.
    fn check_or_write(&self, folder: &Path) -> Result<()> {
        let path = folder.join(RUN_FILE);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let has_files = fs::read_dir(folder).into_iter().flatten().flatten();
                let is_result = |path: &Path| path.extension().is_some_and(|ending| ending == "h5");
                if has_files.map(|file| file.path()).any(|path| is_result(&path)) {
                    bail!(
                        "{} has archives, but no {RUN_FILE} that says which run made them: give another --out",
                        folder.display()
                    );
                }
                let text = toml::to_string(self)?;
                return Ok(write_atomically(&path, Existing::Keep, |mut file| file.write_all(text.as_bytes()))?);
            }
            Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
        };
        let there: Self = toml::from_str(&text).with_context(|| format!("{} is not readable", path.display()))?;
        let differs = self.difference(&there);
        let Some(what) = differs else { return Ok(()) };
        bail!(
            "{} has results of another run ({what}): give another --out, or the same taps, stations, configuration and \
             reference as before",
            folder.display()
        )
    }

    fn difference(&self, there: &Self) -> Option<String> {
        if self.casings != there.casings {
            return Some(format!("{} there, {} here", counted(there.casings, "casing", "casings"), self.casings));
        }
        if self.plans != there.plans {
            let only = |of: &[String], other: &[String]| of.iter().find(|plan| !other.contains(plan)).cloned();
            let [there, here] = [only(&there.plans, &self.plans), only(&self.plans, &there.plans)]
                .map(|plan| plan.unwrap_or_else(|| "nothing".to_owned()));
            return Some(format!("other recorded taps: {there} there, {here} here"));
        }
        if self.reference != there.reference {
            return Some("another reference".to_owned());
        }
        (self.made_by != there.made_by).then(|| {
            let (there, here) = lineage_change(&there.made_by.join("\n"), &self.made_by.join("\n"));
            format!("{there} there, {here} here")
        })
    }
}
