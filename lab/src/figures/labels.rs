//! Places the names of curves so that none covers another.

/// Moves heights apart until they are `gap` from each other and, as far as there is room, within `low` to `high`.
pub(super) fn spread(wanted: &[f64], gap: f64, (low, high): (f64, f64)) -> Vec<f64> {
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|&a, &b| wanted[a].total_cmp(&wanted[b]));
    let mut places = wanted.to_vec();
    let mut free = low;
    for &i in &order {
        places[i] = if places[i] < free { free } else { places[i] };
        free = places[i] + gap;
    }
    free = high;
    for &i in order.iter().rev() {
        places[i] = if places[i] > free { free } else { places[i] };
        free = places[i] - gap;
    }
    places
}

/// The name of a curve with the indices that it has in print.
pub(super) fn printed(name: &str) -> &str {
    match name {
        "v_i" => "V",
        "m_1" => "m₁",
        "m_2" => "m₂",
        "e_1" => "E₁",
        "e_2" => "E₂",
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches names on top of each other, out of the picture, or in another order than their curves.
    #[test]
    fn names_are_kept_apart() {
        assert_eq!(spread(&[50.0, 10.0], 15.0, (0.0, 100.0)), [50.0, 10.0]);
        assert_eq!(spread(&[50.0, 49.0, 51.0], 15.0, (0.0, 100.0)), [64.0, 49.0, 79.0]);
        assert_eq!(spread(&[98.0, 99.0, -5.0], 15.0, (0.0, 100.0)), [85.0, 100.0, 0.0]);
    }
}
