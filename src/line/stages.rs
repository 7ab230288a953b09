//! The stages of a line together: started in order, replaced when they die, held back while the disk or the memory fails.

use std::ops::Range;
use std::time::{Duration, Instant};

use anyhow::Result;
use tapline_wire::{Line, LineAddress, LineError, OVER, Role, shm};

use crate::line::limits::RESTART_BYTES;
use crate::line::out_folder::OutFolder;
use crate::line::setup::Setup;
use crate::line::stage::{StageReport, arguments};
use crate::line::stage_process::StageProcess;
use crate::shown::status::StageStatus;

/// `store`, `fuse` and `process`, in this order, come before the sources.
const DOWNSTREAM: [Role; 3] = [Role::Store, Role::Fuse, Role::Process];

/// For how long after a start memory for connections is reserved, and at what interval.
const SECURED_FOR: Duration = Duration::from_secs(10);
const SECURE_EVERY: Duration = Duration::from_millis(200);

/// How often a write to a failed disk is tried.
const TRY_DISK_EVERY: Duration = Duration::from_secs(1);

/// Alarms, until they are over.
const DISK_FAILED: &str = "the disk of the archive has failed, or may not be written: the log says what to do";
const SHM_FULL: &str = "/dev/shm is full: a stage that ends is not started again until there is room";

/// The stages of a line that runs.
pub(crate) struct Stages<'a> {
    line: &'a Line,
    address: &'a LineAddress,
    folder: &'a mut OutFolder,
    all: Vec<StageProcess>,
    is_short_of_room: bool,
    /// While the disk of the archive has failed: when it was last tried.
    disk_failed_at: Option<Instant>,
    /// When a stage was last started.
    started_at: Instant,
    secured_at: Instant,
    /// Alarms that were not taken yet.
    alarms: Vec<String>,
}

impl<'a> Stages<'a> {
    /// Starts the stages of the line that `setup` describes.
    pub(crate) fn start(
        line: &'a Line,
        setup: &Setup,
        address: &'a LineAddress,
        folder: &'a mut OutFolder,
    ) -> Result<Self> {
        // Downstream first, so that every sender has a receiver.
        let acquires = (0..setup.limits.acquire_count).map(Role::Acquire);
        let mut all = Vec::new();
        for role in DOWNSTREAM.into_iter().chain(acquires) {
            all.push(StageProcess::start(role, arguments(&role.name(), address.root())?)?);
        }
        Ok(Self {
            line,
            address,
            folder,
            all,
            is_short_of_room: false,
            disk_failed_at: None,
            started_at: Instant::now(),
            secured_at: Instant::now(),
            alarms: Vec::new(),
        })
    }

    /// All of them.
    pub(crate) fn every(&self) -> Range<usize> {
        0..self.all.len()
    }

    /// In what order they are ended: the sources first, at once; then one after the other.
    pub(crate) fn ending_order(&self) -> Vec<Range<usize>> {
        let sources = DOWNSTREAM.len()..self.all.len();
        [sources].into_iter().chain((0..DOWNSTREAM.len()).rev().map(|number| number..number + 1)).collect()
    }

    /// Clears away stages that have died, so that nobody waits for them, and starts those of `which` again. Returns whether
    /// one had died.
    pub(crate) fn tend(&mut self, which: Range<usize>) -> Result<bool> {
        let is_short = self.is_short_of_room()?;
        if !is_short {
            self.look_after_disk()?;
        }
        let mut has_died = false;
        for (number, stage) in self.all.iter_mut().enumerate() {
            // One that must be started again has to wait until there is memory for it.
            let must_wait = is_short && which.contains(&number) && !stage.is_asked_to_end();
            if must_wait {
                continue;
            }
            if let Some(status) = stage.ended()? {
                has_died = true;
                // Its shared memory is released before it is started again.
                self.line.clear_dead();
                stage.handle_end(status, which.contains(&number))?;
            }
        }
        if has_died {
            self.started_at = Instant::now();
            for stage in &self.all {
                self.line.notify(stage.role());
            }
        }
        Ok(has_died)
    }

    /// Raises an alarm for each that is held up, and ends those of the others.
    pub(crate) fn listen(&mut self) {
        for stage in &mut self.all {
            let beats = self.line.beats(stage.role());
            self.alarms.extend(stage.hear(beats));
        }
    }

    /// While a stage waits for its disk: releases the output folder, and restarts the stage when that is writable.
    fn look_after_disk(&mut self) -> Result<()> {
        let Some(place) = self.all.iter().position(|stage| stage.awaits_disk) else { return Ok(()) };
        if self.disk_failed_at.is_none() {
            self.folder.release();
            self.alarms.push(DISK_FAILED.to_owned());
        }
        let tried_at = self.disk_failed_at.get_or_insert_with(Instant::now);
        if tried_at.elapsed() < TRY_DISK_EVERY {
            return Ok(());
        }
        *tried_at = Instant::now();
        if !self.folder.take_back()? {
            return Ok(());
        }
        let probe = self.folder.open_path().join(".probe");
        if std::fs::write(&probe, "tapline").and_then(|()| std::fs::remove_file(&probe)).is_err() {
            self.folder.release();
            return Ok(());
        }
        tracing::warn!("the disk of the archive can be written again; nothing is lost");
        self.alarms.push(format!("{OVER}{DISK_FAILED}"));
        self.disk_failed_at = None;
        self.all[place].disk_is_back()
    }

    /// Whether there is too little shared memory to start a stage again; logs it when it begins and when it ends.
    fn is_short_of_room(&mut self) -> Result<bool> {
        let is_short = shm::free_bytes()? < RESTART_BYTES;
        if is_short != self.is_short_of_room {
            self.is_short_of_room = is_short;
            match is_short {
                true => {
                    tracing::error!("{SHM_FULL}");
                    self.alarms.push(SHM_FULL.to_owned());
                }
                false => {
                    tracing::warn!("there is room in /dev/shm again");
                    self.alarms.push(format!("{OVER}{SHM_FULL}"));
                }
            }
        }
        Ok(is_short)
    }

    /// Reserves the memory of the stages' connections for a while after a start, and checks that no other user can open it.
    pub(crate) fn secure(&mut self) -> Result<()> {
        if self.started_at.elapsed() > SECURED_FOR || self.secured_at.elapsed() < SECURE_EVERY {
            return Ok(());
        }
        self.secured_at = Instant::now();
        match shm::reserve("this line", self.address) {
            Ok(_) => {}
            Err(LineError::NoRoom { .. }) => drop(self.is_short_of_room()?),
            Err(error) => return Err(error.into()),
        }
        Ok(self.address.verify()?)
    }

    /// Asks some stages to end.
    pub(crate) fn ask_to_end(&mut self, which: Range<usize>) {
        self.all[which].iter_mut().for_each(StageProcess::ask_to_end);
    }

    /// Whether one of them still runs.
    pub(crate) fn are_running(&self, which: Range<usize>) -> bool {
        self.all[which].iter().any(StageProcess::is_running)
    }

    /// Wakes those that were asked to end: one may have begun to wait in the moment before it was asked.
    pub(crate) fn wake(&self, which: Range<usize>) {
        for stage in &self.all[which] {
            self.line.notify(stage.role());
        }
    }

    /// Ends by force those that still run.
    pub(crate) fn kill(&mut self, which: Range<usize>) {
        self.all[which].iter_mut().filter(|stage| stage.is_running()).for_each(StageProcess::kill);
    }

    /// Notes progress: restarts until now were not fruitless.
    pub(crate) fn note_progress(&mut self) {
        self.all.iter_mut().for_each(StageProcess::note_progress);
    }

    /// The alarms since this was last called.
    pub(crate) fn take_alarms(&mut self) -> Vec<String> {
        std::mem::take(&mut self.alarms)
    }

    /// What is wrong with them at this moment.
    pub(crate) fn troubles(&self) -> impl Iterator<Item = String> {
        self.all.iter().filter_map(StageProcess::trouble)
    }

    pub(crate) fn statuses(&self) -> Vec<StageStatus> {
        let status = |stage: &StageProcess| StageStatus {
            name: stage.name().to_owned(),
            pid: stage.pid(),
            restarts: stage.restart_count,
        };
        self.all.iter().map(status).collect()
    }

    /// What they reported as they ended.
    pub(crate) fn reports(&self) -> Vec<StageReport> {
        self.all.iter().filter_map(|stage| stage.report.clone()).collect()
    }

    /// How often they were restarted.
    pub(crate) fn restarts(&self) -> u32 {
        self.all.iter().map(|stage| stage.restart_count).sum()
    }
}
