//! Places for names beside their points, so that none covers another, a dot or a line.

use headbox_core::drawing::{Anchor, letters};

/// A rectangle: left, top, right, bottom.
type Box4 = [f64; 4];

/// What is already on the paper.
pub(super) struct Labels {
    paper: Box4,
    taken: Vec<Box4>,
    /// Middles of dots: a name must not be nearer to another's than to its own.
    dots: Vec<[f64; 2]>,
    /// Points of lines: names may cross them if there is no other place.
    crossed: Vec<[f64; 2]>,
}

impl Labels {
    /// Nothing yet, on paper of this extent.
    pub(super) fn new(paper: Box4) -> Self {
        Self { paper, taken: Vec::new(), dots: Vec::new(), crossed: Vec::new() }
    }

    pub(super) fn avoid_dot(&mut self, [x, y]: [f64; 2], radius: f64) {
        self.taken.push([x - radius, y - radius, x + radius, y + radius]);
        self.dots.push([x, y]);
    }

    pub(super) fn avoid_line(&mut self, points: &[[f64; 2]]) {
        const STEP_PX: f64 = 3.0;
        for pair in points.windows(2) {
            let [[ax, ay], [bx, by]] = [pair[0], pair[1]];
            let steps = ((bx - ax).hypot(by - ay) / STEP_PX).ceil().clamp(1.0, 2000.0) as u32;
            let along = (0..=steps).map(|i| f64::from(i) / f64::from(steps));
            self.crossed.extend(along.map(|t| [ax + (bx - ax) * t, ay + (by - ay) * t]));
        }
    }

    /// Where to write a name beside the dot at `at`: the place with the least in its way, the first of equals.
    pub(super) fn place(&mut self, at: [f64; 2], name: &str, size: f64, radius: f64) -> ([f64; 2], Anchor) {
        let width = letters::width_px(name, size);
        let gap = radius + 4.0;
        let (ascent, descent) = (size * 0.75, size * 0.22);
        let middle = (ascent - descent) / 2.0;
        let candidates = [
            ([gap, middle], Anchor::Start),
            ([gap, -gap], Anchor::Start),
            ([gap, gap + ascent], Anchor::Start),
            ([0.0, -gap - descent], Anchor::Middle),
            ([0.0, gap + ascent], Anchor::Middle),
            ([-gap, middle], Anchor::End),
            ([-gap, -gap], Anchor::End),
            ([-gap, gap + ascent], Anchor::End),
            ([0.0, -gap - 1.2 * size], Anchor::Middle),
            ([0.0, gap + ascent + 1.2 * size], Anchor::Middle),
            ([gap, -gap - 1.2 * size], Anchor::Start),
            ([gap, gap + ascent + 1.2 * size], Anchor::Start),
            ([-gap, -gap - 1.2 * size], Anchor::End),
            ([-gap, gap + ascent + 1.2 * size], Anchor::End),
        ];
        let around = |[dx, dy]: [f64; 2], anchor| {
            let left = at[0] + dx - [0.0, width / 2.0, width][anchor as usize];
            [left - 1.0, at[1] + dy - ascent, left + width + 1.0, at[1] + dy + descent]
        };
        let cost = |place: &Box4| {
            let overlaps = |other: &Box4| {
                let along = |low: usize| (place[low + 2].min(other[low + 2]) - place[low].max(other[low])).max(0.0);
                along(0) * along(1)
            };
            let inside = |p: &&[f64; 2]| (place[0]..place[2]).contains(&p[0]) && (place[1]..place[3]).contains(&p[1]);
            let over_edge = (self.paper[0] - place[0]).max(0.0)
                + (self.paper[1] - place[1]).max(0.0)
                + (place[2] - self.paper[2]).max(0.0)
                + (place[3] - self.paper[3]).max(0.0);
            let covered: f64 = self.taken.iter().map(overlaps).sum();
            let own = distance(place, at);
            let strangers = self.dots.iter().filter(|&&dot| dot != at && distance(place, dot) < own + STRANGER_PX);
            1e3 * over_edge
                + 10.0 * covered
                + 300.0 * strangers.count() as f64
                + 8.0 * self.crossed.iter().filter(inside).count() as f64
        };
        let mut best = (f64::INFINITY, candidates[0]);
        for (rank, &(offset, anchor)) in candidates.iter().enumerate() {
            let cost = cost(&around(offset, anchor)) + rank as f64;
            if cost < best.0 {
                best = (cost, (offset, anchor));
            }
        }
        let (offset, anchor) = best.1;
        self.taken.push(around(offset, anchor));
        ([at[0] + offset[0], at[1] + offset[1]], anchor)
    }
}

/// How much nearer a name should be to its own dot than to another.
const STRANGER_PX: f64 = 6.0;

/// From a rectangle to a point, 0 inside.
fn distance([left, top, right, bottom]: &Box4, [x, y]: [f64; 2]) -> f64 {
    let beyond = |low: f64, v: f64, high: f64| (low - v).max(v - high).max(0.0);
    beyond(*left, x, *right).hypot(beyond(*top, y, *bottom))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_close_points_do_not_cover_each_other() {
        let mut labels = Labels::new([0.0, 0.0, 400.0, 300.0]);
        let points = [[200.0, 100.0], [204.0, 103.0], [198.0, 108.0], [395.0, 150.0]];
        points.iter().for_each(|p| labels.avoid_dot(*p, 4.0));
        points.iter().for_each(|p| {
            labels.place(*p, "a long name", 12.0, 4.0);
        });
        let names = &labels.taken[points.len()..];
        for (i, a) in names.iter().enumerate() {
            assert!(a[0] >= 0.0 && a[2] <= 400.0 && a[1] >= 0.0 && a[3] <= 300.0, "{a:?}");
            for b in &labels.taken[..points.len() + i] {
                let along = |low: usize| a[low + 2].min(b[low + 2]) - a[low].max(b[low]);
                assert!(along(0) <= 0.0 || along(1) <= 0.0, "{a:?} over {b:?}");
            }
        }
    }
    #[test]
    fn a_name_is_nearest_to_its_own_dot() {
        let mut labels = Labels::new([0.0, 0.0, 400.0, 300.0]);
        // One above the other, as the bytes of one capture drawn in two ways.
        let points = [[100.0, 100.0], [100.0, 122.0], [100.0, 50.0], [180.0, 118.0]];
        points.iter().for_each(|p| labels.avoid_dot(*p, 5.0));
        for (i, at) in points.iter().enumerate() {
            labels.place(*at, "name", 12.0, 5.0);
            let place = labels.taken.last().expect("placed");
            let others = points.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, other)| distance(place, *other));
            assert!(others.fold(f64::INFINITY, f64::min) > distance(place, *at), "{i}: {place:?}");
        }
    }
}
