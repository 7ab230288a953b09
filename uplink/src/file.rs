//! Names of casing files, and which of them are safe to write.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context as _, Error, Result, ensure};
use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

/// Ending of a casing file.
const ENDING: &str = ".h5";

/// Longest name of a site, in bytes.
const SITE_BYTES_MAX: usize = 64;

/// Longest name of a file with its folders, in bytes: as text of base64 it is part of a subject.
const NAME_BYTES_MAX: usize = 512;

/// Longest name in a folder, in bytes.
const PART_BYTES_MAX: usize = 240;

/// Folders of what is under way or was left: nobody takes what is in them for finished archives.
const UNFINISHED: [&str; 2] = ["open", "left"];

/// Name of a station's host, as the centre knows it: the folder that its files come into.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Site(String);

impl Site {
    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for Site {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || ['-', '_', '.'].contains(&c);
        ensure!(
            (1..=SITE_BYTES_MAX).contains(&name.len())
                && name.chars().all(is_allowed)
                && !name.starts_with('.')
                && !UNFINISHED.contains(&name),
            "site {name:?}: must have from 1 to {SITE_BYTES_MAX} letters, digits, -, _ and ., may not begin with a dot, and may \
             not be {}",
            UNFINISHED.join(" or ")
        );
        Ok(Self(name.to_owned()))
    }
}

impl fmt::Display for Site {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// A finished file of a site: `SITE/2026-11-25/A-17.h5`, whose path below its folder is the same at both ends.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct CasingFile(String);

impl CasingFile {
    /// The file at `path` below the folder of `site`.
    ///
    /// # Errors
    /// A path that a centre would not write.
    pub fn new(site: &Site, path: &Path) -> Result<Self> {
        let path = path.to_str().with_context(|| format!("{}: its name is not UTF-8", path.display()))?;
        format!("{site}/{path}").parse()
    }

    /// Its path below the folder of a centre.
    pub fn path(&self) -> PathBuf {
        PathBuf::from(&self.0)
    }

    /// Its path below the folder of its site.
    pub fn below_site(&self) -> &Path {
        Path::new(self.0.split_once('/').map_or("", |(_, path)| path))
    }

    /// What it is called.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Its key among the receipts: keys have no spaces and no letters beyond ASCII.
    pub(crate) fn key(&self) -> String {
        URL_SAFE_NO_PAD.encode(&self.0)
    }
}

impl FromStr for CasingFile {
    type Err = Error;

    /// Accepts a name only if it cannot lead out of a folder, or to a hidden file.
    fn from_str(name: &str) -> Result<Self> {
        ensure!(
            name.len() <= NAME_BYTES_MAX,
            "{name:?} has {} bytes: names of files have at most {NAME_BYTES_MAX}",
            name.len()
        );
        let is_allowed = |part: &str| {
            (1..=PART_BYTES_MAX).contains(&part.len())
                && !part.starts_with('.')
                && !part.contains(char::is_control)
                && !UNFINISHED.contains(&part)
        };
        let (site, path) = name.split_once('/').with_context(|| format!("{name:?} names no site"))?;
        let _site: Site = site.parse()?;
        ensure!(
            path.split('/').all(is_allowed) && path.ends_with(ENDING),
            "{name:?}: must be a file *{ENDING}, no part of its path empty, hidden or longer than {PART_BYTES_MAX} bytes"
        );
        Ok(Self(name.to_owned()))
    }
}

impl fmt::Display for CasingFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a name that leads out of the centre's folder, and two names with one key.
    #[test]
    fn a_name_cannot_lead_out_of_its_folder() {
        let fine = ["press-1/2026-11-25/A 17.2.h5", "a/Ä.h5", "a.b_c/x/y/z.h5"];
        let files: Vec<CasingFile> = fine.iter().map(|name| name.parse().unwrap()).collect();
        assert!(files.iter().zip(fine).all(|(file, name)| file.as_str() == name && file.path() == Path::new(name)));
        assert_ne!(files[0].key(), files[1].key());
        let long = format!("a/{}.h5", "x".repeat(238));
        let longer = format!("a/{}x.h5", "x/".repeat(254));
        for bad in [
            "A.h5", "/A.h5", "a/../A.h5", "../A.h5", "a/.h5", "a/.A.h5", "a//A.h5", "a/A.toml", "a/x\n.h5", "a b/A.h5",
            ".a/A.h5", "a/", "a/open/A.h5", "left/A.h5", "a/\0.h5", &long, &longer,
        ] {
            assert!(bad.parse::<CasingFile>().is_err(), "{bad:?}");
        }
        let site: Site = "press-1".parse().unwrap();
        assert_eq!(CasingFile::new(&site, Path::new("2026-11-25/A 17.2.h5")).unwrap(), files[0]);
        assert!(CasingFile::new(&site, Path::new("../A.h5")).is_err());
    }
}
