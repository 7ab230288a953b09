//! What work costs: processor time of this thread, for workloads that take turns.
//!
//! Processor time excludes other programs; what these cost indirectly, through caches and clock rates, falls on all
//! workloads alike since they take turns. So ratios within one facet can be trusted more than the numbers themselves.

use std::hint::black_box;

use rustix::time::{ClockId, clock_gettime};

use super::point::Cost;

/// Processor time of this thread so far, ns.
pub(crate) fn thread_cpu_ns() -> i64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

/// Something whose cost is measured, a batch at a time.
pub(crate) struct Workload<'a> {
    /// How many taps, or other things, a batch has.
    count: usize,
    run: Box<dyn FnMut() -> f64 + 'a>,
}

impl<'a> Workload<'a> {
    pub(crate) fn each<T>(things: &'a [T], mut each: impl FnMut(&'a T) -> f64 + 'a) -> Self {
        Self { count: things.len(), run: Box::new(move || things.iter().map(&mut each).sum()) }
    }

    pub(crate) fn batch(count: usize, run: impl FnMut() -> f64 + 'a) -> Self {
        Self { count, run: Box::new(run) }
    }
}

/// Microseconds of processor time that each of `workloads` takes per thing, over alternating `rounds`. A round before
/// them is not counted: it fills the caches and the plans.
pub(crate) fn by_turns(mut workloads: Vec<Workload<'_>>, rounds: usize) -> Vec<Cost> {
    let mut times = vec![Vec::with_capacity(rounds); workloads.len()];
    for round in 0..=rounds {
        for (workload, times) in workloads.iter_mut().zip(&mut times) {
            let begun = thread_cpu_ns();
            black_box((workload.run)());
            let spent_ns = thread_cpu_ns() - begun;
            if round > 0 {
                times.push(spent_ns as f64 * 1e-3 / workload.count as f64);
            }
        }
    }
    times.iter().map(|times| Cost::of(times)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a clock that stands still, a batch not divided by its count, and workloads that are mixed up. Ten times the
    /// work takes more than twice the time on any machine, since both take turns.
    #[test]
    fn more_work_costs_more() {
        let spin = |count: u64| (0..count).fold(0.0, |sum: f64, k| black_box(sum + (k as f64).sqrt()));
        let workloads = vec![
            Workload::batch(1, || spin(20_000)),
            Workload::batch(1, || spin(200_000)),
            Workload::batch(10, || spin(200_000)),
        ];
        let costs = by_turns(workloads, 9);
        assert!(costs[1].median > 2.0 * costs[0].median, "{costs:?}");
        assert!(costs[2].median < 0.5 * costs[1].median, "{costs:?}");
        assert!(costs.iter().all(|cost| cost.low <= cost.median && cost.median <= cost.high && cost.low > 0.0));
    }
}
