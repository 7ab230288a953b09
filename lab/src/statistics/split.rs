//! Leave-one-out: each tyre is scored by a model of the others.

use std::collections::BTreeMap;

use tapline_fuse::auc;

/// One tyre left out, or whatever the groups are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split<G> {
    /// The group that is left out.
    pub left_out: G,
    /// Places of the others.
    pub train: Vec<usize>,
    /// Places of the group.
    pub test: Vec<usize>,
}

/// Every group left out once, in the order of the groups; `None` for fewer than two groups.
pub fn leave_one_out<G: Ord + Clone>(groups: &[G]) -> Option<Vec<Split<G>>> {
    let mut places: BTreeMap<&G, Vec<usize>> = BTreeMap::new();
    for (place, group) in groups.iter().enumerate() {
        places.entry(group).or_default().push(place);
    }
    let split = |(&group, test): (&&G, &Vec<usize>)| Split {
        left_out: group.clone(),
        train: (0..groups.len()).filter(|&place| groups[place] != *group).collect(),
        test: test.clone(),
    };
    (places.len() > 1).then(|| places.iter().map(split).collect())
}

/// AUC of each group by what `fit` makes of all others, in the order of the groups; `None` of a group that has one class.
///
/// Group by group and not pooled: three tyres are three numbers, and their scatter is all that is known of the next one.
/// `None` for fewer than two groups.
///
/// # Panics
/// If there are not as many labels as groups.
pub fn auc_left_out<G: Ord + Clone, M>(
    groups: &[G],
    labels: &[bool],
    mut fit: impl FnMut(&[usize]) -> M,
    score: impl Fn(&M, usize) -> f64,
) -> Option<Vec<(G, Option<f64>)>> {
    assert_eq!(groups.len(), labels.len(), "one label a place");
    let of = |split: Split<G>| {
        let model = fit(&split.train);
        let scores: Vec<f64> = split.test.iter().map(|&place| score(&model, place)).collect();
        let labels: Vec<bool> = split.test.iter().map(|&place| labels[place]).collect();
        (split.left_out, auc(&scores, &labels))
    };
    Some(leave_one_out(groups)?.into_iter().map(of).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_place_trains_and_tests() {
        // Catches a place of the tyre left out among those that train, or one that is lost.
        let groups = ["b", "a", "b", "c", "a", "b"];
        let splits = leave_one_out(&groups).unwrap();
        assert_eq!(splits.iter().map(|s| s.left_out).collect::<String>(), "abc");
        for split in &splits {
            assert!(split.train.iter().all(|&p| groups[p] != split.left_out));
            assert!(split.test.iter().all(|&p| groups[p] == split.left_out));
            assert_eq!(split.train.len() + split.test.len(), groups.len());
        }
        assert_eq!((leave_one_out(&["a", "a"]), leave_one_out::<u8>(&[])), (None, None));
    }

    #[test]
    fn each_group_has_its_own_number() {
        // Catches numbers that are pooled, fitted to the group itself, or made up for one with a single class.
        let groups = [1, 1, 1, 2, 2, 2, 3, 3];
        let labels = [true, false, false, false, true, false, false, false];
        let x = [5.0, 1.0, 2.0, 9.0, 1.0, 2.0, 4.0, 4.0];
        let mut seen = Vec::new();
        let fit = |train: &[usize]| seen.push(train.to_vec());
        let auc = auc_left_out(&groups, &labels, fit, |(), place| x[place]).unwrap();
        assert_eq!(auc, [(1, Some(1.0)), (2, Some(0.0)), (3, None)]);
        assert_eq!(seen[1], [0, 1, 2, 6, 7]);
    }
}
