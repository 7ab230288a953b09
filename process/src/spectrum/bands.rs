//! Bands of frequency, and the bins of a spectrum that lie in them.

use std::ops::Range;

use crate::BandEdges;
use crate::signal::wide::Kernel;

/// Edges of the two bands, Hz; each edge belongs to its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bands {
    pub f_c_hz: f64,
    pub f_hi_hz: f64,
    pub f_lo_hz: f64,
    pub f_top_hz: f64,
}

/// Frequencies of a spectrum's bins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    sample_count: usize,
    bin_width_hz: f64,
}

/// The bins of a band; the first and the last may count in part.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells {
    /// Bins that count in full.
    pub whole: Range<usize>,
    /// The bin on either side of those, and the part of it that counts.
    pub edges: [(usize, f64); 2],
}

/// Sum and largest of the one-sided powers of some bins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Folded {
    pub sum: f64,
    pub largest: f64,
}

impl Cells {
    /// One past the last bin that counts.
    pub(super) fn end(&self) -> usize {
        let [low, high] = self.edges.map(|(k, part)| if part > 0.0 { k + 1 } else { 0 });
        self.whole.end.max(low).max(high)
    }
}

impl Grid {
    pub(super) fn new(sample_count: usize, sample_rate_hz: f64) -> Self {
        // The same operations as numpy.fft.rfftfreq(n, 1/fs), so that a bin on an edge falls on the same side.
        let spacing_s = 1.0 / sample_rate_hz;
        Self { sample_count, bin_width_hz: 1.0 / (sample_count as f64 * spacing_s) }
    }

    pub(super) fn bin_width_hz(&self) -> f64 {
        self.bin_width_hz
    }

    fn frequency_hz(&self, bin: usize) -> f64 {
        bin as f64 * self.bin_width_hz
    }

    /// First bin whose frequency `is_beyond`; `is_beyond` must be monotonic.
    fn first(&self, is_beyond: impl Fn(f64) -> bool) -> usize {
        let (mut low, mut high) = (0, self.sample_count / 2 + 1);
        while low < high {
            let middle = low.midpoint(high);
            if is_beyond(self.frequency_hz(middle)) { high = middle } else { low = middle + 1 }
        }
        low
    }

    /// Bins from `from_hz` to `to_hz`, both included; `None` if there are none.
    fn bins(&self, from_hz: f64, to_hz: f64) -> Option<Range<usize>> {
        let range = self.first(|f| f >= from_hz)..self.first(|f| f > to_hz);
        (!range.is_empty()).then_some(range)
    }

    /// Bins from `from_hz` to `to_hz`, where `edges` says how the outermost count; `None` if no bin's frequency lies
    /// between.
    pub(super) fn cells(&self, edges: BandEdges, from_hz: f64, to_hz: f64) -> Option<Cells> {
        let bins = self.bins(from_hz, to_hz)?;
        if edges == BandEdges::Bins {
            return Some(Cells { whole: bins, edges: [(0, 0.0); 2] });
        }
        // Bin k stands for k - 1/2 to k + 1/2, so the outermost bins inside may reach beyond the band or fall short of
        // it.
        let (from, to) = (from_hz / self.bin_width_hz + 0.5, to_hz / self.bin_width_hz + 0.5);
        let (first, last) = (from as usize, (to as usize).min(self.sample_count / 2));
        let part_of = |bin: usize| {
            let (low, high) = (bin as f64, bin as f64 + 1.0);
            (if to < high { to } else { high }) - (if from > low { from } else { low })
        };
        let low = (first, part_of(first));
        let high = if last > first { (last, part_of(last)) } else { (last, 0.0) };
        Some(Cells { whole: first + 1..last, edges: [low, high] })
    }

    /// Sum and largest of the `powers` of `cells`; `powers` begins at 0 Hz. A bin that also stands for a negative
    /// frequency counts twice: all but 0 Hz, which is left out, and the Nyquist frequency of an even number of samples.
    pub(super) fn fold(&self, cells: Cells, powers: &[f64]) -> Folded {
        let is_nyquist = |k: usize| 2 * k == self.sample_count;
        let sided = |k: usize| if is_nyquist(k) { powers[k] } else { 2.0 * powers[k] };
        let Range { start, end } = cells.whole;
        let has_nyquist = end > start && is_nyquist(end - 1);
        let both_sided = start.max(1)..end - usize::from(has_nyquist);
        debug_assert!(cells.whole.is_empty() || end <= powers.len(), "a bin has no power");
        let mut folded = Fold { powers: powers.get(both_sided).unwrap_or_default() }.wide();
        folded = Folded { sum: 2.0 * folded.sum, largest: 2.0 * folded.largest };
        if has_nyquist {
            folded.add(powers[end - 1], 1.0);
        }
        for (k, part) in cells.edges.into_iter().filter(|(k, part)| *k > 0 && *part > 0.0) {
            folded.add(sided(k), part);
        }
        folded
    }
}

impl Folded {
    /// Adds the `part` of a bin of `power` that lies in the band.
    fn add(&mut self, power: f64, part: f64) {
        self.sum += part * power;
        let is_inside = part >= 0.5;
        self.largest = if is_inside && power > self.largest { power } else { self.largest };
    }
}

/// Lanes of a fold; they let the compiler use vectors.
const LANES: usize = 16;

/// Sum and largest of `powers`.
struct Fold<'a> {
    powers: &'a [f64],
}

impl Kernel for Fold<'_> {
    type Output = Folded;

    #[inline(always)]
    fn run(self) -> Folded {
        let (rows, rest) = self.powers.as_chunks::<LANES>();
        let (mut sums, mut largest) = ([0.0; LANES], [0.0; LANES]);
        for row in rows {
            for (lane, &power) in row.iter().enumerate() {
                sums[lane] += power;
                largest[lane] = if power > largest[lane] { power } else { largest[lane] };
            }
        }
        let largest = largest.iter().chain(rest).fold(0.0, |most, &power| if power > most { power } else { most });
        Folded { sum: sums.iter().chain(rest).sum(), largest }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signal::wide::in_all_vectors;

    /// Catches a bin lost to the rounding of k fs / N: rates whose reciprocal is not a double, with numpy's results.
    #[test]
    fn bins_like_numpy() {
        for (count, rate, from, to) in
            [(16_384, 40_960.0, 550.0, 2000.0), (16_384, 41_000.0, 70.0, 3000.0), (4800, 48_000.0, 550.0, 2000.0)]
        {
            let grid = Grid::new(count, rate);
            let inside = (0..=count / 2).filter(|&k| (from..=to).contains(&grid.frequency_hz(k)));
            assert!(inside.eq(grid.bins(from, to).unwrap()), "{count} at {rate}");
        }
        assert_eq!(Grid::new(16_384, 40_960.0).bins(550.0, 2000.0), Some(220..801));
        assert_eq!(Grid::new(16, 40_960.0).bins(550.0, 2000.0), None);
    }

    /// Catches a part of a bin lost, doubled or beyond the Nyquist frequency: of a flat spectrum the sum is the band.
    #[test]
    fn fractional_cells_fill_the_band() {
        proptest!(|(count in 64..4000_usize, from in 0.02..0.3_f64, width in 0.05..0.9_f64)| {
            let rate = 1000.0;
            let to = from + width;
            let grid = Grid::new(count, rate);
            let cells = grid.cells(BandEdges::Fractional, from * rate, to * rate).unwrap();
            let sum = grid.fold(cells, &vec![0.5; count / 2 + 1]).sum * grid.bin_width_hz();
            let top = if to > 0.5 { 0.5 * rate } else { to * rate };
            // The Nyquist bin of an even number stands for half a bin below it and its mirror image.
            let expected = top - from * rate;
            let ends_in_it = to * rate + grid.bin_width_hz() / 2.0 >= 0.5 * rate;
            let slack = if ends_in_it { 0.51 * grid.bin_width_hz() } else { 1e-9 };
            prop_assert!((sum - expected).abs() <= slack, "{sum} {expected}");
        });
    }

    /// Catches a bin left out, counted twice or doubled wrongly, including the first and the last, and folds that
    /// depend on the machine's vectors.
    #[test]
    fn whole_bins_like_a_loop() {
        proptest!(|(powers in prop::collection::vec(0.0..1.0_f64, 2..200), is_even in any::<bool>(), start: u8, end: u8)| {
            let bins = powers.len();
            let grid = Grid::new(if is_even { 2 * (bins - 1) } else { 2 * bins - 1 }, 1000.0);
            let (start, end) = (start as usize % bins, end as usize % (bins + 1));
            let cells = Cells { whole: start..end, edges: [(0, 0.0); 2] };
            let found = grid.fold(cells, &powers);
            let sided = |k: usize| if k == 0 { 0.0 } else if is_even && k == bins - 1 { powers[k] } else { 2.0 * powers[k] };
            let sum: f64 = (start..end).map(sided).sum();
            prop_assert!((found.sum - sum).abs() < 1e-12 * (1.0 + sum), "{} {sum}", found.sum);
            let largest = (start..end).map(sided).fold(0.0, |most, power| if power > most { power } else { most });
            prop_assert_eq!(found.largest.to_bits(), largest.to_bits());
            let [plain, narrow, wide] =
                in_all_vectors(|| Fold { powers: &powers }).map(|folded| (folded.sum.to_bits(), folded.largest.to_bits()));
            prop_assert_eq!([narrow, wide], [plain; 2]);
        });
    }

    /// Catches P_f found in a bin that the band only touches.
    #[test]
    fn largest_is_of_bins_inside() {
        let grid = Grid::new(100, 100.0); // bins of 1 Hz
        let powers: Vec<f64> = (0..=50).map(|k| if k == 10 { 4.0 } else { 1.0 }).collect();
        let largest = |from, to| {
            let cells = grid.cells(BandEdges::Fractional, from, to).unwrap();
            grid.fold(cells, &powers).largest
        };
        for (from, to, expected) in [(10.0, 20.0, 8.0), (10.1, 20.0, 2.0), (5.0, 10.0, 8.0), (5.0, 9.9, 2.0)] {
            assert!((largest(from, to) - expected).abs() < 1e-12, "{from} to {to}");
        }
    }
}
