//! Places the names of points: next to their points, and not over another name.

use tapline_draw::canvas::Point as Place;

use super::{LINE_PX, TEXT_PX, width_of};

/// Distances that are tried, from the edge of the point.
const REACHES: [f64; 9] = [3.0, 8.0, 16.0, 26.0, 38.0, 54.0, 74.0, 98.0, 126.0];
/// Directions that are tried.
const DIRECTIONS: usize = 16;
/// Distance from which a line connects point and name.
const LEADER_FROM: f64 = 9.0;
/// How often each name is placed again, given all others.
const PASSES: usize = 4;

/// A name and its point.
#[derive(Debug, Clone)]
pub(super) struct Named {
    pub text: String,
    pub is_bold: bool,
    pub place: Place,
    /// Radius of the point's mark.
    pub radius: f64,
    /// Names of lower rank are placed first.
    pub rank: (bool, bool),
}

/// A line that a name should not cover, and the penalty if it does.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub ends: (Place, Place),
    pub cost: f64,
}

/// A name that has a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placed {
    pub middle: Place,
    /// From the point to the name.
    pub leader: Option<(Place, Place)>,
}

/// A rectangle: of a name, of a mark, or of the area for names.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rect {
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
}

impl Rect {
    fn around((x, y): Place, half_width: f64, half_height: f64) -> Self {
        Self { left: x - half_width, right: x + half_width, top: y - half_height, bottom: y + half_height }
    }

    /// How far the middle of `other` is from it.
    fn distance_to(&self, other: &Self) -> f64 {
        let (x, y) = (0.5 * (other.left + other.right), 0.5 * (other.top + other.bottom));
        (x - x.clamp(self.left, self.right)).hypot(y - y.clamp(self.top, self.bottom))
    }

    fn meets(&self, other: &Self) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    /// Whether the line from `a` to `b` comes near, tested at points on it.
    fn is_crossed(&self, (a, b): (Place, Place)) -> bool {
        (0..=40).map(|k| f64::from(k) / 40.0).any(|t| {
            let (x, y) = (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1));
            (self.left..self.right).contains(&x) && (self.top..self.bottom).contains(&y)
        })
    }
}

/// A place that a name may have.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    of: Rect,
    placed: Placed,
    /// Penalty of its distance, and of the lines that it covers.
    badness: f64,
}

/// A place for each of `names`; `None` for one that must cover another.
pub(super) fn place(names: &[Named], lines: &[Line], room: &Rect) -> Vec<Option<Placed>> {
    let mark = |name: &Named| Rect::around(name.place, name.radius + 2.0, name.radius + 2.0);
    let marks: Vec<Rect> = names.iter().map(mark).collect();
    let candidates: Vec<Vec<Candidate>> = names.iter().map(|name| candidates(name, lines, room)).collect();
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by_key(|&k| names[k].rank);
    let mut chosen: Vec<Option<Candidate>> = vec![None; names.len()];
    for _ in 0..PASSES {
        for &k in &order {
            let others: Vec<Candidate> =
                chosen.iter().enumerate().filter(|(other, _)| *other != k).filter_map(|(_, c)| *c).collect();
            let costs =
                candidates[k].iter().filter_map(|candidate| Some((cost(candidate, k, &marks, &others)?, candidate)));
            chosen[k] = costs.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, candidate)| *candidate);
        }
    }
    chosen.into_iter().map(|candidate| candidate.map(|candidate| candidate.placed)).collect()
}

fn candidates(name: &Named, lines: &[Line], room: &Rect) -> Vec<Candidate> {
    let half_width = 0.5 * width_of(&name.text, TEXT_PX, name.is_bold) + 1.0;
    let half_height = 0.5 * LINE_PX - 1.0;
    let (x, y) = name.place;
    let mut all = Vec::new();
    for reach in REACHES {
        for direction in 0..DIRECTIONS {
            let (sin, cos) = (std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64).sin_cos();
            // Its edge, not its middle, has this distance.
            let away = name.radius + reach;
            let middle = (x + cos * away + stretched(cos) * half_width, y + sin * away + stretched(sin) * half_height);
            let of = Rect::around(middle, half_width, half_height);
            if of.left < room.left || of.right > room.right || of.top < room.top || of.bottom > room.bottom {
                continue;
            }
            let near = (x.clamp(of.left, of.right), y.clamp(of.top, of.bottom));
            let from = (x + cos * (name.radius + 1.0), y + sin * (name.radius + 1.0));
            let leader = (reach >= LEADER_FROM).then_some((from, near));
            let on_lines: f64 = lines.iter().filter(|line| of.is_crossed(line.ends)).map(|line| line.cost).sum();
            all.push(Candidate { of, placed: Placed { middle, leader }, badness: reach + on_lines });
        }
    }
    all
}

/// A component of a direction, stretched towards -1 or 1, so that names are at corners and edges of their points.
fn stretched(part: f64) -> f64 {
    (1.5 * part).clamp(-1.0, 1.0)
}

/// The penalty of a place; `None` if it covers another name.
fn cost(candidate: &Candidate, own: usize, marks: &[Rect], others: &[Candidate]) -> Option<f64> {
    if others.iter().any(|other| other.of.meets(&candidate.of)) {
        return None;
    }
    let on_marks = marks.iter().enumerate().filter(|(k, mark)| *k != own && mark.meets(&candidate.of)).count();
    // Next to another point a name is read as that point's.
    let own_distance = candidate.of.distance_to(&marks[own]);
    let mut others_marks = marks.iter().enumerate().filter(|(k, _)| *k != own);
    let is_near_another = others_marks.any(|(_, mark)| candidate.of.distance_to(mark) < 1.4 * own_distance - 1.0);
    let astray = usize::from(candidate.placed.leader.is_none() && is_near_another);
    let crossing = |of: &Rect, leader: &Option<(Place, Place)>| leader.is_some_and(|leader| of.is_crossed(leader));
    let crossed = others.iter().filter(|other| crossing(&candidate.of, &other.placed.leader)).count()
        + others.iter().filter(|other| crossing(&other.of, &candidate.placed.leader)).count();
    let through = candidate
        .placed
        .leader
        .map_or(0, |leader| marks.iter().enumerate().filter(|(k, mark)| *k != own && mark.is_crossed(leader)).count());
    let on_others = 150.0 * on_marks as f64 + 80.0 * crossed as f64 + 25.0 * (astray + through) as f64;
    Some(candidate.badness + on_others)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches names on names, on points of others, or outside of the room; a dozen crowded points must all have one.
    #[test]
    fn names_do_not_stand_on_names() {
        let room = Rect { left: 0.0, right: 420.0, top: 0.0, bottom: 330.0 };
        let named = |k: u32| Named {
            text: format!("point number {k}"),
            is_bold: k == 0,
            place: (200.0 + f64::from(k * 37 % 11) * 4.0, 150.0 + f64::from(k * 53 % 13) * 4.0),
            radius: 4.5,
            rank: (k > 0, k > 3),
        };
        let names: Vec<Named> = (0..12).map(named).collect();
        let boxes: Vec<Rect> = place(&names, &[], &room)
            .into_iter()
            .zip(&names)
            .map(|(placed, name)| {
                let half = 0.5 * width_of(&name.text, TEXT_PX, name.is_bold);
                Rect::around(placed.expect("there is room").middle, half, 0.5 * TEXT_PX)
            })
            .collect();
        for (k, a) in boxes.iter().enumerate() {
            assert!(a.left >= room.left && a.right <= room.right && a.top >= room.top && a.bottom <= room.bottom);
            assert!(boxes[..k].iter().all(|b| !a.meets(b)), "{k}: {a:?} {boxes:?}");
        }
    }

    /// Catches a name nearer to another point than to its own, and read as that one's: two points with upright intervals, at
    /// the right edge of the room.
    #[test]
    fn a_name_is_nearest_to_its_own_point() {
        let room = Rect { left: 0.0, right: 426.0, top: 95.0, bottom: 396.0 };
        for (apart, lower) in (60..100).step_by(4).flat_map(|apart| (-20..=20).step_by(4).map(move |y| (apart, y))) {
            let places = [(405.0 - f64::from(apart), 210.0), (405.0, 210.0 + f64::from(lower))];
            let named = |text: &str, place| Named {
                text: text.to_owned(),
                is_bold: false,
                place,
                radius: 4.5,
                rank: (false, false),
            };
            let names = [named("less noise", places[0]), named("less hum", places[1])];
            let upright = |(x, y): Place| Line { ends: ((x, y - 50.0), (x, y + 50.0)), cost: 12.0 };
            let mark = |name: &Named| Rect::around(name.place, name.radius, name.radius);
            for (name, placed) in names.iter().zip(place(&names, &places.map(upright), &room)) {
                let placed = placed.expect("there is room");
                let of = Rect::around(placed.middle, 0.5 * width_of(&name.text, TEXT_PX, false), 0.5 * TEXT_PX);
                let is_own = |other: &Named| of.distance_to(&mark(name)) <= of.distance_to(&mark(other));
                assert!(placed.leader.is_some() || names.iter().all(is_own), "{}: {apart} {lower}", name.text);
            }
        }
    }
}
