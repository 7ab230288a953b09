//! `tapline reprocess`: new discriminators from the recorded taps, or new verdicts from the archived discriminators.
//!
//! The archive is never changed. The results go to a file beside it, named after their lineage, which every other verb reads
//! like an archive.

use std::fs::{self, File};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use rustix::fs::{Timespec, Timestamps, UTIME_NOW, UTIME_OMIT, futimens};
use serde_json::json;
use tapline_fuse::{FuseConfig, Fusion, Reference};
use tapline_host::messages::{counted, say};
use tapline_host::signals::note_folder;
use tapline_host::stdout::Stdout;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_store::{Error, Lineage, PutOutcome, ReadBuffer, Reader, Taps, Writer, lineage_key, results_path};
use tapline_wire::{Discriminators, ScanState, TapHeader, TapState};

use crate::archives::several::{cores, each};
use crate::archives::work::Work;
use crate::archives::{ArchiveFile, Archives, Which};
use crate::cli::archives::ReprocessArgs;
use crate::config::Config;
use crate::config::lineage::{made_by, of_discriminators};
use crate::config::reference::{Fusions, KeptReferences, ReferenceFile};

/// Most threads that may be asked for.
const JOBS_MAX: usize = 1024;

/// Time between two looks for results that another process is making.
const WAIT: Duration = Duration::from_millis(50);

/// Time after which no further look begins.
const WAITED_MAX: Duration = Duration::from_secs(30);

/// What a time of a file becomes: the present, or nothing else than it is.
const NOW: Timespec = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
const OMIT: Timespec = Timespec { tv_sec: 0, tv_nsec: UTIME_OMIT };

/// Taps that a thread takes at a time.
const TAPS_AT_A_TIME: usize = 64;

/// Taps after which results are flushed to the disk.
const FLUSH_TAPS: usize = 256;

pub(crate) fn reprocess(args: &ReprocessArgs) -> Result<bool> {
    let jobs = if args.jobs == 0 { cores() } else { args.jobs };
    ensure!(jobs <= JOBS_MAX, "--jobs is {jobs}; at most {JOBS_MAX} threads are started");
    let archives = Archives::find(&args.archives, Which::Casings)?;
    // Where there are fewer archives than threads, the taps of each are shared among several.
    let asked = Asked::new(args, jobs.div_ceil(archives.files.len().clamp(1, jobs)))?;
    let mut work = Work::on(&archives);
    let (begin, mut tap_count, mut read_count) = (Instant::now(), 0, 0);
    let judge_again = |(): &mut (), file: &ArchiveFile| {
        tracing::info!("reading {}", file.path.display());
        again(&file.path, &asked).with_context(|| format!("cannot judge {} again", file.path.display()))
    };
    let nothing = || Ok(());
    each(&archives.files, jobs, nothing, judge_again, |file, done| {
        work.note_done(file);
        if let Some(results) = work.take(file, done)? {
            work.beside(|| print(args, &file.path, &results))?;
            work.note(results.made.is_complete && results.made.is_newest);
            tap_count += results.made.tap_count;
            read_count += usize::from(results.made.is_from_samples);
        }
        Ok(())
    })?;
    if tap_count > 0 {
        let took_s = begin.elapsed().as_secs_f64();
        #[expect(clippy::cast_precision_loss, reason = "a rate for people to read")]
        let rate = tap_count as f64 / took_s;
        let (taps, read) = (counted(tap_count, "tap", "taps"), counted(read_count, "archive", "archives"));
        let text = format!("{taps} judged again in {took_s:.1} s, {rate:.0} taps/s; the samples of {read} were read");
        work.beside(|| say(&text));
    }
    work.end()
}

/// What is asked for of every archive.
struct Asked {
    config: Option<Config>,
    reference: Option<Reference>,
    /// The text of `reference`, if that is a file.
    text: Option<String>,
    /// Fitting a reference takes longer than judging a casing.
    kept: Mutex<KeptReferences>,
    /// Whether samples are read even where discriminators would do.
    from_samples: bool,
    /// Number of threads for the samples of one.
    jobs: usize,
}

impl Asked {
    fn new(args: &ReprocessArgs, jobs: usize) -> Result<Self> {
        let read = |path: &PathBuf| {
            let config = Config::read(path)?.0;
            config.process.validate().with_context(|| path.display().to_string())?;
            config.fuse.validate().with_context(|| path.display().to_string())?;
            anyhow::Ok(config)
        };
        let config = args.config.as_ref().map(read).transpose()?;
        let reference = args.reference.clone().map(Reference::try_from).transpose().context("--reference")?;
        let text = match &reference {
            Some(Reference::File(path)) => Some(ReferenceFile::read(path)?.text),
            _ => None,
        };
        Ok(Self { config, reference, text, kept: Mutex::default(), from_samples: args.from_samples, jobs })
    }
}

/// What is to be done with one archive.
struct Task {
    reader: Reader,
    config: Config,
    config_toml: String,
    made_by: String,
    reference: Option<String>,
    raw_digest: [u8; 32],
    lineage_key: String,
    /// Where the results go, a path that names their lineage.
    out: PathBuf,
}

impl Task {
    fn new(archive: &Path, asked: &Asked) -> Result<Self> {
        let reader = Reader::open(archive)?;
        ensure!(!reader.is_results(), "it has only results: name the archive that they are from");
        let old = Config::parse(reader.config()).context("its configuration is not one of this program")?;
        let was = old.fuse.reference.clone();
        let mut config = match &asked.config {
            None => old,
            Some(new) => {
                // How taps were taken cannot change, only how they are read and judged. Without another reference they
                // are compared with the same one as before.
                let reference = new.fuse.reference.clone().or(old.fuse.reference);
                Config { process: new.process, fuse: FuseConfig { reference, ..new.fuse.clone() }, ..old }
            }
        };
        if asked.reference.is_some() {
            config.fuse.reference.clone_from(&asked.reference);
        }
        let reference = match (&config.fuse.reference, reader.reference()) {
            (Some(_), _) if asked.reference.is_some() => asked.text.clone(),
            // Its own reference is in the archive, wherever the file is today.
            (Some(Reference::File(_)), Some(text)) if config.fuse.reference == was => Some(text.to_owned()),
            (Some(Reference::File(path)), _) => Some(ReferenceFile::read(path)?.text),
            (Some(_), _) => None,
            (None, _) => {
                bail!("no reference is named: give --reference FILE.json, TYRE/SHOULDER, or self, as for tapline run")
            }
        };
        let config_toml = toml::to_string(&config).context("the configuration does not fit TOML")?;
        let (made_by, raw_digest) = (made_by(&config)?, reader.raw_digest()?);
        let lineage_key = lineage_key(&raw_digest, &made_by, reference.as_deref());
        let out = results_path(archive, &lineage_key);
        Ok(Self { reader, config, config_toml, made_by, reference, raw_digest, lineage_key, out })
    }

    /// The fusion of this archive's taps.
    fn fusion(&self, asked: &Asked) -> Result<Fusion> {
        let kept = || asked.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let set = self.reference.as_deref().map(|text| kept().of_text(text)).transpose()?;
        let Config { fuse, process, .. } = &self.config;
        Fusions::new(fuse.clone(), *process, set).check(self.reader.plan())
    }
}

/// The results of an archive.
struct Results {
    path: PathBuf,
    lineage_key: String,
    made: Made,
}

/// What was made.
struct Made {
    /// Whether every tap is settled, and every shoulder judged.
    is_complete: bool,
    /// Whether the other verbs will take it.
    is_newest: bool,
    /// How many taps had no results before.
    tap_count: usize,
    is_from_samples: bool,
}

fn again(archive: &Path, asked: &Asked) -> Result<Results> {
    let task = Task::new(archive, asked)?;
    note_folder(&task.out);
    let made = make_once(&task, asked)?;
    Ok(Results { path: task.out, lineage_key: task.lineage_key, made })
}

/// Makes the results of `task`, unless they are there. If another process is making them they are waited for.
fn make_once(task: &Task, asked: &Asked) -> Result<Made> {
    let begin = Instant::now();
    loop {
        if let Some(made) = made_before(task)? {
            return Ok(made);
        }
        match make(task, asked) {
            Err(error) if is_made_elsewhere(&error) && begin.elapsed() < WAITED_MAX => {
                tracing::info!("{error:#}; it is waited for");
                sleep(WAIT);
            }
            made => return made,
        }
    }
}

/// Whether `error` says that another process has made the same results meanwhile, or is making them.
fn is_made_elsewhere(error: &anyhow::Error) -> bool {
    let is_locked = |cause: &std::io::Error| cause.kind() == ErrorKind::WouldBlock;
    matches!(error.downcast_ref(), Some(Error::Exists { .. } | Error::Finished { .. } | Error::InUse { .. }))
        || error.chain().filter_map(|cause| cause.downcast_ref()).any(is_locked)
}

/// The results of `task`, if they are finished already. They become the newest again, which the other verbs take.
fn made_before(task: &Task) -> Result<Option<Made>> {
    let results = match Reader::open(&task.out) {
        Ok(results) => results,
        // It is being made, or will be made again.
        Err(Error::NotFinished { .. } | Error::InUse { .. } | Error::Damaged { .. } | Error::NotHdf5 { .. }) => {
            return Ok(None);
        }
        Err(_) if !task.out.exists() => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    ensure!(
        results.is_results() && results.lineage_key()? == task.lineage_key,
        "{} is there already, and has something else",
        task.out.display()
    );
    let now = Timestamps { last_access: OMIT, last_modification: NOW };
    let touched = File::open(&task.out).and_then(|file| Ok(futimens(file, &now)?));
    if let Err(error) = &touched {
        tracing::error!("{}: cannot be made the newest results: {error}", task.out.display());
    }
    Ok(Some(Made {
        is_complete: is_complete(&results),
        is_newest: touched.is_ok(),
        tap_count: 0,
        is_from_samples: false,
    }))
}

/// Makes the results of `task`.
fn make(task: &Task, asked: &Asked) -> Result<Made> {
    let (reader, plan) = (&task.reader, task.reader.plan());
    // Before the file is made, so that a plan that cannot be judged leaves none.
    let mut fusion = task.fusion(asked)?;
    let lineage = Lineage {
        config_toml: &task.config_toml,
        reference: task.reference.as_deref(),
        made_by: &task.made_by,
        ..task.config_toml.as_str().into()
    };
    let mut writer = Writer::results(&task.out, (reader.path(), task.raw_digest), plan, lineage)?;
    let is_new = settled(&writer) == 0;
    let made = fill(task, asked, &mut writer, &mut fusion).and_then(|made| {
        writer.finish()?;
        Ok(made)
    });
    if is_new && made.is_err() {
        // Of an archive that cannot be read to its end nobody could finish the results, which the other verbs would stumble over.
        drop(fs::remove_file(&task.out));
    }
    made
}

/// Fills `writer` with the results of `task`.
fn fill(task: &Task, asked: &Asked, writer: &mut Writer, fusion: &mut Fusion) -> Result<Made> {
    let reader = &task.reader;
    let settled_before = settled(writer);
    let is_old = of_discriminators(reader.made_by()) == of_discriminators(&task.made_by) && !asked.from_samples;
    let how = if is_old { "from its discriminators" } else { "from its samples" };
    tracing::info!("judging {} again {how}, into {}", reader.path().display(), task.out.display());
    refuse(reader, writer)?;
    if is_old {
        for found in reader.discriminators()?.into_iter().flatten() {
            put(writer, &found)?;
        }
    } else {
        extract(&reader.taps()?, &task.config.process, writer, asked.jobs)?;
    }
    judge(reader, writer, fusion)?;
    Ok(Made {
        is_complete: writer.is_complete(),
        is_newest: true,
        tap_count: settled(writer) - settled_before,
        is_from_samples: !is_old,
    })
}

/// Prints where the results of an archive are.
fn print(args: &ReprocessArgs, archive: &Path, results: &Results) -> Result<()> {
    let out = results.path.display().to_string();
    let text = match args.json {
        true => json!({
            "archive": archive.display().to_string(), "results": out, "lineage": results.lineage_key,
            "is_complete": results.made.is_complete,
        })
        .to_string(),
        false => out,
    };
    Ok(writeln!(Stdout, "{text}")?)
}

/// Whether every tap of finished results is settled, and every shoulder judged.
fn is_complete(results: &Reader) -> bool {
    let ledger = results.ledger();
    ledger.is_judged() && ledger.count(TapState::Missing) == 0
}

fn settled(writer: &Writer) -> usize {
    let ledger = writer.ledger();
    ledger.taps().len() - ledger.count(TapState::Missing)
}

/// Copies the taps without a recording, with their reasons.
fn refuse(reader: &Reader, writer: &mut Writer) -> Result<()> {
    for refusal in reader.refusals()? {
        writer.put_refusal(refusal.plan_index, &refusal.id, &refusal.reason)?;
    }
    Ok(())
}

/// Extracts the discriminators of all taps that are not settled, on `jobs` threads, and puts them into `writer`.
fn extract(taps: &Taps, config: &ProcessConfig, writer: &mut Writer, jobs: usize) -> Result<()> {
    let to_do: Vec<u32> =
        (0..).zip(writer.ledger().taps()).filter(|(_, s)| **s == TapState::Missing).map(|(k, _)| k).collect();
    // Samples that are not analysed need not be unpacked.
    let used = |header: &TapHeader| config.samples_looked_at(header.sample_count, header.sample_rate_hz);
    let tools = || Ok((ProcessExtractor::new(config)?, ReadBuffer::default()));
    let extract = |(extractor, room): &mut (ProcessExtractor, ReadBuffer), rows: &&[u32]| {
        let mut found = Vec::with_capacity(rows.len());
        for &row in *rows {
            if let Some((header, samples)) = taps.read_beginning(row, used, room)? {
                found.push(extractor.extract(&header, samples));
            }
        }
        anyhow::Ok(found)
    };
    let batches: Vec<&[u32]> = to_do.chunks(TAPS_AT_A_TIME).collect();
    let mut unflushed = 0;
    each(&batches, jobs, tools, extract, |_, found| {
        for found in found? {
            put(writer, &found)?;
            unflushed += 1;
        }
        if unflushed >= FLUSH_TAPS {
            writer.flush()?;
            unflushed = 0;
        }
        Ok(())
    })?;
    Ok(writer.flush()?)
}

/// Puts the discriminators of a tap into the results, which must not have others for it.
fn put(writer: &mut Writer, found: &Discriminators) -> Result<()> {
    let outcome = writer.put_discriminators(found)?;
    ensure!(outcome != PutOutcome::Conflict, "the same lineage already has other values of {}", found.id);
    Ok(())
}

/// Judges the scans that had ended when the taps were taken.
fn judge(reader: &Reader, writer: &mut Writer, fusion: &mut Fusion) -> Result<()> {
    writer.flush()?;
    let mut from = Some(0);
    while let Some(row) = from {
        let (records, next) = writer.settled_from(row, usize::MAX)?;
        for record in &records {
            fusion.push(record)?;
        }
        from = next;
    }
    let ended = reader.ledger().scans().iter().map(|&state| state != ScanState::Open);
    let scans: Vec<u32> = (0..).zip(ended).filter(|(_, has_ended)| *has_ended).map(|(scan, _)| scan).collect();
    for &scan in &scans {
        fusion.end(scan as usize)?;
        writer.end_scan(scan)?;
    }
    for &scan in &scans {
        let (judgement, cells) = fusion.judge(scan as usize)?;
        let outcome = writer.put_judgement(scan, &judgement, &cells)?;
        ensure!(outcome != PutOutcome::Conflict, "scan {scan} was judged differently before, with the same lineage");
    }
    Ok(writer.flush()?)
}
