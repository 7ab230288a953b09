//! `tapline repack`: copies of archives with another codec.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use tapline_store::{Codec, Repacked};

use crate::archives::{Archives, Outcome, Which};
use crate::cli::PackedBy;

/// Packs the archive at `paths` into the file `out`; several into the folder `out`, under their names.
pub(crate) fn repack(paths: &[PathBuf], codec: Codec, out: &Path) -> Result<bool> {
    let archives = Archives::find(paths, Which::Casings)?;
    let mut outcome = Outcome::new(&archives);
    for file in &archives.files {
        let to = if archives.is_many { out.join(&file.name) } else { out.to_owned() };
        if archives.is_many
            && let Some(folder) = to.parent()
        {
            fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        }
        if let Some(repacked) = outcome.take(file, tapline_store::repack(&file.path, &to, codec))? {
            print(&to, &repacked)?;
        }
    }
    outcome.end()
}

fn print(out: &Path, repacked: &Repacked) -> Result<()> {
    let &Repacked { sample_bytes, before_bytes, after_bytes } = repacked;
    let mb = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    #[expect(clippy::cast_precision_loss, reason = "a ratio for people to read")]
    let ratio = sample_bytes as f64 / after_bytes as f64;
    let (samples, before, after) = (mb(sample_bytes), mb(before_bytes), mb(after_bytes));
    writeln!(
        io::stdout(),
        "{}: {after}, from {before}; {samples} of samples, {ratio:.2} times the file",
        out.display()
    )?;
    Ok(())
}

impl From<PackedBy> for Codec {
    fn from(by: PackedBy) -> Self {
        match by {
            PackedBy::None => Self::None,
            PackedBy::Lz4 => Self::Lz4,
            PackedBy::Zstd => Self::Zstd,
            PackedBy::Gzip => Self::Gzip,
        }
    }
}
