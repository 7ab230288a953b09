//! `tapline repack`: copies of archives with another codec.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use serde_json::json;
use tapline_host::messages::say;
use tapline_host::signals::note_folder;
use tapline_host::stdout::Stdout;
use tapline_store::{Codec, Reader, Repacked};

use crate::archives::work::Work;
use crate::archives::{Archives, Which};

/// Packs the archive at `paths` into the file `out`; several into the folder `out`, under their names.
pub(crate) fn repack(paths: &[PathBuf], codec: Codec, out: &Path, as_json: bool) -> Result<bool> {
    let archives = Archives::find(paths, Which::Casings)?;
    let mut work = Work::on(&archives);
    for file in &archives.files {
        let to = if archives.is_many { out.join(&file.name) } else { out.to_owned() };
        if let Some(folder) = to.parent() {
            fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        }
        work.begin(file);
        if archives.is_many && is_there(&file.path, &to, codec) {
            let bytes = |path: &Path| path.metadata().map(|there| there.len()).ok();
            let json = json!({
                "archive": file.path.display().to_string(), "out": to.display().to_string(), "sample_bytes": null,
                "before_bytes": bytes(&file.path), "after_bytes": bytes(&to),
            });
            let there = format!("{} is there already; tapline verify checks it", to.display());
            match as_json {
                true => work.beside(|| writeln!(Stdout, "{json}"))?,
                false => work.beside(|| say(&there)),
            }
            continue;
        }
        note_folder(&to);
        let repacked = tapline_store::repack(&file.path, &to, codec, |part| work.note_part(part));
        if let Some(repacked) = work.take(file, repacked)? {
            work.beside(|| print(&file.path, &to, &repacked, as_json))?;
        }
    }
    work.end()
}

/// Whether `to` is a copy of `archive` with this codec, which an earlier run has made.
fn is_there(archive: &Path, to: &Path, codec: Codec) -> bool {
    let of = |path: &Path| {
        let reader = Reader::open(path).ok()?;
        Some((reader.raw_digest().ok()?, reader.lineage_key().ok()?, reader.codec()))
    };
    let copy = of(to).filter(|(.., of_copy)| *of_copy == codec);
    copy.zip(of(archive)).is_some_and(|(copy, archive)| (copy.0, copy.1) == (archive.0, archive.1))
}

fn print(archive: &Path, out: &Path, repacked: &Repacked, as_json: bool) -> Result<()> {
    let &Repacked { sample_bytes, before_bytes, after_bytes } = repacked;
    if as_json {
        let text = json!({
            "archive": archive.display().to_string(), "out": out.display().to_string(), "sample_bytes": sample_bytes,
            "before_bytes": before_bytes, "after_bytes": after_bytes,
        });
        return Ok(writeln!(Stdout, "{text}")?);
    }
    let mb = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    let (samples, before, after) = (mb(sample_bytes), mb(before_bytes), mb(after_bytes));
    writeln!(Stdout, "{}: {after}, before {before}; its samples unpacked: {samples}", out.display())?;
    Ok(())
}
