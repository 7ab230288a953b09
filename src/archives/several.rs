//! Works on several archives at a time.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{Builder, available_parallelism, scope};

use anyhow::{Context as _, Result};
use crossbeam::channel::bounded;

use super::ArchiveFile;

/// Files for each thread before all of them are waited for: their results are kept until those of the files before them are taken.
const AHEAD: usize = 8;

/// How many files can be worked on at a time: one on each core.
pub(crate) fn cores() -> usize {
    available_parallelism().map_or(1, NonZeroUsize::get)
}

/// Has `work` done for each of `files`, `jobs` at a time; `take` gets what came of each, in their order.
///
/// Not by rayon, which fits references: a thread of its pool that waits for a fit, and holds the lock of the reference meanwhile, may be
/// given the next file, which needs that lock.
///
/// # Errors
/// The first of `take`, or that a thread cannot be started.
pub(crate) fn each<T: Send>(
    files: &[ArchiveFile],
    jobs: usize,
    work: impl Fn(&ArchiveFile) -> T + Sync,
    mut take: impl FnMut(&ArchiveFile, T) -> Result<()>,
) -> Result<()> {
    files.chunks(AHEAD * jobs).try_for_each(|files| each_of_some(files, jobs, &work, &mut take))
}

/// [`each`] of these `files`, whose results may wait for one another.
fn each_of_some<T: Send>(
    files: &[ArchiveFile],
    jobs: usize,
    work: &(impl Fn(&ArchiveFile) -> T + Sync),
    take: &mut impl FnMut(&ArchiveFile, T) -> Result<()>,
) -> Result<()> {
    let next = AtomicUsize::new(0);
    let (send, receive) = bounded(jobs);
    scope(|threads| {
        for number in 0..jobs.min(files.len()) {
            let (send, next) = (send.clone(), &next);
            let work = move || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(file) = files.get(number) else { return };
                    tracing::info!("reading {}", file.path.display());
                    // After an error of `take` nobody receives.
                    if send.send((number, work(file))).is_err() {
                        return;
                    }
                }
            };
            let thread = Builder::new().name(format!("archive-{number}"));
            thread.spawn_scoped(threads, work).context("cannot start a thread")?;
        }
        drop(send);
        let (mut early, mut due) = (BTreeMap::new(), files.iter().zip(0..).peekable());
        for (number, done) in receive {
            early.insert(number, done);
            while let Some((file, done)) = due.peek().and_then(|&(file, due)| Some((file, early.remove(&due)?))) {
                due.next();
                take(file, done)?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use anyhow::bail;

    use super::*;

    /// Catches files whose results come in the order in which they are ready, and work that goes on after an error.
    #[test]
    fn several_files_at_a_time_come_in_their_order() {
        let file = |k: usize| ArchiveFile { path: PathBuf::from(k.to_string()), name: PathBuf::new() };
        let files: Vec<_> = (0..100).map(file).collect();
        for jobs in [1, 3, 200] {
            let mut order = Vec::new();
            let take = |file: &ArchiveFile, done: PathBuf| {
                assert_eq!(file.path, done);
                order.push(done);
                if order.len() < 60 { Ok(()) } else { bail!("enough") }
            };
            let begun = AtomicUsize::new(0);
            // The first of each three takes longest.
            let work = |file: &ArchiveFile| {
                begun.fetch_add(1, Ordering::Relaxed);
                let number: u64 = file.path.to_str().unwrap().parse().unwrap();
                std::thread::sleep(std::time::Duration::from_micros(300 * (2 - number % 3)));
                file.path.clone()
            };
            assert_eq!(each(&files, jobs, work, take).unwrap_err().to_string(), "enough");
            assert!(begun.into_inner() <= 60_usize.next_multiple_of(AHEAD * jobs), "{jobs}");
            assert!(order.iter().eq(files[..60].iter().map(|file| &file.path)), "{jobs} {order:?}");
        }
    }
}
