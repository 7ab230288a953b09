//! Where the results of a job gather until they are committed: a staging folder, or the job's own keys in object storage.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result, bail, ensure};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};

use crate::folders::{ARCHIVES_FILE, COMMIT_FILE, CasingFile};
use crate::objects::{self, Put};
use crate::place::{Key, Place};
use crate::reprocess::commit::{Committed, Row};
use crate::reprocess::staging::{self, Staging};

/// Results that are looked for at a time.
const AT_A_TIME: usize = 16;

/// Results of a job that is not committed.
#[derive(Debug)]
pub(super) enum Gathering {
    /// In a staging folder that becomes the job's.
    Folder(Staging),
    /// Under the keys of the job, which count once its commit file is there.
    Keys(Key),
}

/// The place `out` for jobs over `places`, absolute, and made if it is a folder.
///
/// # Errors
/// It cannot be made, or lies in one of `places`, whose archives would be others next time; or it is a folder, and archives are
/// in object storage: results are read with their archive beside them.
pub(super) fn out_place(out: &Place, places: &[Place]) -> Result<Place> {
    let mut folders = Vec::new();
    for place in places {
        match (out, place) {
            (_, Place::Folder(folder)) => folders.push(folder.clone()),
            (Place::Folder(_), Place::Keys(_)) => {
                bail!("--out {out} is a folder, and {place} is not: give --out s3://BUCKET/FOLDER")
            }
            (Place::Keys(out), Place::Keys(keys)) => {
                let is_in = out.bucket == keys.bucket && (out.key == keys.key || keys.below(&out.key).is_some());
                ensure!(!is_in, "--out {out} lies in {keys}, whose archives are judged: name a folder outside");
            }
        }
    }
    match out {
        Place::Folder(out) => Ok(Place::Folder(staging::out_folder(out, &folders)?)),
        Place::Keys(_) => Ok(out.clone()),
    }
}

impl Gathering {
    /// Prepares the job `folder` in `out`.
    ///
    /// # Errors
    /// `out` cannot be written.
    pub(super) fn new(out: &Place, folder: &Place, files: &[CasingFile]) -> Result<Self> {
        match (out, folder) {
            (Place::Folder(out), _) => Ok(Self::Folder(Staging::new(out, files)?)),
            (_, Place::Keys(keys)) => Ok(Self::Keys(keys.clone())),
            (_, Place::Folder(folder)) => bail!("{} is no place of object storage", folder.display()),
        }
    }

    /// Where executors put results.
    pub(super) fn text(&self) -> Result<String> {
        match self {
            Self::Folder(staging) => staging.text(),
            Self::Keys(keys) => Ok(keys.to_string()),
        }
    }

    /// Makes what was gathered the job's `folder`, with its commit file; `false` if it was committed meanwhile.
    ///
    /// # Errors
    /// Results that are not there, and what the system or the server returns. Nothing is committed then.
    pub(super) async fn commit(self, folder: &Place, committed: &Committed, files: &[CasingFile]) -> Result<bool> {
        match (self, folder) {
            (Self::Folder(staging), Place::Folder(to)) => staging.commit(to, committed, files),
            (Self::Keys(keys), _) => commit_keys(&keys, committed, files).await,
            (Self::Folder(_), Place::Keys(keys)) => bail!("{keys} is no folder"),
        }
    }
}

async fn commit_keys(keys: &Key, committed: &Committed, files: &[CasingFile]) -> Result<bool> {
    let is_there = |row: &Row| {
        let row = row.clone();
        async move {
            let (Some(results), Some(bytes)) = (row.results, row.bytes) else { return Ok(()) };
            let end = objects::end_of(&keys.join(&results), 1).await?;
            let (there, _) = end.with_context(|| format!("the results of {} are gone", row.file))?;
            ensure!(there == bytes, "the results of {} have {there} bytes, not {bytes}", row.file);
            Ok(())
        }
    };
    let rows = stream::iter(committed.rows.iter().map(is_there));
    rows.buffer_unordered(AT_A_TIME).try_collect::<()>().await?;
    let archives: BTreeMap<&str, &str> = files.iter().map(|file| (file.name.as_str(), file.path.as_str())).collect();
    let archives = serde_json::to_vec_pretty(&archives).context("the places of archives do not fit JSON")?;
    objects::put_bytes(archives, &keys.join(ARCHIVES_FILE), false).await?;
    let put = objects::put_bytes(committed.text()?, &keys.join(COMMIT_FILE), true).await?;
    Ok(put == Put::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_do_not_lie_among_the_archives() {
        let place = |text: &str| text.parse::<Place>().unwrap();
        let refusal = |out: &str, of: &str| out_place(&place(out), &[place(of)]).unwrap_err().to_string();
        for (out, of) in [
            ("s3://plant/2025", "s3://plant/2025"),
            ("s3://plant/2025/again", "s3://plant/2025"),
            ("s3://plant/a", "s3://plant"),
        ] {
            assert!(refusal(out, of).contains("whose archives are judged"), "{out} {of}");
        }
        assert!(refusal("again", "s3://plant/2025").contains("give --out s3://BUCKET/FOLDER"));
        let out = place("s3://plant/20251");
        assert_eq!(out_place(&out, &[place("s3://plant/2025"), place("s3://other")]).unwrap(), out);
    }
}
