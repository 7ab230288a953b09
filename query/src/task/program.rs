//! The program `tapline`, which judges.

use std::env;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::SystemTime;

use anyhow::{Context as _, Result, ensure};

/// Names the program, if it is not beside this one.
const VARIABLE: &str = "TAPLINE";

/// Digests that were computed, with the time at which the program was written.
static KNOWN: Mutex<Vec<(PathBuf, Option<SystemTime>, String)>> = Mutex::new(Vec::new());

/// The program that judges archives again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Program {
    path: PathBuf,
}

impl Program {
    /// The one that the variable `TAPLINE` names, or else `tapline` beside this program.
    ///
    /// # Errors
    /// It is not there.
    pub fn find() -> Result<Self> {
        let path = match env::var_os(VARIABLE) {
            Some(path) => PathBuf::from(path),
            None => env::current_exe().context("cannot find this program itself")?.with_file_name("tapline"),
        };
        ensure!(path.is_file(), "the program {} is not there: set {VARIABLE} to the path of tapline", path.display());
        Ok(Self { path })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// BLAKE3 of the program.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn digest(&self) -> Result<String> {
        let written = self.path.metadata().and_then(|there| there.modified()).ok();
        let mut known = KNOWN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let same = known.iter().find(|(path, at, _)| *path == self.path && *at == written);
        if let Some((_, _, digest)) = same {
            return Ok(digest.clone());
        }
        let digest = file_digest(&self.path)?;
        known.push((self.path.clone(), written, digest.clone()));
        Ok(digest)
    }
}

/// BLAKE3 of a file, in hexadecimal digits.
///
/// # Errors
/// It cannot be read.
pub(crate) fn file_digest(path: &Path) -> Result<String> {
    let context = || format!("cannot read {}", path.display());
    let mut digest = blake3::Hasher::new();
    std::io::copy(&mut std::fs::File::open(path).with_context(context)?, &mut digest).with_context(context)?;
    Ok(digest.finalize().to_hex().to_string())
}
