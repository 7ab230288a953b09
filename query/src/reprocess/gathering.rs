//! Where the results of a job gather until they are committed: a staging folder, or the job's own keys in object storage.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};

use crate::places::{
    ARCHIVES_FILE, COMMIT_FILE, CasingFile, Key, Place,
    objects::{self, Put},
};
use crate::reprocess::commit::{Committed, Row};
use crate::reprocess::staging::{self, Staging};

/// Results that are looked for at a time.
const AT_A_TIME: usize = 16;

/// Times between two counts of results: a server should not be asked often.
const COUNT_EVERY: Duration = Duration::from_secs(1);
const COUNT_KEYS_EVERY: Duration = Duration::from_secs(10);

/// Results of a job that is not committed.
#[derive(Debug)]
pub(super) enum Gathering {
    /// In a staging folder, that becomes this one.
    Folder(Staging, PathBuf),
    /// Under the keys of the job, which count once its commit file is there.
    Keys(Key),
}

/// The place `out` for jobs over `places`, absolute, and made if it is a folder.
///
/// # Errors
/// It cannot be made, or lies in one of `places`, whose archives would be others next time; or one of them is a folder and the other
/// is not: results are read with their archive, and whoever can read these must find those.
pub(super) fn out_place(out: &Place, places: &[Place]) -> Result<Place> {
    for place in places {
        match (out, place) {
            (Place::Folder(_), Place::Keys(_)) => {
                bail!("--out {out} is a folder, and {place} is not: give --out s3://BUCKET/FOLDER")
            }
            (Place::Keys(_), Place::Folder(_)) => {
                bail!("--out {out} is not a folder, but {place} is: copy the archives into the bucket first")
            }
            _ => ensure!(
                !out.lies_in(place)?,
                "--out {out} lies in {place}, whose archives are judged: name a folder outside"
            ),
        }
    }
    match out {
        Place::Folder(out) => Ok(Place::Folder(staging::out_folder(out)?)),
        Place::Keys(_) => Ok(out.clone()),
    }
}

impl Gathering {
    /// Prepares the job named `job` in `out`.
    pub(super) fn new(out: &Place, job: &str, files: &[CasingFile]) -> Result<Self> {
        match out {
            Place::Folder(out) => Ok(Self::Folder(Staging::new(out, files)?, out.join(job))),
            Place::Keys(keys) => Ok(Self::Keys(keys.join(job))),
        }
    }

    /// Where executors put results.
    pub(super) fn text(&self) -> Result<String> {
        match self {
            Self::Folder(staging, _) => staging.text(),
            Self::Keys(keys) => Ok(keys.to_string()),
        }
    }

    /// How long to wait before results are counted again.
    pub(super) fn count_every(&self) -> Duration {
        match self {
            Self::Folder(..) => COUNT_EVERY,
            Self::Keys(_) => COUNT_KEYS_EVERY,
        }
    }

    /// Number of archives that have results; in object storage, with what a killed client of the same job left.
    pub(super) async fn count(&self) -> Result<usize> {
        match self {
            Self::Folder(staging, _) => staging.count(),
            Self::Keys(keys) => {
                let objects = objects::list(keys).await?;
                Ok(objects.iter().filter(|object| object.key.ends_with(".h5")).count())
            }
        }
    }

    /// Turns what was gathered into the job's folder, with its commit file; `false` if it was committed meanwhile.
    ///
    /// # Errors
    /// Results that are not there, and what the system or the server returns. Nothing is committed then.
    pub(super) async fn commit(self, committed: &Committed, files: &[CasingFile]) -> Result<bool> {
        match self {
            Self::Folder(staging, to) => staging.commit(&to, committed, files),
            Self::Keys(keys) => commit_keys(&keys, committed, files).await,
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
    let archives = serde_json::to_vec_pretty(&archives).context("the places of archives cannot be written as JSON")?;
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
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path().display().to_string();
        for (out, of) in [
            ("s3://plant/2025", "s3://plant/2025"),
            ("s3://plant/2025/again", "s3://plant/2025"),
            ("s3://plant/a", "s3://plant"),
            (&*format!("{here}/out"), &*here),
        ] {
            assert!(refusal(out, of).contains("whose archives are judged"), "{out} {of}");
        }
        assert!(refusal("again", "s3://plant/2025").contains("give --out s3://BUCKET/FOLDER"));
        assert!(refusal("s3://plant/again", &here).contains("copy the archives into the bucket first"));
        let out = place("s3://plant/20251");
        assert_eq!(out_place(&out, &[place("s3://plant/2025"), place("s3://other")]).unwrap(), out);
    }
}
