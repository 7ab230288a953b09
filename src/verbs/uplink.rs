//! `tapline uplink` and `tapline collect`: finished casing files go to a centre.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use serde_json::json;
use tapline_host::messages::{counted, say, with_causes};
use tapline_host::signals::stop_flag;
use tapline_host::stdout::Stdout;
use tapline_store::{Error, Folder};
use tapline_uplink::{CasingFile, Collector, Fate, Receipt, Sender, Server, Standing, Until};

use crate::cli::uplink::{CollectArgs, ServerArgs, UplinkArgs};

/// Sends the finished files of a folder to a centre; whether it has them all.
pub(crate) fn uplink(args: &UplinkArgs) -> Result<bool> {
    let server = server(&args.server, &args.to)?;
    ensure!(args.folder.is_dir(), "{} is no folder", args.folder.display());
    let sender = Sender {
        folder: args.folder.clone(),
        site: args.site.clone(),
        bucket: args.server.bucket.clone(),
        again: args.again,
    };
    let mut results = BTreeSet::new();
    let standing = tapline_uplink::send(
        &server,
        &sender,
        &until(args.once)?,
        || finished(&args.folder, &mut results),
        |sent| {
            print(("delivered", "to"), &sent.file, &args.folder.join(sent.file.below_site()), &sent.receipt, args.json);
        },
    )?;
    let Standing { files, at_centre } = standing;
    let folder = args.folder.display();
    let of = counted(files, &format!("finished file of {folder} is"), &format!("finished files of {folder} are"));
    say(&format!("{at_centre} of {of} at the centre"));
    // A service that is stopped has done what it could; waiting files are sent after its next start.
    Ok(!args.once || at_centre == files)
}

/// Finished archives of `folder`, as paths below it, in the order of their names; there may be none. `results` collects
/// files with results, so that each is opened only once.
fn finished(folder: &Path, results: &mut BTreeSet<PathBuf>) -> Result<Vec<PathBuf>> {
    let mut finished = Folder::list(folder)?.finished;
    // Names travel as text.
    finished.retain(|path| path.to_str().is_some() && !results.contains(path));
    // Even if the archive that they belong to is gone.
    let (with_results, casings): (Vec<_>, Vec<_>) =
        finished.into_iter().partition(|path| tapline_store::has_results(path));
    results.extend(with_results);
    let below = |path: &PathBuf| path.strip_prefix(folder).unwrap_or(path).to_owned();
    Ok(casings.iter().map(below).collect())
}

/// Takes the files that come to a centre; whether none was refused.
pub(crate) fn collect(args: &CollectArgs) -> Result<bool> {
    let server = server(&args.server, &args.from)?;
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let collector = Collector { folder: args.folder.clone(), host, bucket: args.server.bucket.clone(), check };
    let mut count = 0;
    let is_fine = tapline_uplink::collect(&server, &collector, &until(args.once)?, |collected| {
        count += usize::from(collected.receipt.fate == Fate::Received);
        print(("received", "by"), &collected.file, &collected.path, &collected.receipt, args.json);
    })?;
    say(&format!("{} taken from the bucket {}", counted(count, "file was", "files were"), args.server.bucket));
    Ok(!args.once || is_fine)
}

fn server(args: &ServerArgs, servers: &str) -> Result<Server> {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || ['-', '_'].contains(&c);
    ensure!(
        (1..=64).contains(&args.bucket.len()) && args.bucket.chars().all(is_allowed),
        "--bucket {:?}: must have from 1 to 64 letters, digits, - and _",
        args.bucket
    );
    Server::new(&args.access(servers))
}

fn until(is_once: bool) -> Result<Until> {
    Ok(Until { stop: stop_flag().context("cannot listen for signals")?, is_once })
}

/// What is wrong with the archive at `path`; an error if this program cannot find that out, or not now.
fn check(path: &Path) -> Result<Option<String>> {
    // Results are checked with the archive that they name, and a stranger may name any.
    let report = match tapline_store::has_only_results(path) {
        Ok(true) => return Ok(Some("it has only results".to_owned())),
        Ok(false) => tapline_store::verify(path),
        Err(error) => Err(error),
    };
    let report = match report {
        Ok(report) => report,
        Err(error @ (Error::Io { .. } | Error::InUse { .. } | Error::FormatVersion { .. })) => return Err(error.into()),
        Err(error) => return Ok(Some(with_causes(&error).replace(&path.display().to_string(), "it"))),
    };
    let unfinished = || (!report.is_finished).then(|| "it is not finished".to_owned());
    Ok(report.problems.first().map(ToString::to_string).or_else(unfinished))
}

/// Prints what became of a file: it was `done`, `whom` the collector.
fn print((done, whom): (&str, &str), file: &CasingFile, path: &Path, receipt: &Receipt, as_json: bool) {
    let (is_received, why) = match &receipt.fate {
        Fate::Received => (true, None),
        Fate::Refused(why) => (false, Some(why)),
    };
    let text = match (as_json, why) {
        (true, _) => json!({
            "kind": if is_received { "received" } else { "refused" }, "name": file.as_str(), "path": path, "bytes": receipt.bytes,
            "digest": receipt.digest, "collector": receipt.collector, "why": why,
        })
        .to_string(),
        (false, None) => format!("{done} {}: {} bytes, {whom} {}", path.display(), receipt.bytes, receipt.collector),
        (false, Some(why)) => format!("REFUSED {}: {why}", path.display()),
    };
    // Nobody may read it any more; what became of the file does not depend on it.
    drop(writeln!(Stdout, "{text}"));
}
