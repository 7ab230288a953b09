//! Where a line lives: the names of its files, and clearing away what the dead have left.

use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;

use crate::LineError;
use crate::line::Svc;

/// Where the shared memory of one line is found: two lines with different addresses never meet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineAddress {
    /// Beginning of the names of its files in `/dev/shm`.
    pub prefix: String,
    /// Folder of its other files; short, since socket paths are.
    pub root: PathBuf,
}

impl LineAddress {
    /// The address of the line called `name`, in the system's folder for temporary files.
    pub fn new(name: &str) -> Self {
        Self { prefix: format!("tapline_{name}_"), root: std::env::temp_dir().join(format!("tapline-{name}")) }
    }

    pub(crate) fn config(&self) -> Result<Config, LineError> {
        let name = |e| LineError::shared(format!("using the line address {self:?}"), e);
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(name)?;
        config.global.set_root_path(&iceoryx2::prelude::Path::new(path_bytes(&self.root)).map_err(name)?);
        Ok(config)
    }

    /// Clears away what dead participants left, and everything when no one is alive; whether it is clear now.
    ///
    /// # Errors
    /// [`LineError`] when the address is not usable.
    pub fn clear(&self) -> Result<bool, LineError> {
        let config = self.config()?;
        let is_alive = reap(&config);
        if is_alive {
            return Ok(false);
        }
        // The layer leaves one management file a prefix by design; nobody is left to need it.
        for path in segments(&self.prefix) {
            remove(&path, |path| std::fs::remove_file(path));
        }
        remove(&self.root, |path| std::fs::remove_dir_all(path));
        Ok(true)
    }
}

fn path_bytes(path: &Path) -> &[u8] {
    std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str())
}

fn remove(path: &Path, by: impl Fn(&Path) -> std::io::Result<()>) {
    if let Err(error) = by(path)
        && error.kind() != std::io::ErrorKind::NotFound
    {
        tracing::warn!(path = %path.display(), %error, "cannot remove what a line left behind");
    }
}

/// The segments of shared memory whose names begin with `prefix`.
fn segments(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let files = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    files.filter(move |file| file.file_name().to_string_lossy().starts_with(prefix)).map(|file| file.path())
}

/// Longest time that a living participant takes between making a segment and giving it a size.
const SIZING_MOST: Duration = Duration::from_secs(1);

/// Removes segments that have no size: who made them died before giving them one, for which the layer would wait for ever.
fn remove_unsized(prefix: &str) {
    let unsized_now = || -> Vec<PathBuf> {
        segments(prefix).filter(|path| path.metadata().is_ok_and(|segment| segment.len() == 0)).collect()
    };
    let suspects = unsized_now();
    if suspects.is_empty() {
        return;
    }
    std::thread::sleep(SIZING_MOST);
    for path in unsized_now().into_iter().filter(|path| suspects.contains(path)) {
        remove(&path, |path| std::fs::remove_file(path));
    }
}

/// Clears the resources of dead participants; whether anyone is alive.
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
        // Files vanish while others come and go; the next look sees a settled state.
        tracing::trace!(?error, "cannot list the participants just now");
        return true;
    }
    is_alive
}
