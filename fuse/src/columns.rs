//! The values of readings, condition by condition and discriminator by discriminator, in one piece of memory.

/// Columns of values in slots `condition x width + discriminator`.
pub(crate) struct Columns {
    /// Room for every column, one after the other.
    values: Vec<f64>,
    /// Where the column of each slot begins, and where its values end.
    spans: Vec<(usize, usize)>,
}

impl Columns {
    /// Room for readings of these `conditions`, each with a value for every discriminator at most.
    pub(crate) fn of(conditions: impl Iterator<Item = usize>, condition_count: usize, width: usize) -> Self {
        let mut counts = vec![0; condition_count];
        conditions.for_each(|condition| counts[condition] += 1);
        let mut spans = Vec::with_capacity(condition_count * width);
        let mut end = 0;
        for count in counts {
            for _ in 0..width {
                spans.push((end, end));
                end += count;
            }
        }
        Self { values: vec![0.0; end], spans }
    }

    /// Adds `value` to the column of `slot`.
    pub(crate) fn push(&mut self, slot: usize, value: f64) {
        let end = &mut self.spans[slot].1;
        self.values[*end] = value;
        *end += 1;
    }

    /// Gives every slot with its column, which may be reordered, to `each`.
    pub(crate) fn for_each(mut self, mut each: impl FnMut(usize, &mut [f64])) {
        for (slot, &(first, end)) in self.spans.iter().enumerate() {
            each(slot, &mut self.values[first..end]);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_column_has_its_values(
            width in 1_usize..8,
            readings in prop::collection::vec((0_usize..5, prop::collection::vec(prop::option::of(-9.0..9.0), 8)), 0..40),
        ) {
            // Catches a column that runs into the next one, and absent values that shift the rest.
            let mut slow: Vec<Vec<f64>> = vec![Vec::new(); 5 * width];
            let mut columns = Columns::of(readings.iter().map(|&(condition, _)| condition), 5, width);
            for (condition, values) in &readings {
                for (slot, value) in (condition * width..).zip(&values[..width]) {
                    slow[slot].extend(*value);
                    value.iter().for_each(|&value| columns.push(slot, value));
                }
            }
            let mut found = vec![Vec::new(); 5 * width];
            columns.for_each(|slot, column| found[slot] = column.to_vec());
            prop_assert_eq!(found, slow);
        }
    }
}
