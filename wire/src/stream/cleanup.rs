//! Removes what dead participants have left: their files in shared memory, and the layer's records of them.

use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;

/// How processes of a line share memory.
pub(crate) type Svc = ipc_threadsafe::Service;

/// Where shared memory lives.
pub(crate) const SHM: &str = "/dev/shm";

pub(crate) fn remove(path: &Path, by: impl Fn(&Path) -> std::io::Result<()>) {
    if let Err(error) = by(path)
        && error.kind() != ErrorKind::NotFound
    {
        tracing::warn!(path = %path.display(), %error, "cannot remove what a line left behind");
    }
}

/// Every file in shared memory whose name begins with `prefix`, of any user.
pub(crate) fn named(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let files = std::fs::read_dir(SHM).into_iter().flatten().flatten();
    files.filter(move |file| file.file_name().to_string_lossy().starts_with(prefix)).map(|file| file.path())
}

/// This user's files in shared memory whose names begin with `prefix`.
pub(crate) fn segments(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let us = rustix::process::geteuid().as_raw();
    named(prefix).filter(move |path| path.symlink_metadata().is_ok_and(|file| file.is_file() && file.uid() == us))
}

/// Longest time that a live participant takes from making a segment to giving it a size.
const SIZING_MAX: Duration = Duration::from_secs(1);

/// Removes segments without a size: their makers died before giving them one, and the layer would wait for it for ever.
fn remove_unsized(prefix: &str) {
    let unsized_now = || -> Vec<PathBuf> {
        segments(prefix).filter(|path| path.symlink_metadata().is_ok_and(|segment| segment.len() == 0)).collect()
    };
    let suspects = unsized_now();
    if suspects.is_empty() {
        return;
    }
    std::thread::sleep(SIZING_MAX);
    for path in unsized_now().into_iter().filter(|path| suspects.contains(path)) {
        remove(&path, |path| std::fs::remove_file(path));
    }
}

/// Removes the resources of dead participants; whether any participant is alive.
pub(crate) fn reap(config: &Config) -> bool {
    let mut is_alive = false;
    let listed = Node::<Svc>::list(config, |state| {
        match state {
            NodeState::Dead(view) => {
                remove_unsized(&config.global.prefix.to_string());
                let name = view.details().as_ref().map(|d| d.name().as_str().to_owned());
                match view.try_remove_stale_resources() {
                    Ok(()) => tracing::debug!(?name, "cleared away a dead participant"),
                    Err(error) => tracing::trace!(?name, ?error, "a dead participant is being cleared by another"),
                }
            }
            NodeState::Alive(_) | NodeState::Inaccessible(_) | NodeState::Undefined(_) => is_alive = true,
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        // Files vanish while participants come and go; the next attempt finds them settled.
        tracing::trace!(?error, "cannot list the participants just now");
        return true;
    }
    is_alive
}
