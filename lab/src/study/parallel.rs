//! The same work on many things side by side, with the results in order, and how far it is.

use std::sync::{Mutex, PoisonError};

use anyhow::Result;
use rayon::prelude::*;
use tapline_host::progress::{Progress, Unit};

/// The results of `work` on each of `things`, in their order, on the threads of the pool that it is called in.
///
/// # Errors
/// The first of those of `work` in the order of things; all are worked on nevertheless.
pub(super) fn each<T: Sync, R: Send>(things: &[T], work: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
    let progress = Mutex::new((Progress::new(Some(things.len() as u64), Unit::Things("comparisons")), 0));
    let counted = |thing: &T| -> Result<R> {
        let result = work(thing)?;
        let (progress, done) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        progress.update(*done);
        Ok(result)
    };
    things.par_iter().map(counted).collect::<Vec<_>>().into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches results out of order, work that is lost or done twice, and an error that is swallowed.
    #[test]
    fn results_are_in_order() {
        let things: Vec<u64> = (0..100).collect();
        let squares: Vec<u64> = things.iter().map(|x| x * x).collect();
        assert_eq!(each(&things, |x| Ok(x * x)).unwrap(), squares);
        let refused = each(&things, |&x| if x > 40 { anyhow::bail!("{x}") } else { Ok(x) });
        assert_eq!(refused.unwrap_err().to_string(), "41");
    }
}
