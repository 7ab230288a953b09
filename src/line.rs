//! `tapline run`: a whole line, from the first tap to the table of verdicts.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use tapline_store::{Reader, RunWriter};
use tapline_wire::{
    Ledger, LedgerTopic, Line, LineAddress, Plan, Role, Services, Subscriber, TapState, line_bytes, room,
};

use crate::child::Stage;
use crate::cli::RunArgs;
use crate::config::Job;
use crate::progress::Progress;
use crate::stage::stop_flag;
use crate::summary::{Pace, summarise};
use crate::tell::tell;

/// `store`, `fuse` and `process`, in this order, come before the sources.
const DOWNSTREAM: usize = 3;

/// How long a stage may take to end after it was told to.
const END_WITHIN: Duration = Duration::from_secs(20);

/// How long stages of an earlier line may take to end with it: as long as any, and a little for the news to come.
const GONE_WITHIN: Duration = END_WITHIN.saturating_add(Duration::from_secs(5));

/// After how long of that it is said what is waited for.
const TELL_AFTER: Duration = Duration::from_millis(500);

/// `store` tells the ledger ten times a second; when it has not for so long, its disk is slow or hangs.
const SILENT_AFTER: Duration = Duration::from_millis(900);

/// How often the stages and the ledger are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(50);

pub(crate) fn run(args: &RunArgs) -> Result<bool> {
    let job = Job::resolve(&args.source)?;
    let plan = job.source()?.plan().clone();
    // What cannot be judged is said before anything is scanned.
    job.fusion(&plan)?;
    let lock = Lock::take(&job.out)?;
    // First, as stages of a line that was killed may hold the archive still; and what it left is cleared away, also when
    // nothing is left to do.
    let workplace = Workplace::prepare(&job, &plan)?;
    let pace = match settled_before(&job, &plan)? {
        None => Pace::default(),
        Some(settled) => {
            // The watcher stays to the end, also when the stages are told to stop.
            let watch = Line::join(&workplace.address, Role::Watch, &plan, Arc::default())?;
            let _services = Services::open(&watch, &plan)?;
            Run::start(&job, args, &plan, &workplace, settled)?.until_done(&watch, &plan)?
        }
    };
    drop(workplace);
    drop(lock);
    summarise(&job, pace, args.json)
}

/// How many taps of the archive are settled already, `None` when nothing is left to do.
///
/// An archive of another plan or configuration is an error.
fn settled_before(job: &Job, plan: &Plan) -> Result<Option<usize>> {
    if !RunWriter::is_begun(&job.out, &job.config.store)? {
        return Ok(Some(0));
    }
    let reader = Reader::open(&job.out)?;
    let reference = job.reference()?;
    reader.check_same(plan, job.lineage(reference.as_ref())).context(
        "the archive cannot be gone on with: give another --out, or the same taps, stations, configuration and reference as before",
    )?;
    let ledger = reader.ledger();
    // A row of the ledger that is torn is written again by whoever opens the archive to write.
    let is_finished = ledger.is_judged() && ledger.count(TapState::Missing) == 0 && !reader.is_torn();
    Ok((!is_finished).then(|| settled_count(ledger)))
}

/// Holds off a second line on the same archive, until it is dropped.
struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    fn take(archive: &Path) -> Result<Self> {
        let path = PathBuf::from(format!("{}.lock", archive.display()));
        // Held open to read only, it does not keep the disk from being made read only.
        let file = File::create(&path).and_then(|_| File::open(&path));
        let file = file.with_context(|| format!("cannot write beside the archive: {}", path.display()))?;
        if let Err(error) = file.try_lock() {
            bail!("another line is writing {} ({error})", archive.display());
        }
        Ok(Self { path, _file: file })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // With its folder it may have been removed already.
        if let Err(error) = fs::remove_file(&self.path)
            && error.kind() != ErrorKind::NotFound
        {
            tracing::warn!(path = %self.path.display(), %error, "cannot remove the lock");
        }
    }
}

/// The line's place in shared memory and its copies of the configuration and the reference, cleared away when dropped.
struct Workplace {
    name: String,
    address: LineAddress,
    config: PathBuf,
    reference: Option<PathBuf>,
}

impl Workplace {
    fn prepare(job: &Job, plan: &Plan) -> Result<Self> {
        // One archive, one name: what a line that died has left is found and cleared by the next.
        let name = format!("{:016x}", fnv_1a(absolute(&job.out)?.as_os_str().as_encoded_bytes()));
        let address = LineAddress::new(&name);
        let since = Instant::now();
        let mut is_told = false;
        while !address.clear()? {
            if since.elapsed() > TELL_AFTER && !std::mem::replace(&mut is_told, true) {
                tell(&format!("waiting for stages of an earlier line on {} to end", job.out.display()));
            }
            if since.elapsed() > GONE_WITHIN {
                bail!("stages of an earlier line on {} still run: end them first (ps shows them)", job.out.display());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        room::check("this line", line_bytes(plan))?;
        fs::create_dir_all(&address.root).with_context(|| format!("cannot create {}", address.root.display()))?;
        // Stages read this copy, also when they are restarted after the original has been edited.
        let config = address.root.join("run.toml");
        fs::write(&config, &job.config_toml).with_context(|| format!("cannot write {}", config.display()))?;
        let mut reference = None;
        if let Some(file) = job.reference()? {
            let copy = address.root.join("reference.json");
            fs::write(&copy, file.text).with_context(|| format!("cannot write {}", copy.display()))?;
            reference = Some(copy);
        }
        Ok(Self { name, address, config, reference })
    }
}

impl Drop for Workplace {
    fn drop(&mut self) {
        match self.address.clear() {
            Ok(true) => {}
            Ok(false) => tracing::warn!("someone still uses the line's shared memory; the next run clears it away"),
            Err(error) => tracing::warn!(%error, "cannot clear away the line's shared memory"),
        }
    }
}

fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("{} is no usable path", path.display()))
}

/// 64-bit FNV-1a, for a name that two runs agree on.
fn fnv_1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// A line that is running.
struct Run {
    // Dropped first: no stage may be left when the workplace is cleared.
    stages: Vec<Stage>,
    stop: Arc<AtomicBool>,
    progress: Progress,
    /// Taps that were settled before this run.
    settled_before: usize,
    /// When the line was first seen at work, and when the last change was.
    span: Option<(Instant, Instant)>,
}

impl Run {
    fn start(job: &Job, args: &RunArgs, plan: &Plan, workplace: &Workplace, settled_before: usize) -> Result<Self> {
        let stop = stop_flag()?;
        let common = stage_arguments(job, args, workplace)?;
        // Downstream first, so that nobody sends to no one.
        let mut stages = Vec::new();
        for verb in ["store", "fuse", "process"] {
            stages.push(Stage::start(verb.to_owned(), [vec![verb.to_owned()], common.clone()].concat())?);
        }
        for station in plan.stations() {
            let own = vec!["acquire".to_owned(), "--station".to_owned(), station.to_string()];
            stages.push(Stage::start(format!("acquire {station}"), [own, common.clone()].concat())?);
        }
        let progress = Progress::new(plan.taps().len(), &job.out);
        Ok(Self { stages, stop, progress, settled_before, span: None })
    }

    fn until_done(mut self, watch: &Line, plan: &Plan) -> Result<Pace> {
        let is_over = self.watch_over(watch, plan)?;
        if !is_over {
            self.progress.say("stopping: waiting for what is under way to be archived");
            // The sources first; while they wait for what they sent, whoever dies downstream is still replaced.
            self.end(DOWNSTREAM..self.stages.len())?;
        }
        for number in (0..DOWNSTREAM).rev() {
            self.end(number..number + 1)?;
        }
        self.end(0..self.stages.len())?;
        self.progress.finish();
        Ok(self.pace())
    }

    /// Tends the stages until every scan is judged and `store` has ended; false as soon as the run is to stop.
    fn watch_over(&mut self, watch: &Line, plan: &Plan) -> Result<bool> {
        let snapshots = Subscriber::<LedgerTopic>::open(watch, plan)?;
        let mut is_judged = false;
        let mut silence = Silence::default();
        while self.stages[0].is_running() {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
            watch.wait(LOOK_EVERY)?;
            if let Some(snapshot) = snapshots.receive_newest()?
                && let Some(ledger) = Ledger::decode(snapshot.header(), &snapshot)
            {
                is_judged = ledger.is_judged();
                self.note(settled_count(&ledger));
                silence.end();
            }
            silence.look();
            for stage in &mut self.stages {
                // When all is judged, whoever is killed has nothing left to do.
                stage.tend(!is_judged)?;
            }
        }
        Ok(true)
    }

    fn note(&mut self, settled: usize) {
        let now = Instant::now();
        let (first, last) = self.span.get_or_insert((now, now));
        if self.progress.update(settled, settled.saturating_sub(self.settled_before), *first) {
            *last = now;
            self.stages.iter_mut().for_each(Stage::note_progress);
        }
    }

    /// Asks some stages to end, those that have not, and waits for them; the others are tended meanwhile.
    fn end(&mut self, which: Range<usize>) -> Result<()> {
        let since = Instant::now();
        for stage in &self.stages[which.clone()] {
            stage.ask_to_end();
        }
        while self.stages[which.clone()].iter().any(Stage::is_running) {
            let is_store_there = self.stages[0].is_running();
            for (number, stage) in self.stages.iter_mut().enumerate() {
                let may_restart = number < which.start && is_store_there;
                stage.tend(may_restart)?;
                if which.contains(&number) && stage.is_running() && since.elapsed() > END_WITHIN {
                    stage.kill();
                }
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    fn pace(&self) -> Pace {
        let elapsed = self.span.map(|(first, last)| last - first);
        Pace {
            settled_before: Some(self.settled_before),
            elapsed_s: elapsed.map_or(0.0, |d| d.as_secs_f64()),
            restarts: self.stages.iter().map(|s| (s.name().to_owned(), s.restart_count)).collect(),
            reports: self.stages.iter().filter_map(|s| s.report.clone()).collect(),
        }
    }
}

/// How long nothing has been heard of the archive, from the first word on.
#[derive(Debug, Default)]
struct Silence {
    heard_at: Option<Instant>,
    is_said: bool,
}

impl Silence {
    fn look(&mut self) {
        let is_long = self.heard_at.is_some_and(|at| at.elapsed() > SILENT_AFTER);
        if is_long && !self.is_said {
            self.is_said = true;
            tracing::error!("store does not answer: its disk is slow or hangs, or it is held up; the line waits");
        }
    }

    fn end(&mut self) {
        let now = Instant::now();
        let since = self.heard_at.replace(now).unwrap_or(now);
        if std::mem::take(&mut self.is_said) {
            tracing::warn!("store answers again, after {:.1} s", (now - since).as_secs_f64());
        }
    }
}

fn settled_count(ledger: &Ledger) -> usize {
    ledger.taps().iter().filter(|state| state.is_settled()).count()
}

fn stage_arguments(job: &Job, args: &RunArgs, workplace: &Workplace) -> Result<Vec<String>> {
    let text = |path: &Path| {
        let path = absolute(path)?;
        path.to_str().map(ToOwned::to_owned).with_context(|| format!("{} is not valid UTF-8", path.display()))
    };
    let mut arguments =
        vec!["--child".to_owned(), std::process::id().to_string(), "--line".to_owned(), workplace.name.clone()];
    arguments.extend(["--config".to_owned(), text(&workplace.config)?, "--out".to_owned(), text(&job.out)?]);
    if let Some(reference) = &workplace.reference {
        arguments.extend(["--reference-copy".to_owned(), text(reference)?]);
    }
    if let Some(taps) = &job.taps {
        arguments.extend(["--taps".to_owned(), text(taps)?]);
    }
    if let Some(stations) = args.source.stations {
        arguments.extend(["--stations".to_owned(), stations.to_string()]);
    }
    Ok(arguments)
}
