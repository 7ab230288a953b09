//! Agreement on categories beyond chance: kappa.

/// Fleiss' kappa of subjects that were rated several times: the part of the agreement that chance leaves open which was reached, 1 if
/// all ratings of each subject agree, 0 if they agree as often as by chance.
///
/// `counts` has how often each subject was put into each category. Subjects rated once say nothing of agreement, and are left out. The
/// others count the same, however often each was rated (Fleiss 1971 has as many ratings of each). `None` without such a subject, and
/// where all ratings are one category: chance then leaves nothing open.
pub fn fleiss_kappa<const N: usize>(counts: &[[usize; N]]) -> Option<f64> {
    let rated: Vec<(&[usize; N], f64)> =
        counts.iter().map(|of| (of, of.iter().sum::<usize>() as f64)).filter(|&(_, all)| all > 1.0).collect();
    let used = (0..N).filter(|&category| rated.iter().any(|(of, _)| of[category] > 0));
    if used.count() < 2 {
        return None;
    }
    let mean = |of_subject: &dyn Fn(&[usize; N], f64) -> f64| {
        rated.iter().map(|&(of, all)| of_subject(of, all)).sum::<f64>() / rated.len() as f64
    };
    let pairs = |of: &[usize; N], all: f64| {
        of.iter().map(|&count| count as f64 * (count as f64 - 1.0)).sum::<f64>() / (all * (all - 1.0))
    };
    let by_chance = (0..N).map(|category| mean(&|of, all| of[category] as f64 / all).powi(2)).sum();
    Some(beyond_chance(mean(&pairs), by_chance))
}

/// Cohen's kappa of two raters: as [`fleiss_kappa`], but with the chance of each rater's own frequencies.
///
/// `table[a][b]` is how often the first put a subject into category `a` and the second into `b`; numbers need not be whole. `None` of an
/// empty table, and where both raters use a single category, the same one.
pub fn cohen_kappa<const N: usize>(table: &[[f64; N]; N]) -> Option<f64> {
    let of_first = table.map(|row| row.iter().sum::<f64>());
    let of_second: [f64; N] = std::array::from_fn(|b| table.iter().map(|row| row[b]).sum());
    if (0..N).filter(|&category| of_first[category] + of_second[category] > 0.0).count() < 2 {
        return None;
    }
    let all: f64 = of_first.iter().sum();
    let agreed: f64 = (0..N).map(|category| table[category][category]).sum();
    let by_chance: f64 = of_first.iter().zip(of_second).map(|(a, b)| a * b).sum();
    Some(beyond_chance(agreed / all, by_chance / (all * all)))
}

fn beyond_chance(agreed: f64, by_chance: f64) -> f64 {
    (agreed - by_chance) / (1.0 - by_chance)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_near(got: Option<f64>, expected: f64) -> bool {
        got.is_some_and(|got| (got - expected).abs() < 1e-12)
    }

    /// Catches pairs of a rating with itself, the chance of Cohen's kappa, and weights by ratings. The first table is that of Fleiss
    /// 1971 as worked out in textbooks: statsmodels' `fleiss_kappa` of it is 0.20993070442195522. The second, of unequal numbers, by
    /// hand: P = (1 + 1/3)/2, chance (5/6)^2 + (1/6)^2.
    #[test]
    fn fleiss_kappa_is_that_of_statsmodels() {
        let table = [
            [0, 0, 0, 0, 14],
            [0, 2, 6, 4, 2],
            [0, 0, 3, 5, 6],
            [0, 3, 9, 2, 0],
            [2, 2, 8, 1, 1],
            [7, 7, 0, 0, 0],
            [3, 2, 6, 3, 0],
            [2, 5, 3, 2, 2],
            [6, 5, 2, 1, 0],
            [0, 2, 2, 3, 7],
        ];
        assert!(is_near(fleiss_kappa(&table), 0.209_930_704_421_955_22), "{:?}", fleiss_kappa(&table));
        let unequal = [[2, 0], [2, 1], [0, 1]];
        assert!(is_near(fleiss_kappa(&unequal), -0.2), "{:?}", fleiss_kappa(&unequal));
        assert_eq!((fleiss_kappa(&[[3, 0], [2, 0], [0, 1]]), fleiss_kappa::<3>(&[])), (None, None));
    }

    /// Catches the chance of Fleiss' kappa, and raters that are mixed up. statsmodels' `cohens_kappa` of
    /// [[10, 3, 0], [2, 4, 1], [0, 2, 8]] is 0.5939086294416243.
    #[test]
    fn cohen_kappa_is_that_of_statsmodels() {
        let table = [[10.0, 3.0, 0.0], [2.0, 4.0, 1.0], [0.0, 2.0, 8.0]];
        assert!(is_near(cohen_kappa(&table), 0.593_908_629_441_624_3), "{:?}", cohen_kappa(&table));
        let halved = table.map(|row| row.map(|count| 0.5 * count));
        assert!(is_near(cohen_kappa(&halved), 0.593_908_629_441_624_3), "{:?}", cohen_kappa(&halved));
        // Raters who never agree, each with one category of their own, agree as often as by chance: never.
        assert!(is_near(cohen_kappa(&[[0.0, 2.0], [0.0, 0.0]]), 0.0));
        assert_eq!((cohen_kappa(&[[0.0, 0.0], [0.0, 2.0]]), cohen_kappa(&[[0.0; 3]; 3])), (None, None));
    }
}
