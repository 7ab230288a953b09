//! What happens when the file of a casing is closed: its verdict is handed to the wires, or printed, and shown.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::fs::{self, DirEntry, File};
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use tapline_host::atomic_file::{Existing, write_atomically};
use tapline_host::messages::counted;
use tapline_store::{Finished, LEFT_FOLDER, Places, Reader, Unreported, last_finished};
use tapline_wire::{CasingHeader, OVER, Quality, Reasons, Verdict, now_ns};

use crate::shown::casing::{CasingStatus, Layout, retaken};
use crate::shown::rig::ASKS;
use crate::shown::verdict::{CasingVerdict, calibration, since_last_tap_s};
use crate::shown::whole::Whole;

use super::{ROOM_MIN, SHOWN_MAX, Supervisor, station_of};

impl Supervisor<'_> {
    pub(super) fn closed(&mut self, header: &CasingHeader, path: PathBuf) {
        let number = header.stamp.casing;
        let station = station_of(header);
        let place = self.open.iter().position(|casing| casing.number == number && number != 0);
        let was_open = place.is_some();
        let name = match place {
            Some(place) => {
                let casing = self.open.remove(place);
                // One that lacks taps may have been taken off the rig. If it is still there, it is better scanned again.
                if casing.header.refused_count == 0 {
                    self.note_on_rig(station, &casing.name);
                }
                casing.name
            }
            // It was finished before this process started.
            None => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        };
        // Of a line that never ends, those without a number were judged from the same recordings before; their station has said so.
        let is_known = if self.is_list { !self.known.insert(path.clone()) } else { number == 0 };
        if is_known {
            return;
        }
        let unreported = Unreported { number, name, station, at_ns: now_ns(), file: path };
        let unreported = if self.is_list { Some(unreported) } else { self.note_of(unreported) };
        let Some(unreported) = unreported else { return };
        self.outcome.closed += 1;
        self.settled_closed += header.tap_count as usize;
        if number == 0 {
            self.settled_before += header.tap_count as usize;
            return;
        }
        self.report(unreported, was_open);
    }

    /// Notes that the casing `name` is done and may still be on the rig of `station`, so that a line that starts anew does not scan
    /// it again; or, with another casing open there, nothing.
    fn note_on_rig(&self, station: u16, name: &str) {
        let is_next_open = self.open.iter().any(|casing| casing.header.station == u32::from(station));
        let path = tapline_acquire::last_on_rig(&self.shown.out, station);
        if self.is_list || is_next_open || !self.with_rig.contains(&station) {
            return;
        }
        let write = || -> Result<()> {
            write_atomically(&path, Existing::Replace, |mut file| {
                file.write_all(name.as_bytes())?;
                file.sync_all()
            })?;
            // The name too: after a power cut the note must be there, as the casing's file is.
            Ok(path.parent().map_or(Ok(()), |folder| File::open(folder)?.sync_all())?)
        };
        if let Err(error) = write() {
            tracing::warn!("a line that starts anew may scan {name} again if it is still on the rig: {error:#}");
        }
    }

    /// The note of a casing that is closed; `None` if its verdict was reported before.
    fn note_of(&mut self, unreported: Unreported) -> Option<Unreported> {
        let note = self.audience.wires.as_ref()?.outbox.note(unreported.number);
        note.unwrap_or_else(|error| {
            let text = format!("casing {}: its verdict may be reported twice: {error:#}", unreported.name);
            tracing::error!("{text}");
            self.alarm(text);
            Some(unreported)
        })
    }

    /// Shows what earlier lines in the folder have left for people: their last verdicts, and files that were put aside.
    pub(super) fn recall(&mut self) {
        let left = self.shown.out.join(LEFT_FOLDER);
        let is_archive = |entry: &DirEntry| entry.path().extension().is_some_and(|ending| ending == "h5");
        let count = fs::read_dir(&left).into_iter().flatten().flatten().filter(is_archive).count();
        if count > 0 {
            let files = counted(count, "file that cannot be continued is", "files that cannot be continued are");
            self.alarm(format!("{files} in {}: their casings have no verdict by these taps", left.display()));
        }
        for finished in last_finished(&self.shown.out, SHOWN_MAX) {
            if self.shown.verdicts.iter().any(|verdict| verdict.file == finished.path) {
                continue;
            }
            match earlier(&finished) {
                Ok(verdict) => self.shown.verdicts.push(verdict),
                Err(error) => tracing::warn!("{}: its verdict is not shown: {error:#}", finished.path.display()),
            }
        }
        self.shown.verdicts.sort_by_key(|verdict| Reverse(verdict.at_ns));
        self.shown.verdicts.truncate(SHOWN_MAX);
    }

    /// Reports the verdict on the casing of `note`; `was_open` says whether it has just left its station.
    fn report(&mut self, note: Unreported, was_open: bool) {
        let path = self.shown.out.join(&note.file);
        let read = || -> Result<_> {
            let reader = Reader::open(&path)?;
            Ok((CasingVerdict::read(&note.name, note.number, note.at_ns, &reader)?, reader))
        };
        let read = read();
        let verdict = read.as_ref().ok().map(|(verdict, _)| Arc::new(verdict.clone()));
        match read {
            Ok((verdict, reader)) => {
                if verdict.refused + verdict.missing > 0 {
                    let CasingVerdict { casing, refused, missing, .. } = &verdict;
                    self.leave_out(format!("casing {casing}: taps refused {refused}, missing {missing}"));
                }
                if was_open {
                    let of = |casing: &super::Open| casing.header.station == u32::from(verdict.station);
                    let is_busy = self.open.iter().any(of);
                    let is_removed = self.station(verdict.station).is_some_and(|station| station.is_removed);
                    self.audience.wires.iter().for_each(|wires| wires.now.judged(&verdict, is_busy, is_removed));
                }
                if self.is_list {
                    self.print(&verdict);
                }
                self.note_judged(&verdict, &reader);
                self.shown.verdicts.retain(|shown| shown.file != verdict.file);
                self.shown.verdicts.insert(0, verdict);
                // A station's light shows its last one, however many come from the others.
                let (mut count, mut stations) = (0, BTreeSet::new());
                self.shown.verdicts.retain(|shown| {
                    count += 1;
                    stations.insert(shown.station) || count <= SHOWN_MAX
                });
            }
            Err(error) => {
                self.leave_out(format!("{}: cannot read the verdict", path.display()));
                tracing::error!("{}: cannot read the verdict: {error:#}", path.display());
                self.alarm(format!("{}: cannot read the verdict", path.display()));
            }
        }
        self.audience.wires.iter().for_each(|wires| wires.outbox.put(note.clone(), verdict.clone()));
        self.shown.closed_count += 1;
    }

    /// Raises an alarm if the casing `name`, which is begun at `station`, was rejected today: another one may have its serial.
    pub(super) fn watch_serial(&mut self, station: u16, name: &str) {
        let files = Places::new(&self.shown.out, true).finished_here(name);
        let mut before = files.filter_map(Finished::at).filter_map(|finished| earlier(&finished).ok());
        let Some(before) = before.find(|before| before.verdict == Verdict::Reject) else { return };
        let text = format!(
            "station {station}: {name} was judged REJECT at station {} today: is this the same casing?",
            before.station
        );
        tracing::warn!("{text}");
        self.alarm(text);
    }

    /// Prints the verdict on a casing of a list.
    fn print(&mut self, verdict: &CasingVerdict) {
        let form = self.audience.form;
        if let Err(error) = self.audience.progress.beside(|| verdict.print(form)) {
            let (name, file) = (&verdict.casing, verdict.file.display());
            tracing::error!(casing = name, "cannot print the verdict, which is in {file}: {error:#}");
            self.alarm(format!("casing {name}: the verdict could not be printed; it is in its file"));
        }
    }

    /// Raises an alarm when a casing has flags on most of its taps that the one before it had not: a sensor or the rig is to be looked at
    /// before the next one. A casing without them ends it.
    fn watch_signals(&mut self, verdict: &CasingVerdict) {
        let flags = verdict.shoulders.iter().flat_map(|of| of.whole.flags.keys());
        let now = flags.fold(Quality::default(), |all, flag| all | Quality::named(flag));
        let (before, begun) = self.flagged.get(&verdict.station).cloned().unwrap_or_default();
        if now == before {
            return;
        }
        if !before.is_empty() {
            self.alarm(format!("{OVER}{begun}"));
        }
        self.flagged.remove(&verdict.station);
        if !now.is_empty() {
            let meaning = now.iter().map(Quality::meaning).collect::<Vec<_>>().join("; ");
            let CasingVerdict { station, casing, .. } = verdict;
            let text = format!("station {station}: most taps of {casing} are {now}: {meaning}");
            tracing::warn!("{text}");
            self.alarm(text.clone());
            self.flagged.insert(verdict.station, (now, text));
        }
    }

    /// Notes whether the disk has room for few more casings like the largest so far.
    pub(super) fn watch_room(&mut self) {
        self.room_looked_at = Instant::now();
        let Ok(room) = rustix::fs::statvfs(&self.shown.out) else { return };
        let casings = room.f_bavail.saturating_mul(room.f_frsize) / self.casing_bytes.max(1);
        self.room = (casings < ROOM_MIN)
            .then(|| format!("the disk of {} has room for some {casings} more casings", self.shown.out.display()));
    }

    /// Counts a casing whose verdict was unreported, and keeps its state for viewers.
    fn note_judged(&mut self, verdict: &CasingVerdict, reader: &Reader) {
        match since_last_tap_s(reader) {
            Ok(latency_s) => latency_s.into_iter().for_each(|latency_s| self.shown.latency.note(latency_s)),
            Err(error) => tracing::warn!("{}: cannot read the times of its taps: {error:#}", verdict.file.display()),
        }
        let (plan, ledger) = (reader.plan(), reader.ledger());
        let last = CasingStatus {
            name: verdict.casing.clone(),
            planned: ledger.taps().len(),
            archived: verdict.archived,
            refused: verdict.refused,
            retaken: retaken(ledger),
            shoulders: Layout::new(plan.taps(), plan.scans()).shoulders(Some(ledger)),
        };
        if let Some(station) = self.station(verdict.station) {
            station.tally.add(verdict, last.retaken);
            // It may have been removed before its verdict.
            (station.last, station.refused) = (Some(last), None);
            station.whole = Whole::median(verdict.shoulders.iter().map(|shoulder| &shoulder.whole));
            (station.calibrated_on, station.calibration_ends, station.is_calibration_out_of_date) = calibration(reader);
        }
        self.watch_rig(verdict);
        self.watch_signals(verdict);
        let file = self.shown.out.join(&verdict.file).metadata();
        self.casing_bytes = self.casing_bytes.max(file.map_or(0, |file| file.len()));
        self.watch_room();
    }

    /// Logs what the last casings of a station have in common, and keeps it for viewers.
    fn watch_rig(&mut self, verdict: &CasingVerdict) {
        let number = verdict.station;
        let shoulders = verdict.shoulders.iter().map(|s| (Reasons::named(&s.reasons), &s.whole));
        // For a list, the summary says so.
        for of_station in self.rigs.add(number, &verdict.casing, shoulders).iter().filter(|_| !self.is_list) {
            match of_station.is_over {
                true => tracing::info!(station = number, "over: {}", of_station.sign),
                false => tracing::warn!(station = number, "{}: {ASKS}", of_station.sign),
            }
        }
        let station = self.shown.stations.iter_mut().find(|station| station.number == number);
        station.into_iter().for_each(|station| station.signs = self.rigs.of(number).to_vec());
    }
}

/// The verdict on a casing of an earlier line, without its id, which its file does not have.
fn earlier(finished: &Finished) -> Result<CasingVerdict> {
    let reader = Reader::open(&finished.path)?;
    // A further file of a casing has another name than the casing.
    let tyres: BTreeSet<String> = reader.plan().scans().iter().map(|scan| scan.tyre.to_string()).collect();
    let stem = finished.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = if tyres.len() == 1 { tyres.first() } else { None }.unwrap_or(&stem);
    let verdict = CasingVerdict::read(name, 0, finished.at_ns, &reader)?;
    Ok(CasingVerdict { id: String::new(), ..verdict })
}
