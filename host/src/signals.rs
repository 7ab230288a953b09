//! The signals that ask a process to end.
//!
//! A program that must shut down cleanly polls [`stop_flag`]. All others end at once, and leave nothing half-written:
//! [`end_on_signals`] removes the drafts in the folders that were noted by [`note_folder`].

use std::collections::BTreeSet;
use std::io;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

/// Removes the drafts of the process that becomes this shell, then ends it by the signal in `$0`. The arguments are the folders.
/// A draft is called `NAME.PID.new`, or `NAME.PID-RANDOM.new` with six characters. A second signal is ignored, except one
/// in the millisecond before the shell starts. Process 1 of a container cannot end itself by a signal; it exits
/// with the number that shells use for a death by signal.
const END: &str = r#"trap '' INT TERM
for folder; do
  for name in '*' '.*'; do rm -rf -- "$folder"/$name.$$.new "$folder"/$name.$$-[!.][!.][!.][!.][!.][!.].new; done
done
trap - INT TERM
kill -"$0" $$
exit $((128 + $0))"#;

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

/// Notes that a draft of `path` may be written next to it.
pub fn note_folder(path: &Path) {
    let path = path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or_else(|_| path.to_owned());
    if let Some(folder) = path.parent() {
        FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    }
}

/// From now on SIGTERM and SIGINT end this process as they do any other, after its drafts are removed.
///
/// The process becomes a shell that removes them. This ends its other threads, so none can write another draft.
///
/// # Errors
/// What the system returns.
pub fn end_on_signals() -> io::Result<()> {
    let mut signals = Signals::new([SIGTERM, SIGINT])?;
    let end = move || {
        if let Some(signal) = signals.forever().next() {
            // Held to the end, so that no draft begins in a folder unknown to the shell.
            let folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
            // It returns only if there is no shell; the drafts then stay.
            drop(Command::new("/bin/sh").args(["-c", END, &signal.to_string()]).args(&*folders).exec());
            // Only a signal that cannot be sent to oneself fails; the program then ends by itself.
            drop(emulate_default_handler(signal));
        }
    };
    Builder::new().name("signals".to_owned()).spawn(end).map(drop)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::process::ExitStatusExt as _;

    use super::*;

    /// Catches a draft that stays, a file of another process, or a result, that is removed, and a process that does not end by the
    /// signal that it was sent.
    #[test]
    fn drafts_are_known_by_the_number_of_their_process() {
        let folder = tempfile::tempdir().unwrap();
        let beside = folder.path().join("beside one with a space");
        let begin = r#"
            mkdir "$1" "$0/taps.$$.new" "$0/taps.$$.new/T1"
            touch "$0/a.csv.$$.new" "$0/.b.$$.new" "$0/taps.$$.new/T1/taps.csv" "$1/SIM-1.h5.$$-x9Yz0A.new" "$1/x.$$-aaaaaa.new.$$-bbbbbb.new"
            touch "$0/a.csv" "$0/a.$$" "$0/a.new" "$0/$$.new" "$0/a.csv.$$0.new" "$0/a.csv.$$.newer" "$1/a.csv.1-$$.new" "$1/x.$$-07.h5.1-abcdef.new"
            exec sh -c "$2" 15 "$0" "$1""#;
        let mut shell = Command::new("/bin/sh");
        let ended = shell.args(["-c", begin]).arg(folder.path()).arg(&beside).arg(END).status().unwrap();
        assert_eq!(ended.signal(), Some(SIGTERM));
        let count = |path: &Path| fs::read_dir(path).unwrap().count();
        assert_eq!(
            (count(folder.path()), count(&beside)),
            (7, 2),
            "6 files and the folder beside stay, and 2 files in it"
        );
    }
}
