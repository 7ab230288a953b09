//! Which cracks are found, against their size: by hit/miss, and by the response.

use crate::statistics::{A_HAT_TARGETS, AHat, HIT_MISS_TARGETS, HitMiss, Refusal, a_hat, hit_miss};
use tapline_draw::canvas::{PALE_INK, Point};
use tapline_draw::palette::COLORS;

use super::draw::{Mark, Plot, axis};
use super::table::{Table, cell};

pub(crate) const DETECTION_COLUMNS: [&str; 8] =
    ["class", "method", "targets", "found", "a50_mm", "a90_mm", "a90_95_mm", "remark"];

/// One crack and what became of it.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    pub size_mm: f64,
    /// If it is known.
    pub depth_mm: Option<f64>,
    pub location_count: u32,
    pub is_found: bool,
    /// Greatest index along its arc; NaN where none of its locations has one.
    pub response: f64,
    /// The response above which it is found.
    pub limit: f64,
}

/// The targets of a class, with both curves or why one is missing.
#[derive(Debug)]
pub(crate) struct Detection {
    pub class: String,
    pub targets: Vec<Target>,
    pub hit_miss: Result<HitMiss, Refusal>,
    pub a_hat: Result<AHat, Refusal>,
}

impl Detection {
    /// Fits both curves, the second to responses over their limits; a target without a response was missed, and is not in the
    /// second.
    pub(crate) fn new(class: String, targets: Vec<Target>) -> Self {
        let sizes: Vec<f64> = targets.iter().map(|t| t.size_mm).collect();
        let is_found: Vec<bool> = targets.iter().map(|t| t.is_found).collect();
        let answered = targets.iter().filter(|t| t.response.is_finite());
        let (answered_sizes, responses): (Vec<f64>, Vec<f64>) =
            answered.map(|t| (t.size_mm, t.response / t.limit)).unzip();
        Self { class, hit_miss: hit_miss(&sizes, &is_found), a_hat: a_hat(&answered_sizes, &responses, 1.0), targets }
    }

    pub(crate) fn found_count(&self) -> usize {
        self.targets.iter().filter(|t| t.is_found).count()
    }

    /// a90 and a90/95 by hit/miss, in words; or why there are none.
    pub(crate) fn sizes_in_words(&self) -> Result<String, &Refusal> {
        let size = |name: &str, size_mm: Option<f64>| match size_mm {
            Some(_) => format!("{name} {} mm", cell(size_mm)),
            None => format!("no {name}"),
        };
        let ([_, a90, a90_95], _) = self.supported(sizes_of(self.hit_miss.as_ref()?));
        Ok(format!("{}, {}", size("a90", a90), size("a90/95", a90_95)))
    }

    /// a90/95 by hit/miss, if the targets support it.
    pub(crate) fn a90_95_mm(&self) -> Option<f64> {
        self.supported(sizes_of(self.hit_miss.as_ref().ok()?)).0[2]
    }

    /// Its two rows in a table of [`DETECTION_COLUMNS`].
    pub(crate) fn push(&self, table: &mut Table) {
        let mut push = |method: &str, sizes: Result<([Option<f64>; 3], String), String>| {
            let (sizes, remark) = sizes.unwrap_or_else(|why| ([None; 3], why));
            let head = [self.class.clone().into(), method.into(), self.targets.len().into(), self.found_count().into()];
            table.push(head.into_iter().chain(sizes.map(cell)).chain([remark.into()]));
        };
        let with_remarks = |sizes: [Option<f64>; 3], mut remarks: Vec<String>| {
            let (sizes, missing) = self.supported(sizes);
            remarks.push(missing);
            remarks.retain(|remark| !remark.is_empty());
            (sizes, remarks.join("; "))
        };
        let of_hits = self.hit_miss.as_ref().map(|h| with_remarks(sizes_of(h), vec![few(h.targets, HIT_MISS_TARGETS)]));
        push("hit/miss", of_hits.map_err(ToString::to_string));
        let of_responses = self
            .a_hat
            .as_ref()
            .map(|a| with_remarks([a.a50, a.a90, a.a90_95_likelihood], vec![few(a.targets, A_HAT_TARGETS), uneven(a)]));
        push("response", of_responses.map_err(ToString::to_string));
    }

    /// Those of a50, a90 and a90/95 that lie among the sizes of the targets, and a remark on the others: farther out a curve only
    /// follows its formula.
    fn supported(&self, found: [Option<f64>; 3]) -> ([Option<f64>; 3], String) {
        let sizes = || self.targets.iter().map(|target| target.size_mm);
        let is_within = |size: &f64| sizes().any(|of| of <= *size) && sizes().any(|of| of >= *size);
        let sizes = found.map(|size| size.filter(is_within));
        let is_bounded = found[2].is_some();
        // Where a curve gives no a50 or a90 they are farther still; an a90/95 that is not given has no bound.
        let named = [("a50", true), ("a90", true), ("a90/95", is_bounded)].into_iter().zip(sizes);
        let names: Vec<&str> =
            named.filter(|((_, is_given), size)| *is_given && size.is_none()).map(|((name, _), _)| name).collect();
        let mut remarks = Vec::new();
        if !names.is_empty() {
            remarks.push(format!("{} beyond the sizes of the targets", names.join(" and ")));
        }
        if !is_bounded {
            remarks.push("no a90/95: larger cracks may not be found more easily".to_owned());
        }
        (sizes, remarks.join("; "))
    }

    /// Both curves over sizes from `low` to `high` mm, with the targets; `label` says what the size is.
    pub(crate) fn plot(&self, label: &str, (low, high): Point) -> Plot {
        let sizes = || (0..=110_u32).map(|k| low + (high - low) * f64::from(k) / 110.0);
        let at = |found: bool| -> Vec<Point> {
            let targets = self.targets.iter().filter(|t| t.is_found == found);
            targets.map(|t| (t.size_mm, if found { 1.0 } else { 0.0 })).collect()
        };
        let mut marks = vec![
            Mark::Line(vec![(low, 0.9), (high, 0.9)], PALE_INK, 1.0),
            Mark::Rings(at(true), COLORS[2], 2.5),
            Mark::Rings(at(false), COLORS[3], 2.5),
        ];
        let mut name = self.class.clone();
        if let Ok(h) = &self.hit_miss {
            marks.push(Mark::Line(sizes().filter_map(|x| Some((x, h.pod(x)?))).collect(), COLORS[0], 2.25));
            marks.push(Mark::Line(sizes().filter_map(|x| Some((x, h.pod_lower_95(x)?))).collect(), COLORS[0], 1.0));
        } else {
            name.push_str(": no curve by hit/miss");
        }
        if let Ok(a) = &self.a_hat {
            marks.push(Mark::Line(sizes().filter_map(|x| Some((x, a.pod(x)?))).collect(), COLORS[1], 2.25));
            marks.push(Mark::Line(sizes().filter_map(|x| Some((x, a.pod_lower_95(x)?))).collect(), COLORS[1], 1.0));
        }
        Plot::new(name, axis(label, (low, high), 8), axis("Probability of detection", (-0.05, 1.05), 6), marks)
    }
}

/// a50, a90 and a90/95 of a curve of hits and misses.
fn sizes_of(curve: &HitMiss) -> [Option<f64>; 3] {
    [curve.a50, curve.a90, curve.a90_95_likelihood]
}

/// That there are fewer targets than the handbook trusts.
fn few(count: usize, wanted: usize) -> String {
    if count < wanted {
        format!("{count} targets; MIL-HDBK-1823A asks for at least {wanted} of them")
    } else {
        String::new()
    }
}

/// That the line of responses does not have the scatter that it assumes.
fn uneven(line: &AHat) -> String {
    if line.has_even_scatter {
        String::new()
    } else {
        "responses scatter differently at different sizes, which the line does not allow for: use hit/miss".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a size that the curve gives far beyond all targets, in a cell or in words, and a missing a90/95 without a word.
    #[test]
    fn what_the_targets_do_not_support_is_remarked() {
        let found =
            [6.0, 9.0, 12.0, 16.0, 21.0, 27.0].into_iter().flat_map(|size_mm| (0..12).map(move |k| (size_mm, k)));
        let target = |(size_mm, k): (f64, u32)| {
            let is_found = k % 12 < 7 + (size_mm / 14.0) as u32;
            Target { size_mm, depth_mm: None, location_count: 1, is_found, response: f64::NAN, limit: 1.0 }
        };
        let detection = Detection::new("all".to_owned(), found.map(target).collect());
        let mut table = Table::new("detection", "", DETECTION_COLUMNS);
        detection.push(&mut table);
        let text = table.csv().unwrap();
        for remark in ["a50 and a90 beyond the sizes of the targets", "no a90/95"] {
            assert!(text.lines().nth(1).unwrap().contains(remark), "{text}");
        }
        // The targets are 6 to 27 mm long.
        assert!(detection.hit_miss.as_ref().unwrap().a50.is_some_and(|size| size < 6.0), "{detection:?}");
        assert!(text.lines().nth(1).unwrap().starts_with("all,hit/miss,72,45,,,,"), "{text}");
        assert_eq!(detection.sizes_in_words().unwrap(), "no a90, no a90/95");
        // A bound beyond them is remarked too.
        let (sizes, remark) = detection.supported([Some(7.0), Some(27.0), Some(1040.0)]);
        assert_eq!(sizes, [Some(7.0), Some(27.0), None]);
        assert_eq!(remark, "a90/95 beyond the sizes of the targets");
    }

    /// Catches one limit for all targets: whoever judges a shoulder on another scale finds the same cracks.
    #[test]
    fn responses_are_compared_with_their_own_limits() {
        let curve = |scale: fn(u32) -> f64| {
            let target = |k: u32| {
                let size_mm = 4.0 + 0.5 * f64::from(k);
                let response = size_mm.ln() - 2.0 + 0.06 * f64::from(7 * k % 11);
                let (response, limit) = (scale(k) * response, scale(k) * 0.4);
                Target { size_mm, depth_mm: None, location_count: 1, is_found: response > limit, response, limit }
            };
            let detection = Detection::new("all".to_owned(), (0..60).map(target).collect());
            detection.a_hat.unwrap().a90.unwrap()
        };
        let (alike, different) = (curve(|_| 1.0), curve(|k| if k < 30 { 1.0 } else { 3.0 }));
        assert!((different / alike - 1.0).abs() < 1e-9, "{different} {alike}");
    }
}
