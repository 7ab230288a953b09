//! The files of a run that may take several: their names, their order, and which of them has which scan.
//!
//! They lie in a folder of the run's own. Each is an archive in itself, of some of the scans. The first plans all of them; every
//! later one plans scans that were not begun when it was. A scan is in the last file that plans it.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use tapline_wire::{Plan, Serial};

use crate::archive::{Access, Archive};
use crate::context::Context;
use crate::{Error, Part, Result};

/// Digits of a part's number in its name, at least: files are then in order for whoever lists them.
const DIGITS: usize = 4;

/// Most digits of a number: what is longer begins the name of results.
const DIGITS_MAX: usize = 9;

/// The name of file `number` of the run in `folder`.
pub(crate) fn part_path(folder: &Path, number: u32) -> PathBuf {
    let named = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let stem = named.file_name().unwrap_or_default().to_string_lossy();
    folder.join(format!("{stem}.{number:0DIGITS$}.h5"))
}

/// The files of the run in `folder`, in their order; empty where there is none.
///
/// # Errors
/// [`Error::NotARun`] where one is missing before the last, or there twice.
pub(crate) fn part_paths(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).context("list", folder)? {
        let path = entry.context("list", folder)?.path();
        if let Some(number) = number_of(&path) {
            paths.push((number, path));
        }
    }
    paths.sort();
    for (number, (found, path)) in (1..).zip(&paths) {
        if *found != number {
            let what = match *found < number {
                true => format!("it has file {found} twice: {} is one of them", path.display()),
                false => format!("it has no file {number}, but {}", path.display()),
            };
            return Err(Error::NotARun { path: folder.to_owned(), what });
        }
    }
    Ok(paths.into_iter().map(|(_, path)| path).collect())
}

/// The number in a name `*.0001.h5`.
fn number_of(path: &Path) -> Option<u32> {
    let stem = path.file_name()?.to_str()?.strip_suffix(".h5")?;
    let (_, digits) = stem.rsplit_once('.')?;
    let is_number = (DIGITS..=DIGITS_MAX).contains(&digits.len()) && digits.bytes().all(|byte| byte.is_ascii_digit());
    if is_number { digits.parse().ok() } else { None }
}

/// Opens the archive at `path`, or all those of the run in the folder `path`, to be read.
pub(crate) fn open_all(path: &Path) -> Result<Vec<Archive>> {
    if !path.is_dir() {
        return Ok(vec![Archive::open(path, Access::Read)?]);
    }
    let paths = part_paths(path)?;
    if paths.is_empty() {
        return Err(Error::NotARun { path: path.to_owned(), what: "it has no file *.0001.h5".to_owned() });
    }
    let archives: Vec<Archive> = paths.iter().map(|path| Archive::open(path, Access::Read)).collect::<Result<_>>()?;
    check_parts(path, &archives)?;
    Ok(archives)
}

/// Checks that `archives` are, in this order, the files of one run.
fn check_parts(folder: &Path, archives: &[Archive]) -> Result<()> {
    let [first, ..] = archives else { return Ok(()) };
    for (number, archive) in (1..).zip(archives) {
        let expected = Part { number, run_digest: first.plan.digest() };
        if archive.part != Some(expected) {
            let what = match archive.part {
                None => format!("{} is no file of a run that may take several", archive.path.display()),
                Some(Part { number: said, .. }) if said != number => {
                    format!("{} says that it is file {said}", archive.path.display())
                }
                Some(_) => format!("{} is of another run than {}", archive.path.display(), first.path.display()),
            };
            return Err(Error::NotARun { path: folder.to_owned(), what });
        }
        archive.check_lineage(&first.config, first.reference.as_deref(), &first.made_by)?;
    }
    Ok(())
}

/// Which file has which scan and tap of a run.
#[derive(Debug, Default)]
pub(crate) struct PartMap {
    number_of: HashMap<(Serial, u16), u32>,
    /// By scan: its file, from 0, and its number there.
    scans: Vec<(usize, u32)>,
    /// By plan row, likewise.
    taps: Vec<(usize, u32)>,
    /// By file: the scans that it plans, by their numbers there, and likewise the taps.
    scans_of: Vec<Vec<u32>>,
    taps_of: Vec<Vec<u32>>,
}

impl PartMap {
    /// That of a run in one file, the first of those to come.
    pub(crate) fn of(run: &Plan) -> Self {
        let number_of = (0..).zip(run.scans()).map(|(number, scan)| ((scan.tyre, scan.shoulder), number)).collect();
        let scans: Vec<u32> = (0..).zip(run.scans()).map(|(number, _)| number).collect();
        let taps: Vec<u32> = (0..).zip(run.taps()).map(|(row, _)| row).collect();
        let in_first = |numbers: &[u32]| numbers.iter().map(|&number| (0, number)).collect();
        Self { number_of, scans: in_first(&scans), taps: in_first(&taps), scans_of: vec![scans], taps_of: vec![taps] }
    }

    /// That of the run whose files are `archives`.
    pub(crate) fn of_all(archives: &[Archive]) -> Result<Self> {
        let [first, later @ ..] = archives else { return Ok(Self::default()) };
        let mut map = Self::of(&first.plan);
        for archive in later {
            if !map.add(&first.plan, &archive.plan) {
                return Err(archive.damaged("it plans what its run does not"));
            }
        }
        Ok(map)
    }

    /// Adds the next file, which has the scans of `part`; false, and nothing is added, where `run` has not all of them.
    pub(crate) fn add(&mut self, run: &Plan, part: &Plan) -> bool {
        let (mut scans_of, mut taps_of) = (Vec::new(), vec![0; part.taps().len()]);
        for scan in part.scans() {
            let Some(&number) = self.number_of.get(&(scan.tyre, scan.shoulder)) else { return false };
            let whole = &run.scans()[number as usize];
            let tap = |plan: &Plan, row: u32| plan.taps()[row as usize];
            let are_same = whole.taps.len() == scan.taps.len()
                && whole.taps.iter().zip(&scan.taps).all(|(&a, &b)| tap(run, a).id == tap(part, b).id);
            if !are_same {
                return false;
            }
            scans_of.push(number);
            scan.taps.iter().zip(&whole.taps).for_each(|(&there, &row)| taps_of[there as usize] = row);
        }
        let part = self.scans_of.len();
        (0..).zip(&scans_of).for_each(|(there, &number)| self.scans[number as usize] = (part, there));
        (0..).zip(&taps_of).for_each(|(there, &row)| self.taps[row as usize] = (part, there));
        self.scans_of.push(scans_of);
        self.taps_of.push(taps_of);
        true
    }

    /// The file that has scan `scan`, from 0, and its number there.
    pub(crate) fn scan(&self, scan: u32) -> (usize, u32) {
        self.scans[scan as usize]
    }

    /// The file that has the tap of plan row `row`, from 0, and its row there.
    pub(crate) fn tap(&self, row: u32) -> (usize, u32) {
        self.taps[row as usize]
    }

    /// The same; `None` where there is no such row.
    pub(crate) fn tap_if_any(&self, row: u32) -> Option<(usize, u32)> {
        self.taps.get(row as usize).copied()
    }

    /// The scans that file `part` plans, whether it has them or a later one, with their numbers there.
    pub(crate) fn planned_in(&self, part: usize) -> impl Iterator<Item = (u32, u32)> {
        self.scans_of[part].iter().zip(0..).map(|(&scan, there)| (scan, there))
    }

    /// The scans that file `part` has, with their numbers there.
    pub(crate) fn scans_in(&self, part: usize) -> impl Iterator<Item = (u32, u32)> {
        self.planned_in(part).filter(move |&(scan, _)| self.scan(scan).0 == part)
    }

    /// The plan rows of the taps that file `part` has, with their rows there.
    pub(crate) fn taps_in(&self, part: usize) -> impl Iterator<Item = (u32, u32)> {
        let all = self.taps_of[part].iter().zip(0..);
        all.filter(move |&(&row, _)| self.tap(row).0 == part).map(|(&row, there)| (row, there))
    }
}
