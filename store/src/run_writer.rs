//! Writes the archive of a run: one file, or a folder of files of which each takes the scans that are begun while it is the last.
//!
//! A file that has reached its size or age takes no new scan; the next scan that is begun begins a new one. Scans that were
//! begun go on where they are, and a file none of whose scans is under way any more is closed, while the run goes on.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tapline_wire::{Ledger, Plan, TapId};

use crate::archive::{Access, Archive};
use crate::check::check_id;
use crate::context::Context;
use crate::draft::folder_of;
use crate::parts::{PartMap, part_path, part_paths};
use crate::{Codec, Error, Lineage, Part, PutCounts, Reader, Result, StoreConfig, Writer};

/// Bytes of what the system counts as a block.
const BLOCK_BYTES: u64 = 512;

/// A file is given so many times as much to plan as fits into it unpacked: packed, that much more may fit.
const PACKED_AT_MOST: u64 = 4;

/// Or, where only its age ends a file, so many times the scans that the last one took.
const GROWS_AT_MOST: usize = 8;

/// Writes the archive of a run, in one file or several.
///
/// Its functions are those of [`Writer`], by the rows and scans of the plan of the whole run.
#[derive(Debug)]
pub struct RunWriter {
    pub(crate) path: PathBuf,
    pub(crate) plan: Plan,
    scan_of_tap: Vec<u32>,
    rotation: StoreConfig,
    /// What a new file is begun with, as that of the first was.
    begin: Begin,
    pub(crate) writers: Vec<Writer>,
    pub(crate) map: PartMap,
    /// By scan: whether anything of it has come.
    is_begun: Vec<bool>,
    pub(crate) ledger: Ledger,
    /// Since when the last file is written here, and how long it was before, as far as the file system says.
    last_since: Instant,
    age_before: Duration,
    /// The closed file that is told of again, while it is.
    pub(crate) told_again: Option<(usize, Archive)>,
    /// Scan for which a new file could not be begun yet.
    pub(crate) waits_for_file: Option<u32>,
}

#[derive(Debug)]
struct Begin {
    config_toml: String,
    reference: Option<String>,
    made_by: String,
    codec: Codec,
}

impl RunWriter {
    /// Goes on with the archive of `plan` at `path` or, where there is none, begins it: a file, or a folder of files where
    /// `config` says when one is full.
    ///
    /// # Errors
    /// As [`Writer::create`] and [`Writer::resume`]; [`Error::NotARun`] where `path` is a folder of something else.
    pub fn open_or_create(path: &Path, plan: &Plan, lineage: Lineage<'_>, config: &StoreConfig) -> Result<Self> {
        let is_begun = Self::is_begun(path, config)?;
        if !config.rotates() {
            return Ok(Self::of(path, plan, lineage, *config, vec![Writer::open_or_create(path, plan, lineage)?]));
        }
        fs::create_dir_all(path).context("create", path)?;
        let lineage = part_of(plan, 1, lineage);
        if !is_begun {
            let first = Writer::create(part_path(path, 1), plan, lineage)?;
            return Ok(Self::of(path, plan, lineage, *config, vec![first]));
        }
        let paths = part_paths(path)?;
        let (first, later) = paths.split_at(1);
        let mut this = Self::of(path, plan, lineage, *config, vec![resume(&first[0], lineage, later.is_empty())?]);
        if this.writers[0].plan() != plan {
            return Err(not_a_run(path, "its first file has another plan than the run"));
        }
        for (number, path) in (2..).zip(later) {
            this.add(resume(path, part_of(plan, number, lineage), number as usize == paths.len())?)?;
        }
        this.go_on();
        Ok(this)
    }

    /// Whether there is a run at `path` to go on with: a file, or files in a folder, as `config` has it.
    ///
    /// # Errors
    /// [`Error::NotARun`] where there is a folder for a run of one file, or a file for one of several.
    pub fn is_begun(path: &Path, config: &StoreConfig) -> Result<bool> {
        match (config.rotates(), path.is_dir()) {
            (false, true) => Err(not_a_run(path, "a run of one file was asked for: see [store] rotate_after_mb")),
            (true, false) if path.exists() => Err(not_a_run(path, "it is a file, and this run takes several")),
            (true, true) => Ok(!part_paths(path)?.is_empty()),
            (_, false) => path.try_exists().context("look for", path),
        }
    }

    /// The results of the taps of `reader` at `path`, begun or gone on with: a file, or a folder of one for each of its files.
    ///
    /// # Errors
    /// As [`Writer::create`] and [`Writer::resume`].
    pub fn of_results(path: &Path, reader: &Reader, lineage: Lineage<'_>) -> Result<Self> {
        let raw = reader.raw_digests()?;
        let is_folder = reader.path().is_dir();
        let open = |archive: &Archive, digest| {
            let raw = Some((archive.path.as_path(), digest));
            if !is_folder {
                return Writer::open_or_create(path, &archive.plan, Lineage { raw, ..lineage });
            }
            let path = path.join(archive.path.file_name().unwrap_or_default());
            Writer::open_or_create(path, &archive.plan, Lineage { raw, part: archive.part, ..lineage })
        };
        if is_folder {
            fs::create_dir_all(path).context("create", path)?;
        }
        let (first, plan) = (open(reader.first(), raw[0])?, reader.plan());
        let mut this = Self::of(path, plan, lineage, StoreConfig::default(), vec![first]);
        for (archive, &digest) in reader.archives().iter().zip(&raw).skip(1) {
            this.add(open(archive, digest)?)?;
        }
        // What a file leaves to later ones, its results do too.
        for (part, writer) in this.writers.iter_mut().enumerate() {
            let later = this.map.planned_in(part).filter(|&(_, there)| reader.is_later(part, there));
            later.for_each(|(_, there)| writer.hand_over(there));
        }
        this.is_begun.fill(true);
        this.note_states();
        Ok(this)
    }

    fn of(path: &Path, plan: &Plan, lineage: Lineage<'_>, rotation: StoreConfig, writers: Vec<Writer>) -> Self {
        let mut this = Self {
            path: path.to_owned(),
            plan: plan.clone(),
            scan_of_tap: plan.scan_of_tap(),
            rotation,
            begin: Begin {
                config_toml: lineage.config_toml.to_owned(),
                reference: lineage.reference.map(str::to_owned),
                made_by: lineage.made_by.to_owned(),
                codec: lineage.codec,
            },
            map: PartMap::of(plan),
            is_begun: vec![false; plan.scans().len()],
            ledger: Ledger::empty(plan.taps().len(), plan.scans().len(), plan.stations().len()),
            last_since: Instant::now(),
            age_before: Duration::ZERO,
            told_again: None,
            waits_for_file: None,
            writers,
        };
        this.note_states();
        this
    }

    /// Adds the next file of the run.
    fn add(&mut self, writer: Writer) -> Result<()> {
        if !self.map.add(&self.plan, writer.plan()) {
            return Err(not_a_run(&self.path, format!("file {} plans what the run does not", self.number())));
        }
        self.writers.push(writer);
        Ok(())
    }

    /// Number of the next file that is added.
    fn number(&self) -> u32 {
        u32::try_from(self.writers.len() + 1).unwrap_or(u32::MAX)
    }

    /// Takes up what an earlier writer of the same run left.
    fn go_on(&mut self) {
        for part in 0..self.writers.len() {
            for (scan, there) in self.map.scans_in(part) {
                self.is_begun[scan as usize] = self.writers[part].is_begun(there);
            }
        }
        self.hand_over();
        self.note_states();
        // Not by the time of day, which may jump.
        let last = self.writers.last().and_then(|writer| fs::metadata(&writer.path).ok());
        let used = last.and_then(|file| file.modified().ok()?.duration_since(file.created().ok()?).ok());
        (self.last_since, self.age_before) = (Instant::now(), used.unwrap_or_default());
    }

    /// Has every file but the last leave to later ones the scans that are not begun.
    fn hand_over(&mut self) {
        let (Some((_, earlier)), map) = (self.writers.split_last_mut(), &self.map) else { return };
        for (part, writer) in earlier.iter_mut().enumerate() {
            let is_here = |scan: u32| map.scan(scan).0 == part && self.is_begun[scan as usize];
            map.planned_in(part).filter(|&(scan, _)| !is_here(scan)).for_each(|(_, there)| writer.hand_over(there));
        }
    }

    /// Takes the states of the files, as of their last flushes, into those of the run.
    pub(crate) fn note_states(&mut self) {
        for (part, writer) in self.writers.iter().enumerate() {
            for (row, there) in self.map.taps_in(part) {
                let (state, attempt) =
                    (writer.ledger().taps()[there as usize], writer.ledger().attempt(there as usize));
                self.ledger.set_tap(row as usize, state, attempt);
            }
            for (scan, there) in self.map.scans_in(part) {
                self.ledger.set_scan(scan as usize, writer.ledger().scans()[there as usize]);
            }
        }
    }

    /// The file that takes what belongs to scan `scan`, and the scan's number there.
    pub(crate) fn part_of_scan(&mut self, scan: u32) -> Result<(usize, u32)> {
        if !self.is_begun[scan as usize] {
            let last = self.writers.len() - 1;
            if self.rotation.rotates() && (self.map.scan(scan).0 != last || self.is_full()?) {
                self.rotate(scan)?;
            }
            self.is_begun[scan as usize] = true;
        }
        Ok(self.map.scan(scan))
    }

    pub(crate) fn part_of_tap(&mut self, plan_index: u32, id: &TapId) -> Result<(usize, u32)> {
        check_id(&self.plan, plan_index, id)?;
        self.part_of_scan(self.scan_of_tap[plan_index as usize])?;
        Ok(self.map.tap(plan_index))
    }

    /// Whether the last file takes no new scan. One in which nothing was begun is never full.
    fn is_full(&self) -> Result<bool> {
        let last = self.writers.len() - 1;
        if !self.map.scans_in(last).any(|(scan, _)| self.is_begun[scan as usize]) {
            return Ok(false);
        }
        let path = &self.writers[last].path;
        let file = fs::metadata(path).context("look for", path)?;
        // What is allotted: without a codec a file has its full length from the start.
        let (bytes, after) = (file.blocks() * BLOCK_BYTES, Duration::from_secs(self.rotation.rotate_after_s.into()));
        let is_large = self.rotation.rotate_after_mb > 0 && bytes >= self.bytes_max();
        let age = self.age_before + self.last_since.elapsed();
        let is_old = self.rotation.rotate_after_s > 0 && age >= after;
        Ok(is_large || is_old)
    }

    fn bytes_max(&self) -> u64 {
        u64::from(self.rotation.rotate_after_mb) * 1_000_000
    }

    /// Begins a new file, in which `first` is planned with others that are not begun.
    pub(crate) fn rotate(&mut self, first: u32) -> Result<()> {
        self.waits_for_file = Some(first);
        let plan =
            self.plan.subset(&self.next_scans(first)).map_err(|error| not_a_run(&self.path, error.to_string()))?;
        let &Begin { ref config_toml, ref reference, ref made_by, codec } = &self.begin;
        let lineage = Lineage { reference: reference.as_deref(), made_by, codec, ..config_toml.as_str().into() };
        let path = part_path(&self.path, self.number());
        // It may have been begun and then not opened.
        let writer = Writer::open_or_create(&path, &plan, part_of(&self.plan, self.number(), lineage))?;
        tracing::info!("{} is begun, for {} scans", path.display(), plan.scans().len());
        self.add(writer)?;
        self.hand_over();
        (self.last_since, self.age_before) = (Instant::now(), Duration::ZERO);
        self.waits_for_file = None;
        Ok(())
    }

    /// `first`, and others that are not begun: each station's next, then each one's next but one, and so on.
    fn next_scans(&self, first: u32) -> Vec<u32> {
        let mut taken_of = BTreeMap::<u16, usize>::new();
        let mut ranked = Vec::new();
        for (scan, planned) in (0..).zip(self.plan.scans()) {
            if !self.is_begun[scan as usize] {
                let turn = taken_of.entry(planned.station).or_default();
                ranked.push((scan != first, *turn, scan));
                *turn += 1;
            }
        }
        ranked.sort_unstable();
        let last = self.writers.len() - 1;
        let begun = self.map.scans_in(last).filter(|&(scan, _)| self.is_begun[scan as usize]).count();
        let (scans_max, bytes_max) = match self.bytes_max() {
            0 => ((GROWS_AT_MOST * begun).max(1), u64::MAX),
            bytes => (usize::MAX, PACKED_AT_MOST * bytes),
        };
        let tap_bytes = self.plan.recording.payload_bytes_max() as u64;
        let (mut scans, mut bytes) = (Vec::new(), 0);
        for (_, turn, scan) in ranked {
            // The next of every station is always there, or each would begin a file of its own.
            if turn > 0 && (scans.len() >= scans_max || bytes >= bytes_max) {
                break;
            }
            bytes += self.plan.scans()[scan as usize].taps.len() as u64 * tap_bytes;
            scans.push(scan);
        }
        scans
    }

    /// The plan of the run.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What no crash can take back: see [`Writer::ledger`].
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// What became of the records given so far.
    pub fn counts(&self) -> PutCounts {
        let mut sum = PutCounts::default();
        for counts in self.writers.iter().map(Writer::counts) {
            sum.stored += counts.stored;
            sum.already_there += counts.already_there;
            sum.conflicts += counts.conflicts;
        }
        sum
    }

    /// The file of the run, or the folder of its files.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Goes on with one file of a run. One that is done and not the last is not opened to be written, so that it may be read.
fn resume(path: &Path, lineage: Lineage<'_>, is_last: bool) -> Result<Writer> {
    let archive = Archive::open(path, Access::Read)?;
    archive.check_same(&archive.plan, lineage)?;
    if archive.part != lineage.part {
        return Err(not_a_run(
            folder_of(path),
            format!("{} is another of its files, or of another run", path.display()),
        ));
    }
    let plan = archive.plan.clone();
    if !is_last && !archive.stored_key()?.is_empty() {
        // Where rows are torn it has some to write.
        let mut writer = Writer::of(archive)?;
        if writer.is_judged() && writer.pending.is_empty() {
            writer.rest();
            return Ok(writer);
        }
    } else {
        drop(archive);
    }
    Writer::resume(path, &plan, lineage)
}

fn part_of<'a>(run: &Plan, number: u32, lineage: Lineage<'a>) -> Lineage<'a> {
    Lineage { part: Some(Part { number, run_digest: run.digest() }), ..lineage }
}

fn not_a_run(path: &Path, what: impl Into<String>) -> Error {
    Error::NotARun { path: path.to_owned(), what: what.into() }
}
