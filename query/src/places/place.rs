//! Where casing files are: in a folder that this host reaches, or under the keys of a bucket.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context as _, Result, ensure};

/// What the address of an object begins with.
const SCHEME: &str = "s3://";

/// A folder, or its equivalent in object storage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// A folder of this host.
    Folder(PathBuf),
    /// Keys of a bucket that begin alike.
    Keys(Key),
}

/// A bucket, and a key in it or the beginning of keys.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    /// The bucket.
    pub bucket: String,
    /// The key, without `/` at its ends; empty for all keys.
    pub key: String,
}

impl Key {
    /// Reads the address of an object; `None` if it is a path.
    pub fn of_address(address: &str) -> Option<Self> {
        let (bucket, key) = address.strip_prefix(SCHEME)?.split_once('/')?;
        Some(Self { bucket: bucket.to_owned(), key: key.to_owned() })
    }

    /// The key `name` below this one.
    #[must_use]
    pub fn join(&self, name: &str) -> Self {
        let key = if self.key.is_empty() { name.to_owned() } else { format!("{}/{name}", self.key) };
        Self { bucket: self.bucket.clone(), key }
    }

    /// What is left of `key` below this one; `None` if it lies elsewhere.
    pub fn below<'a>(&self, key: &'a str) -> Option<&'a str> {
        if self.key.is_empty() { Some(key) } else { key.strip_prefix(&self.key)?.strip_prefix('/') }
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{SCHEME}{}/{}", self.bucket, self.key)
    }
}

impl FromStr for Place {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some(rest) = text.strip_prefix(SCHEME) else {
            ensure!(
                !text.split('/').next().is_some_and(|scheme| scheme.len() > 1 && scheme.ends_with(':')),
                "{text:?} is neither a folder nor {SCHEME}BUCKET/FOLDER"
            );
            return Ok(Self::Folder(PathBuf::from(text)));
        };
        let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || ['.', '-', '_'].contains(&c);
        ensure!(
            (3..=63).contains(&bucket.len()) && bucket.chars().all(is_allowed),
            "the bucket of {text:?} is {bucket:?}; it must have from 3 to 63 letters, digits, dots, - and _"
        );
        Ok(Self::Keys(Key { bucket: bucket.to_owned(), key: key.trim_matches('/').to_owned() }))
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => folder.display().fmt(f),
            Self::Keys(keys) => keys.fmt(f),
        }
    }
}

impl Place {
    /// The folder `name` in it.
    #[must_use]
    pub fn join(&self, name: &str) -> Self {
        match self {
            Self::Folder(folder) => Self::Folder(folder.join(name)),
            Self::Keys(keys) => Self::Keys(keys.join(name)),
        }
    }

    /// Whether it is `other`, or lies in it.
    pub(crate) fn lies_in(&self, other: &Self) -> Result<bool> {
        match (self, other) {
            (Self::Keys(this), Self::Keys(other)) => {
                Ok(this.bucket == other.bucket && (this.key == other.key || other.below(&this.key).is_some()))
            }
            (Self::Folder(this), Self::Folder(other)) => {
                let context = |folder: &Path| format!("cannot read {}", folder.display());
                let other = other.canonicalize().with_context(|| context(other))?;
                let this = std::path::absolute(this).with_context(|| context(this))?;
                // Also if a link leads there; what does not exist yet lies where its existing parent does.
                let real = this.ancestors().find_map(|above| above.canonicalize().ok());
                Ok(this.starts_with(&other) || real.is_some_and(|real| real.starts_with(&other)))
            }
            _ => Ok(false),
        }
    }

    /// Its own name, without those above it.
    pub(crate) fn name(&self) -> String {
        match self {
            Self::Folder(folder) => folder.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            Self::Keys(Key { bucket, key }) if key.is_empty() => bucket.clone(),
            Self::Keys(Key { key, .. }) => key.rsplit('/').next().unwrap_or_default().to_owned(),
        }
    }
}

impl From<&Path> for Place {
    fn from(folder: &Path) -> Self {
        Self::Folder(folder.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_and_others_refused() {
        let read = |text: &str| text.parse::<Place>();
        assert_eq!(read("2025/a").unwrap(), Place::Folder(PathBuf::from("2025/a")));
        for (text, key, again, name) in [
            ("s3://plant", "", "s3://plant/", "plant"),
            ("s3://plant/2025/", "2025", "s3://plant/2025", "2025"),
            ("s3://plant/a/b", "a/b", "s3://plant/a/b", "b"),
        ] {
            let place = read(text).unwrap();
            assert_eq!(place, Place::Keys(Key { bucket: "plant".to_owned(), key: key.to_owned() }));
            assert_eq!((place.to_string().as_str(), place.name().as_str()), (again, name));
        }
        assert_eq!(
            read("s3:///a").unwrap_err().to_string(),
            "the bucket of \"s3:///a\" is \"\"; it must have from 3 to 63 letters, digits, dots, - and _"
        );
        assert!(read("gs://plant/a").unwrap_err().to_string().contains("is neither a folder nor s3://"));
    }

    /// Catches a folder that is taken for another whose name begins alike.
    #[test]
    fn keys_lie_below_whole_names() {
        let Place::Keys(keys) = "s3://plant/2025".parse().unwrap() else { panic!("no keys") };
        assert_eq!((keys.below("2025/A.h5"), keys.below("20251/A.h5"), keys.below("2025")), (Some("A.h5"), None, None));
        assert_eq!(Key::of_address(&keys.join("A.h5").to_string()), Some(keys.join("A.h5")));
        assert_eq!(Key::of_address("/2025/A.h5"), None);
    }
}
