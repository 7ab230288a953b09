//! Casing files copied from one place to another: whole ones, each once, none overwritten.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use futures_util::{StreamExt as _, stream};
use tapline_store::verify;
use tokio::task::spawn_blocking;

use crate::folders::{CasingFile, find};
use crate::objects::{self, Put};
use crate::place::{Key, Place};
use crate::task::Local;

/// Files that are under way at a time.
const AT_A_TIME: usize = 4;

/// What became of the files.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Copied {
    /// Files that were copied.
    pub copied: usize,
    /// Files that were there before.
    pub there: usize,
    /// Files that were not copied, and why.
    pub failed: Vec<(String, String)>,
}

/// Copies the finished archives of `from` to `to`, under the same names. One that is not whole is left out, and one that is
/// there is not overwritten.
///
/// # Errors
/// Places that cannot be read. What keeps one file from being copied is in [`Copied`].
pub async fn copy(from: &[Place], to: &Place) -> Result<Copied> {
    let files = find(from, false).await?;
    let one = |file: CasingFile| async move {
        let done = copy_one(&file, to).await;
        (file, done)
    };
    let mut done = stream::iter(files.into_iter().map(one)).buffered(AT_A_TIME);
    let mut copied = Copied::default();
    while let Some((file, done)) = done.next().await {
        match done {
            Ok(Put::Done) => copied.copied += 1,
            Ok(Put::WasThere) => copied.there += 1,
            Err(error) => copied.failed.push((file.name, format!("{error:#}"))),
        }
    }
    Ok(copied)
}

async fn copy_one(file: &CasingFile, to: &Place) -> Result<Put> {
    let target = CasingFile::new(file.name.clone(), to.join(&file.name).to_string());
    if is_same(file, &target).await? {
        return Ok(Put::WasThere);
    }
    let source = file.clone();
    let local = spawn_blocking(move || checked(&source)).await.context("a file was not read to its end")??;
    let put = match Key::of_address(&target.path) {
        Some(key) => objects::put(local.path(), &key, true).await?,
        None => {
            let to = target.path.clone();
            spawn_blocking(move || put_file(&local, Path::new(&to))).await.context("a file was not written")??
        }
    };
    // Another process was faster; what it put must be the same.
    match put == Put::WasThere && !is_same(file, &target).await? {
        true => bail!("{} vanished while it was read", target.path),
        false => Ok(put),
    }
}

/// Whether `target` is there already, and is the same archive.
async fn is_same(file: &CasingFile, target: &CasingFile) -> Result<bool> {
    match target.end().await? {
        None => Ok(false),
        end if end == file.end().await? => Ok(true),
        Some(_) => bail!("another file is at {}; it is not overwritten", target.path),
    }
}

/// The file on this host, if it is a whole archive.
fn checked(file: &CasingFile) -> Result<Local> {
    let local = Local::of(file)?.map_err(anyhow::Error::msg)?;
    let report = verify(local.path()).map_err(|error| anyhow::Error::msg(local.message(file, &error.to_string())))?;
    if let Some(problem) = report.problems.first() {
        bail!("{problem}");
    }
    match report.is_finished {
        true => Ok(local),
        false => bail!("it is not finished"),
    }
}

/// Writes a copy of `from` at `to`: the whole of it, or nothing.
fn put_file(from: &Local, to: &Path) -> Result<Put> {
    let folder = to.parent().with_context(|| format!("{} is in no folder", to.display()))?;
    let cannot = || format!("cannot write {}", to.display());
    std::fs::create_dir_all(folder).with_context(cannot)?;
    let mut part = tempfile::Builder::new().prefix(".copy-").tempfile_in(folder).with_context(cannot)?;
    let mut source =
        std::fs::File::open(from.path()).with_context(|| format!("cannot read {}", from.path().display()))?;
    std::io::copy(&mut source, &mut part).with_context(cannot)?;
    part.as_file().sync_all().with_context(cannot)?;
    match part.persist_noclobber(to) {
        Err(error) if error.error.kind() == std::io::ErrorKind::AlreadyExists => return Ok(Put::WasThere),
        persisted => persisted.with_context(cannot)?,
    };
    std::fs::File::open(folder).and_then(|folder| folder.sync_all()).with_context(cannot)?;
    Ok(Put::Done)
}
