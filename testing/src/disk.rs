//! A small disk of its own for a test, which can be full or read-only.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::skip;

/// A small separate disk, unmounted when dropped.
#[derive(Debug)]
pub struct Disk(PathBuf);

impl Disk {
    /// A disk of `size`, as `mount` takes it, in the new folder `place`; `None`, and a skip, if none can be mounted.
    ///
    /// # Panics
    /// If the folder cannot be made.
    pub fn at(place: &Path, size: &str) -> Option<Self> {
        fs::create_dir(place).unwrap_or_else(|error| panic!("{}: {error}", place.display()));
        let disk = Self(place.to_owned());
        let is_made = disk.mount(&format!("size={size}"));
        if !is_made {
            skip("no disk can be mounted here (it takes root)");
        }
        is_made.then_some(disk)
    }

    fn mount(&self, options: &str) -> bool {
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&self.0).stderr(Stdio::null());
        mount.status().is_ok_and(|status| status.success())
    }

    /// Mounts it again with other options: `ro`, `rw`, `size=...`.
    ///
    /// # Panics
    /// If that cannot be done.
    pub fn remount(&self, options: &str) {
        assert!(self.mount(&format!("remount,{options}")), "{options}");
    }

    /// Fills it but for `free_bytes`, with a file that can be removed.
    ///
    /// # Panics
    /// If that cannot be done.
    pub fn fill(&self, free_bytes: u64) -> PathBuf {
        let path = self.0.join("ballast");
        let disk = rustix::fs::statvfs(&self.0).unwrap_or_else(|error| panic!("{}: {error}", self.0.display()));
        let bytes = (disk.f_bavail * disk.f_frsize).saturating_sub(free_bytes);
        match fs::write(&path, vec![1; bytes as usize]) {
            // Another writer has filled it first.
            Err(error) if error.kind() == ErrorKind::StorageFull => {}
            written => written.unwrap_or_else(|error| panic!("{}: {error}", path.display())),
        }
        path
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // Lazily, because files may still be open there.
        if let Err(error) = Command::new("umount").arg("-l").arg(&self.0).stderr(Stdio::null()).status() {
            eprintln!("{}: {error}", self.0.display());
        }
    }
}
