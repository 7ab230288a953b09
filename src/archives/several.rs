//! Works on several archives, or several parts of one, at a time.

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::thread::{Builder, available_parallelism, scope};

use anyhow::{Context as _, Result};
use crossbeam::channel::{Sender, bounded};

/// Items for each thread that are begun before the first of them is taken: their results are kept until their turn.
const AHEAD: usize = 8;

/// How many files can be worked on at a time: one on each core.
pub(crate) fn cores() -> usize {
    available_parallelism().map_or(1, NonZeroUsize::get)
}

/// Has `work` done for each of `items` by `jobs` threads, each with what `init` makes; `take` gets what came of each item, in their
/// order.
///
/// Not by rayon, which fits references: a thread of its pool that waits for a fit, and holds the lock of the reference meanwhile, may be
/// given the next file, which needs that lock.
///
/// # Errors
/// The first of `init` or `take`, or that a thread cannot be started.
pub(crate) fn each<I: Sync, S: Send, T: Send>(
    items: &[I],
    jobs: usize,
    init: impl Fn() -> Result<S>,
    work: impl Fn(&mut S, &I) -> T + Sync,
    mut take: impl FnMut(&I, T) -> Result<()>,
) -> Result<()> {
    scope(|threads| {
        let (send, to_do) = bounded::<(&I, Sender<T>)>(AHEAD * jobs);
        for number in 0..jobs.min(items.len()) {
            let (mut state, to_do, work) = (init()?, to_do.clone(), &work);
            let run = move || {
                for (item, done) in to_do {
                    // After an error of `take` nobody receives.
                    if done.send(work(&mut state, item)).is_err() {
                        return;
                    }
                }
            };
            Builder::new()
                .name(format!("work-{number}"))
                .spawn_scoped(threads, run)
                .context("cannot start a thread")?;
        }
        drop(to_do);
        let (mut rest, mut due) = (items.iter(), VecDeque::new());
        loop {
            while due.len() < AHEAD * jobs
                && let Some(item) = rest.next()
            {
                let (done, result) = bounded(1);
                drop(send.send((item, done))); // without a thread left, `result` has the error
                due.push_back((item, result));
            }
            let Some((item, result)) = due.pop_front() else { return Ok(()) };
            take(item, result.recv().context("a thread has ended")?)?;
        }
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    use anyhow::bail;

    use super::*;

    /// Catches items whose results come in the order in which they are ready, and work that goes on after an error.
    #[test]
    fn several_at_a_time_come_in_their_order() {
        let items: Vec<u64> = (0..100).collect();
        for jobs in [1, 3, 200] {
            let mut order = Vec::new();
            let take = |&item: &u64, done: u64| {
                assert_eq!(item, done);
                order.push(done);
                if order.len() < 60 { Ok(()) } else { bail!("enough") }
            };
            let begun = AtomicUsize::new(0);
            // The first of each three takes longest.
            let work = |(): &mut (), &item: &u64| {
                begun.fetch_add(1, Ordering::Relaxed);
                std::thread::sleep(Duration::from_micros(300 * (2 - item % 3)));
                item
            };
            assert_eq!(each(&items, jobs, || Ok(()), work, take).unwrap_err().to_string(), "enough");
            assert!(begun.into_inner() <= 60 + AHEAD * jobs, "{jobs}");
            assert_eq!(order, items[..60], "{jobs}");
        }
    }
}
