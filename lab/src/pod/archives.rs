//! The shoulders of all finished archives of some folders.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use tapline_host::progress::{Progress, Unit};
use tapline_store::{Folder, Judged, Reader, archive_of};
use tapline_wire::{DamageCell, Geometry, Judgement, Scan};

use super::truth::{Crack, Extent, Inspected, KnownTruth, Shoulder};
use crate::shoulder_result::ShoulderResult;

/// One shoulder as it was scanned and judged once.
#[derive(Debug, Clone)]
pub(super) struct Scanned {
    /// Path of the archive, within the folder if there is only one.
    pub archive: String,
    pub station: u16,
    /// When it was first tapped, in ns since the Unix epoch; `None` if no tap has a time.
    pub tapped_ns: Option<i64>,
    /// Distinguishes recordings; `None` without a tap.
    pub recording: Option<[u8; 32]>,
    pub extent: Extent,
    /// Numbers of the locations of the map.
    pub locations: Vec<u32>,
    /// How far the strongest arc of each location's region stands out; NaN outside of regions.
    pub region_index: Vec<f64>,
    pub judgement: Judgement,
    /// The result; its truth is filled in later.
    pub result: ShoulderResult,
    /// What the archive itself knows of cracks.
    pub known: Option<Vec<Crack>>,
}

/// Scans of some folders.
#[derive(Debug, Default)]
pub(super) struct Scans {
    /// By casing and shoulder, the first scan first, those of unknown time last.
    pub of_shoulder: BTreeMap<Shoulder, Vec<Scanned>>,
    /// Archives, or with `--results` files of new results.
    pub archive_count: usize,
    /// With `--results`, the remarks on archives that have none, and on results that were not all made alike.
    pub remarks: Vec<String>,
    /// Shoulders of archives that have no results.
    pub without_results: BTreeSet<Shoulder>,
    /// Archives that could not be read, each with the reason.
    pub unreadable: Vec<String>,
    /// Scans without a verdict.
    pub unjudged_count: usize,
    /// Scans of the same recording as another.
    pub copy_count: usize,
    /// The first shoulder of which two archives know different cracks.
    pub contradiction: Option<String>,
}

impl Scanned {
    /// Its casing and side.
    pub(super) fn shoulder(&self) -> Shoulder {
        (self.result.tyre.clone(), self.result.shoulder, None)
    }

    /// The places of its map that lie on `crack`.
    pub(super) fn places_of(&self, crack: &Crack) -> impl Iterator<Item = usize> {
        (0..self.locations.len()).filter(|&place| crack.covers(self.extent, self.locations[place]))
    }
}

impl Scans {
    /// Reads the finished archives of `folders` and their subfolders, or instead of them the newest results of each.
    ///
    /// # Errors
    /// A folder that cannot be read, or that there is no readable archive or results in any.
    pub(super) fn read(folders: &[PathBuf], is_results: bool) -> Result<Self> {
        // One folder may lie within another.
        let mut finished = BTreeSet::new();
        for folder in folders {
            finished.extend(Folder::list(folder)?.finished);
        }
        let here = Folder { finished: finished.into_iter().collect(), ..Folder::default() };
        let named: Vec<&OsStr> = folders.iter().map(|folder| folder.as_os_str()).collect();
        let folder = PathBuf::from(named.join(OsStr::new(" ")));
        let folder = folder.as_path();
        let mut scans = Self::default();
        let files = if is_results {
            let sorted = here.sorted();
            scans.remarks =
                [sorted.without_results(folder), sorted.mixed_results(folder)].into_iter().flatten().collect();
            let with: BTreeSet<&PathBuf> = sorted.results.iter().map(|results| &results.archive).collect();
            for archive in sorted.archives.iter().filter(|archive| !with.contains(archive)) {
                match Reader::open(archive) {
                    Ok(reader) => {
                        let shoulders = reader.plan().scans().iter();
                        scans
                            .without_results
                            .extend(shoulders.map(|scan| (scan.tyre.to_string(), scan.shoulder, None)));
                    }
                    Err(error) => scans.unreadable.push(error.to_string()),
                }
            }
            sorted.newest_results()
        } else {
            without_named_results(here.finished)
        };
        let what = if is_results { "results of tapline reprocess" } else { "finished archive (NAME.h5)" };
        ensure!(!files.is_empty(), "{} has no {what}", folder.display());
        scans.archive_count = files.len();
        let mut progress = Progress::new(Some(files.len() as u64), Unit::Things("archives"));
        let mut failed = Vec::new();
        for (path, done) in files.iter().zip(0..) {
            progress.update(done);
            let name = path.strip_prefix(folder).unwrap_or(path).display().to_string();
            if let Err(error) = scans.add(path, &name) {
                failed.push(format!("{error:#}"));
            }
        }
        if let Some(first) = failed.first() {
            ensure!(failed.len() < files.len(), "none of {} archives can be read: {first}", files.len());
        }
        scans.unreadable.append(&mut failed);
        for ((tyre, side, _), shoulder) in &mut scans.of_shoulder {
            // For each location whether it is cracked, and the first archive that knows.
            let mut stated: BTreeMap<u32, (bool, &str)> = BTreeMap::new();
            for scan in shoulder.iter() {
                let Some(cracks) = &scan.known else { continue };
                for &location in &scan.locations {
                    let is_cracked = cracks.iter().any(|crack| crack.covers(scan.extent, location));
                    let (known, first) = *stated.entry(location).or_insert((is_cracked, &scan.archive));
                    if known != is_cracked && scans.contradiction.is_none() {
                        scans.contradiction = Some(format!(
                            "location {location} of tyre {tyre} shoulder {side} is cracked in {first} or in {}, and sound in \
                             the other: they are of two casings with one name, or of one at two times",
                            scan.archive
                        ));
                    }
                }
            }
            let when = |scan: &Scanned| scan.tapped_ns.unwrap_or(i64::MAX);
            shoulder.sort_by(|a, b| (when(a), &a.archive).cmp(&(when(b), &b.archive)));
            // A copy is not a second scan.
            let before = shoulder.len();
            let mut seen = Vec::new();
            shoulder.retain(|scan| {
                let is_copy = scan.recording.is_some() && seen.contains(&scan.recording);
                seen.push(scan.recording);
                !is_copy
            });
            scans.copy_count += before - shoulder.len();
        }
        Ok(scans)
    }

    fn add(&mut self, path: &Path, name: &str) -> Result<()> {
        let reader = Reader::open(path)?;
        let times = reader.headers()?;
        let recording = if times.iter().flatten().next().is_some() { Some(reader.raw_digest()?) } else { None };
        for (scan, judged) in reader.plan().scans().iter().zip(reader.judgements()?) {
            let Some(judged) = judged else {
                self.unjudged_count += 1;
                continue;
            };
            let tapped = scan.taps.iter().filter_map(|&row| times[row as usize].as_ref());
            let scanned = Scanned {
                archive: name.to_owned(),
                tapped_ns: tapped.map(|header| header.tap_time_ns).filter(|&ns| ns > 0).min(),
                recording,
                ..scanned(&reader, scan, &judged).with_context(|| path.display().to_string())?
            };
            self.of_shoulder.entry(scanned.shoulder()).or_default().push(scanned);
        }
        Ok(())
    }

    /// Whether `shoulder` may have been scanned in an archive that was left out.
    pub(super) fn may_be_left_out(&self, shoulder: &Shoulder) -> bool {
        let (tyre, side, _) = shoulder.clone();
        !self.unreadable.is_empty() || self.without_results.contains(&(tyre, side, None))
    }

    /// Makes a shoulder whose truth changes several ones: each has the scans from a day of its truth on, until the next.
    pub(super) fn split(&mut self, truth: &KnownTruth) {
        for ((tyre, side, _), scans) in std::mem::take(&mut self.of_shoulder) {
            for scan in scans {
                let tapped = scan.tapped_ns.and_then(|ns| Timestamp::from_nanosecond(ns.into()).ok());
                let day = truth.day_of(&tyre, side, tapped.map(|at| at.to_zoned(TimeZone::UTC).date()));
                self.of_shoulder.entry((tyre.clone(), side, day)).or_default().push(scan);
            }
        }
    }

    /// Where the locations of each shoulder lie.
    pub(super) fn extents(&self) -> BTreeMap<Shoulder, Extent> {
        let first = |(shoulder, scans): (&Shoulder, &Vec<Scanned>)| Some((shoulder.clone(), scans.first()?.extent));
        self.of_shoulder.iter().filter_map(first).collect()
    }

    /// The truth in the archives; shoulders whose truth is not known at every location are left out.
    pub(super) fn truth(&self) -> KnownTruth {
        let known = self.of_shoulder.iter().filter_map(|(shoulder, scans)| {
            let cracks = scans.first()?.known.clone()?;
            Some((shoulder.clone(), Inspected::of_archive(cracks)))
        });
        KnownTruth { shoulders: known.collect(), ..KnownTruth::default() }
    }
}

/// Those of `files` that are not named like results of another of them. None is opened: results may outnumber archives, and to open
/// them reads their archives again.
fn without_named_results(files: Vec<PathBuf>) -> Vec<PathBuf> {
    let all: BTreeSet<PathBuf> = files.iter().cloned().collect();
    files.into_iter().filter(|file| archive_of(file).is_none_or(|archive| !all.contains(&archive))).collect()
}

fn scanned(reader: &Reader, scan: &Scan, judged: &Judged) -> Result<Scanned> {
    let (judgement, cells) = judged;
    let geometry = reader.plan().geometry;
    let locations: Vec<u32> = cells.iter().map(|cell| cell.location).collect();
    let (first, last) = locations.first().zip(locations.last()).context("a shoulder has no location")?;
    // If only part of a ring was tapped, the angles tell how many locations it has.
    let last = ring_count(cells).filter(|_| geometry == Geometry::Ring).map_or(*last, |count| first + count - 1);
    let extent = Extent { geometry, first: *first, last };
    let truth = |location: &u32| reader.truth().get(&(scan.tyre, scan.shoulder, *location)).copied();
    let known: Option<Vec<bool>> = locations.iter().map(truth).collect();
    Ok(Scanned {
        archive: String::new(),
        station: scan.station,
        tapped_ns: None,
        recording: None,
        extent,
        region_index: cells.iter().map(|cell| cell.region_index).collect(),
        judgement: *judgement,
        known: known.map(|known| cracks(extent, &locations, &known)),
        locations,
        result: ShoulderResult::new(scan, judged, vec![false; cells.len()])?,
    })
}

/// How many locations a ring has, from the angles of the first and the last that were tapped; `None` if they are not known, or
/// no ring has such angles.
fn ring_count(cells: &[DamageCell]) -> Option<u32> {
    let (first, last) = (cells.first()?, cells.last()?);
    let steps = last.location.checked_sub(first.location).filter(|&steps| steps > 0)?;
    let count = 360.0 * f64::from(steps) / (last.angle_deg - first.angle_deg);
    (count.is_finite() && count > f64::from(steps) && count < 1e6).then_some(count.round() as u32)
}

/// The runs of cracked locations; on a ring the last may continue at the first.
fn cracks(extent: Extent, locations: &[u32], is_cracked: &[bool]) -> Vec<Crack> {
    let count = is_cracked.len();
    let Some(sound) = is_cracked.iter().position(|is| !is) else {
        return vec![Crack::of_archive(extent.first, extent.count())];
    };
    // On a ring, start after a sound location: then no run crosses the end.
    let start = if extent.geometry == Geometry::Ring { sound } else { 0 };
    let order: Vec<usize> = (0..count).map(|k| (start + k) % count).collect();
    let runs = order.chunk_by(|&a, &b| is_cracked[a] == is_cracked[b]).filter(|run| is_cracked[run[0]]);
    let crack = |run: &[usize]| {
        let (first, last) = (locations[run[0]], locations[run[run.len() - 1]]);
        let ahead = if last >= first { last - first } else { extent.count() - (first - last) };
        Crack::of_archive(first, ahead + 1)
    };
    runs.map(crack).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a ring of which every second location was tapped that ends at the last of these.
    #[test]
    fn angles_tell_how_many_locations_a_ring_has() {
        let cell = |(location, angle_deg): (u32, f64)| DamageCell { location, angle_deg, ..DamageCell::default() };
        let of = |cells: &[(u32, f64)]| ring_count(&cells.iter().copied().map(cell).collect::<Vec<_>>());
        assert_eq!(of(&[(0, 0.0), (2, 7.2), (98, 352.8)]), Some(100));
        assert_eq!(of(&[(1, 5.0), (2, 8.6), (100, 361.4)]), Some(100));
        assert_eq!(
            (of(&[(0, f64::NAN), (9, f64::NAN)]), of(&[(0, 0.0)]), of(&[(0, 0.0), (9, 360.0)])),
            (None, None, None)
        );
    }

    /// Catches a crack over the seam that counts twice, one at the end of a line that goes on, and a ring without a sound
    /// location.
    #[test]
    fn runs_of_cracked_locations_are_cracks() {
        let of = |geometry, known: &str| -> Vec<(u32, u32)> {
            let is_cracked: Vec<bool> = known.chars().map(|c| c == 'x').collect();
            let locations: Vec<u32> = (1..).take(is_cracked.len()).collect();
            let extent = Extent { geometry, first: 1, last: is_cracked.len() as u32 };
            let cracks = cracks(extent, &locations, &is_cracked);
            cracks.iter().map(|c| (c.first_location, c.location_count)).collect()
        };
        assert_eq!(of(Geometry::Ring, "x..xx..x"), [(4, 2), (8, 2)]);
        assert_eq!(of(Geometry::Line, "x..xx..x"), [(1, 1), (4, 2), (8, 1)]);
        assert_eq!(of(Geometry::Ring, "xxx"), [(1, 3)]);
        assert_eq!(of(Geometry::Ring, "..."), []);
    }
}
