//! The same work on many things, on several threads, with the results in order.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{available_parallelism, scope};

use anyhow::{Context as _, Result};
use tapline_host::progress::{Progress, Unit};

/// The results of `work` on each of `things`, in their order; 0 threads means one for every core.
///
/// # Errors
/// The first error in the order of things.
pub(super) fn each<T: Sync, R: Send>(
    things: &[T],
    thread_count: usize,
    work: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let count = if thread_count == 0 { available_parallelism().map_or(1, NonZeroUsize::get) } else { thread_count };
    let next = AtomicUsize::new(0);
    let progress = Mutex::new((Progress::new(Some(things.len() as u64), Unit::Things("comparisons")), 0));
    let done: Vec<Mutex<Option<Result<R>>>> = things.iter().map(|_| Mutex::new(None)).collect();
    scope(|threads| {
        for _ in 0..count {
            threads.spawn(|| {
                while let Some((thing, place)) = {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    things.get(number).zip(done.get(number))
                } {
                    let result = work(thing);
                    *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
                    let (progress, done) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
                    *done += 1;
                    progress.update(*done);
                }
            });
        }
    });
    let result = |place: Mutex<Option<Result<R>>>| {
        place.into_inner().unwrap_or_else(PoisonError::into_inner).context("a part of the study was not done")?
    };
    done.into_iter().map(result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches results out of order, work that is lost or done twice, and an error that is swallowed.
    #[test]
    fn results_are_in_order_whatever_the_threads() {
        let things: Vec<u64> = (0..100).collect();
        for thread_count in [0, 1, 3] {
            assert_eq!(each(&things, thread_count, |x| Ok(x * x)).unwrap()[99], 99 * 99);
            let refused = each(&things, thread_count, |&x| if x > 40 { anyhow::bail!("{x}") } else { Ok(x) });
            assert_eq!(refused.unwrap_err().to_string(), "41");
        }
    }
}
