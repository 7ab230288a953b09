//! Casing files copied from one place to another: whole ones, each once, none overwritten.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use futures_util::{StreamExt as _, stream};
use tapline_store::verify;
use tokio::task::spawn_blocking;

use crate::places::{
    CasingFile, End, Key, Place, find,
    objects::{self, Put},
};
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
/// Places that cannot be read or written: other files would fare no better. What is wrong with one file is in [`Copied`].
pub async fn copy(from: &[Place], to: &Place) -> Result<Copied> {
    for place in from {
        ensure!(!to.lies_in(place)?, "{to} lies in {place}, and would be copied into itself: name a folder outside");
    }
    let files = find(from, false).await?;
    let one = |file: CasingFile| async move {
        let done = copy_one(&file, to).await;
        (file, done)
    };
    let mut done = stream::iter(files.into_iter().map(one)).buffered(AT_A_TIME);
    let mut copied = Copied::default();
    while let Some((file, done)) = done.next().await {
        match done? {
            Ok(Put::Done) => copied.copied += 1,
            Ok(Put::WasThere) => copied.there += 1,
            Err(why) => copied.failed.push((file.name, why)),
        }
    }
    Ok(copied)
}

/// Copies a file; the inner `Err` has what is wrong with it, the outer one what is wrong with a place.
async fn copy_one(file: &CasingFile, to: &Place) -> Result<Result<Put, String>> {
    let target = CasingFile::new(file.name.clone(), to.join(&file.name).to_string());
    if let Some(end) = target.end().await? {
        return of_target(file, &target, &end).await;
    }
    let source = file.clone();
    let local = match spawn_blocking(move || checked(&source)).await.context("a file was not read to its end")?? {
        Ok(local) => local,
        Err(why) => return Ok(Err(why)),
    };
    let put = match Key::of_address(&target.path) {
        Some(key) => objects::put(local.path(), &key, true).await?,
        None => {
            let to = target.path.clone();
            spawn_blocking(move || put_file(&local, Path::new(&to))).await.context("a file was not written")??
        }
    };
    match put {
        Put::Done => Ok(Ok(Put::Done)),
        // Another process was faster; what it put must be the same.
        Put::WasThere => match target.end().await? {
            Some(end) => of_target(file, &target, &end).await,
            None => Ok(Err(format!("{} vanished while it was copied", target.path))),
        },
    }
}

/// What it means that `target` is there, with that end.
async fn of_target(file: &CasingFile, target: &CasingFile, end: &End) -> Result<Result<Put, String>> {
    Ok(match file.end().await? {
        Some(of_file) if of_file == *end => Ok(Put::WasThere),
        Some(_) => Err(format!("another file is at {}; it is not overwritten", target.path)),
        None => Err("it is gone".to_owned()),
    })
}

/// The file on this host, if it is a whole archive; `Err` with what is wrong with it.
fn checked(file: &CasingFile) -> Result<Result<Local, String>> {
    let local = match Local::of(file)? {
        Ok(local) => local,
        Err(why) => return Ok(Err(why)),
    };
    Ok(match verify(local.path()) {
        Err(error) => Err(local.message(file, &error.to_string())),
        Ok(report) => match report.problems.first() {
            Some(problem) => Err(problem.to_string()),
            None if report.is_finished => Ok(local),
            None => Err("it is not finished".to_owned()),
        },
    })
}

/// Writes a copy of `from` at `to`: the whole of it, or nothing.
fn put_file(from: &Local, to: &Path) -> Result<Put> {
    let folder = to.parent().with_context(|| format!("{} is in no folder", to.display()))?;
    let cannot = || format!("cannot write {}", to.display());
    std::fs::create_dir_all(folder).with_context(cannot)?;
    let mut part = draft().tempfile_in(folder).with_context(cannot)?;
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

/// What an unfinished copy is called and who may read it: as other files of this user.
fn draft() -> tempfile::Builder<'static, 'static> {
    use std::os::unix::fs::PermissionsExt as _;
    let mut draft = tempfile::Builder::new();
    draft.prefix(".copy-").permissions(std::fs::Permissions::from_mode(0o666));
    draft
}
