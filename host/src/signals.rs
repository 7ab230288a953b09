//! The signals that ask a process to end.
//!
//! A program that must come to an end in good order polls [`stop_flag`]. All others end at once, and leave nothing half-written:
//! [`end_on_signals`] removes the drafts in the folders that were noted by [`note_folder`].

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

/// End of a draft's name, after the number of its process: `NAME.PID.new`, or `NAME.PID-RANDOM.new`.
const DRAFT: &str = ".new";

/// How often a folder is emptied that another thread still writes into.
const ATTEMPTS_MAX: usize = 100;

/// A flag that SIGTERM and SIGINT set.
///
/// # Errors
/// What the system returns.
pub fn stop_flag() -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signal_hook::flag::register(signal, stop.clone())?;
    }
    Ok(stop)
}

/// Folders in which this process may have drafts.
static FOLDERS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Whether a signal ends this process now.
static ENDS: AtomicBool = AtomicBool::new(false);

/// Notes that a draft of `path` may be written beside it.
pub fn note_folder(path: &Path) {
    let path = path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or_else(|_| path.to_owned());
    if let Some(folder) = path.parent() {
        FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    }
}

/// From now on SIGTERM and SIGINT end this process as they do any other, after its drafts are removed.
///
/// # Errors
/// What the system returns.
pub fn end_on_signals() -> io::Result<()> {
    let mut signals = Signals::new([SIGTERM, SIGINT])?;
    let end = move || {
        if let Some(signal) = signals.forever().next() {
            ENDS.store(true, Ordering::SeqCst);
            remove_drafts();
            // Only a signal that cannot be sent to oneself fails; the program then ends by itself.
            drop(emulate_default_handler(signal));
            ENDS.store(false, Ordering::SeqCst);
        }
    };
    Builder::new().name("signals".to_owned()).spawn(end).map(drop)
}

/// Waits for the end, if a signal ends this process: what failed meanwhile failed because its drafts were removed.
pub fn wait_if_ending() {
    while ENDS.load(Ordering::SeqCst) {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

fn remove_drafts() {
    let folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    for entry in folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten() {
        let is_draft = entry.file_name().to_str().is_some_and(|name| is_draft_of(name, std::process::id()));
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        let path = entry.path();
        if is_draft && is_folder {
            // Until its writer has noticed that it is gone, a folder may fill again.
            let _is_removed = (0..ATTEMPTS_MAX).any(|_| fs::remove_dir_all(&path).is_ok());
        } else if is_draft {
            // The process ends; a file that cannot be removed stays.
            drop(fs::remove_file(path));
        }
    }
}

/// Whether a file of this name is a draft of the process `pid`.
fn is_draft_of(name: &str, pid: u32) -> bool {
    let number = name.strip_suffix(DRAFT).and_then(|name| name.rsplit_once('.')).map(|(_, number)| number);
    number.is_some_and(|number| number.split('-').next() == Some(&pid.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a draft that stays, and a file of another process, or a result, that is removed.
    #[test]
    fn drafts_are_known_by_the_number_of_their_process() {
        for name in ["a.csv.17.new", "SIM-1.h5.17-x9.new", "taps.17.new"] {
            assert!(is_draft_of(name, 17), "{name}");
        }
        for name in ["a.csv", "a.17", "a.new", "17.new", "a.csv.170.new", "a.csv.17.newer", "a.csv.1-17.new"] {
            assert!(!is_draft_of(name, 17), "{name}");
        }
    }
}
