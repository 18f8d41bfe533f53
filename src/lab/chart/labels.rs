//! Placement of labels, clear of each other, of dots and of lines.

use glam::{DVec2, dvec2};
use headbox_core::drawing::svg::text_width;

/// An axis-aligned box: its least and greatest corner, pixels.
type Rect = [DVec2; 2];

/// Distance between a dot's centre and a label beside it, pixels.
const GAP_PX: f64 = 8.0;
/// Distance between a dot's centre and a label above which a leader line joins them, pixels.
const BESIDE_PX: f64 = 12.0;
/// Distance by which a label should be nearer to its own dot than to any other, pixels.
const OWN_MARGIN_PX: f64 = 6.0;
/// Distances from the dot at which a label is tried, pixels.
const RINGS_PX: [f64; 5] = [GAP_PX, 16.0, 26.0, 38.0, 52.0];
/// Directions from the dot in which a label is tried, best first.
const DIRECTIONS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [1.0, -1.0],
    [1.0, 1.0],
    [0.0, -1.0],
    [0.0, 1.0],
    [-1.0, 0.0],
    [-1.0, -1.0],
    [-1.0, 1.0],
];

/// A label with its position.
#[derive(Clone, Copy)]
pub(super) struct Placement {
    /// Box of the text.
    rect: Rect,
    /// Direction from the dot to the label.
    direction: DVec2,
    /// Line from the dot to the nearest point of the box.
    leader: [DVec2; 2],
}

impl Placement {
    /// Returns the position of the text on its baseline, and its anchor there.
    pub(super) fn baseline(&self) -> (DVec2, &'static str) {
        let [low, high] = self.rect;
        let share = 0.5 - 0.5 * self.direction.x;
        let anchor = ["start", "middle", "end"][(2.0 * share) as usize];
        (
            dvec2(
                low.x + share * (high.x - low.x),
                high.y - 0.27 * (high.y - low.y),
            ),
            anchor,
        )
    }

    /// Returns the leader line, if the label is not beside its dot.
    pub(super) fn leader(&self) -> Option<[DVec2; 2]> {
        let [dot, end] = self.leader;
        (dot.distance(end) > BESIDE_PX)
            .then(|| [dot + (end - dot).clamp_length_max(0.6 * GAP_PX), end])
    }
}

/// Places each label near its dot so that it hides as little as possible. `lines` may be crossed
/// where there is no other place.
pub(super) fn place_labels(
    dots: &[(DVec2, &str)],
    size: f64,
    area: Rect,
    lines: &[Vec<DVec2>],
) -> Vec<Placement> {
    const ROUNDS: usize = 4;
    let on_lines: Vec<DVec2> = lines
        .iter()
        .flat_map(|line| line.windows(2))
        .flat_map(sample)
        .collect();
    let mut placements: Vec<Option<Placement>> = vec![None; dots.len()];
    for i in (0..dots.len()).cycle().take(ROUNDS * dots.len()) {
        let (dot, text) = dots[i];
        let others: Vec<Placement> = placements
            .iter()
            .enumerate()
            .filter(|(j, _)| *j != i)
            .filter_map(|(_, other)| *other)
            .collect();
        let other_dots = || {
            dots.iter()
                .map(|(other, _)| *other)
                .filter(|other| other.distance(dot) > 0.5 * GAP_PX)
        };
        let dot_boxes = other_dots().map(|other| [other - 0.5 * GAP_PX, other + 0.5 * GAP_PX]);
        let boxes: Vec<Rect> = others
            .iter()
            .map(|other| other.rect)
            .chain(dot_boxes)
            .collect();
        let cost = |rank: usize, Placement { rect, leader, .. }: &Placement| {
            let outside =
                (area[0] - rect[0]).max(DVec2::ZERO) + (rect[1] - area[1]).max(DVec2::ZERO);
            let covered: f64 = boxes.iter().map(|other| overlap(rect, other)).sum();
            let own = distance(rect, dot).min(BESIDE_PX) + OWN_MARGIN_PX;
            let nearer = other_dots()
                .filter(|other| distance(rect, *other) < own)
                .count() as f64;
            let crossing = on_lines
                .iter()
                .copied()
                .chain(others.iter().flat_map(|other| sample(&other.leader)));
            let crossed = crossing
                .filter(|point| distance(rect, *point) < 2.0)
                .count() as f64;
            let is_hidden =
                |point: &DVec2| boxes.iter().any(|other| distance(other, *point) == 0.0);
            let hidden = sample(leader).filter(is_hidden).count() as f64;
            // Weights chosen by eye on the charts of docs/results.
            let distances = 3.0 * rank as f64 + 200.0 * nearer;
            1e3 * outside.element_sum()
                + 10.0 * covered
                + 60.0 * crossed
                + 80.0 * hidden
                + distances
        };
        let half = 0.5 * dvec2(text_width(text, size), 1.2 * size);
        let candidates = RINGS_PX
            .iter()
            .flat_map(|ring| DIRECTIONS.map(|direction| (*ring, DVec2::from(direction))));
        let candidates = candidates.map(|(ring, direction)| {
            let center = dot + direction * (half + ring);
            let rect = [center - half, center + half];
            Placement {
                rect,
                direction,
                leader: [dot, dot.clamp(rect[0], rect[1])],
            }
        });
        let costs = candidates
            .enumerate()
            .map(|(rank, placement)| (cost(rank, &placement), placement));
        placements[i] = costs
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, placement)| placement);
    }
    placements.into_iter().flatten().collect()
}

/// Samples a line every 3 pixels.
fn sample(line: &[DVec2]) -> impl Iterator<Item = DVec2> {
    let (from, to) = (line[0], line[1]);
    let steps = (from.distance(to) / 3.0).ceil().max(1.0);
    (0..=steps as u32).map(move |i| from.lerp(to, f64::from(i) / steps))
}

fn overlap(a: &Rect, b: &Rect) -> f64 {
    (a[1].min(b[1]) - a[0].max(b[0]))
        .max(DVec2::ZERO)
        .element_product()
}

/// Returns the distance from a box to a point, 0 inside.
fn distance(rect: &Rect, point: DVec2) -> f64 {
    point.distance(point.clamp(rect[0], rect[1]))
}

/// Moves sorted positions apart to distances of at least `gap`, and back where they exceed `high`.
pub(super) fn push_apart(positions: &mut [f64], gap: f64, high: f64) {
    for i in 1..positions.len() {
        positions[i] = positions[i].max(positions[i - 1] + gap);
    }
    let mut limit = high;
    for position in positions.iter_mut().rev() {
        *position = position.min(limit);
        limit = *position - gap;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_close_dots_do_not_overlap() {
        let dots = [
            [200.0, 100.0],
            [204.0, 103.0],
            [198.0, 108.0],
            [395.0, 150.0],
            [100.0, 50.0],
            [100.0, 72.0],
        ];
        let dots = dots.map(|dot| (DVec2::from(dot), "a long name"));
        let area = [DVec2::ZERO, dvec2(400.0, 300.0)];
        let rects: Vec<Rect> = place_labels(&dots, 12.0, area, &[])
            .iter()
            .map(|placement| placement.rect)
            .collect();
        for (i, rect) in rects.iter().enumerate() {
            assert!(
                rect[0].cmpge(area[0]).all() && rect[1].cmple(area[1]).all(),
                "{rect:?}"
            );
            assert!(
                dots.iter().all(|(dot, _)| distance(rect, *dot) > 0.0),
                "{rect:?}"
            );
            assert!(
                rects[..i].iter().all(|other| overlap(rect, other) == 0.0),
                "{rect:?}"
            );
        }
        // One capture drawn in two ways has equal bytes and different error.
        assert!(distance(&rects[5], dots[4].0) > distance(&rects[5], dots[5].0));
    }

    #[test]
    fn push_apart_keeps_order_and_limit() {
        let mut positions = [10.0, 12.0, 50.0, 95.0, 96.0];
        push_apart(&mut positions, 10.0, 100.0);
        assert_eq!(positions, [10.0, 20.0, 50.0, 90.0, 100.0]);
    }
}
