//! Tree over axis-aligned boxes: which of many prisms may contain a point, which of many portals
//! may cross a ray.

use glam::DVec3;

/// A box from its lowest to its highest corner, world metres.
pub(super) type Bounds = [DVec3; 2];

/// Returns the box around points; an inverted box if there are none.
pub(super) fn bounds_of(points: impl IntoIterator<Item = DVec3>) -> Bounds {
    let empty = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    points
        .into_iter()
        .fold(empty, |[low, high], p| [low.min(p), high.max(p)])
}

/// Binary tree over boxes, in depth-first order.
#[derive(Default)]
pub(super) struct BoxTree {
    nodes: Vec<Node>,
}

struct Node {
    bounds: Bounds,
    /// Index of the next node outside of this subtree.
    next: usize,
    /// Item of a leaf.
    item: Option<usize>,
}

impl BoxTree {
    /// Builds the tree over items and their boxes.
    pub(super) fn new(mut items: Vec<(usize, Bounds)>) -> Self {
        let mut tree = Self::default();
        if !items.is_empty() {
            tree.nodes.reserve(2 * items.len());
            tree.add(&mut items);
        }
        tree
    }

    /// Adds the subtree of some items, split in the middle of the widest axis: its depth is the
    /// logarithm of their number.
    fn add(&mut self, items: &mut [(usize, Bounds)]) {
        let index = self.nodes.len();
        let bounds = bounds_of(items.iter().flat_map(|(_, bounds)| *bounds));
        let item = match items {
            [(item, _)] => Some(*item),
            _ => None,
        };
        self.nodes.push(Node {
            bounds,
            next: 0,
            item,
        });
        if item.is_none() {
            let centre = |bounds: &Bounds| bounds[0] + bounds[1];
            let [low, high] = bounds_of(items.iter().map(|(_, bounds)| centre(bounds)));
            let axis = (high - low).max_position();
            let middle = items.len() / 2;
            items.select_nth_unstable_by(middle, |a, b| {
                let key = |item: &(usize, Bounds)| centre(&item.1)[axis];
                key(a).total_cmp(&key(b)).then(a.0.cmp(&b.0))
            });
            let (before, after) = items.split_at_mut(middle);
            self.add(before);
            self.add(after);
        }
        self.nodes[index].next = self.nodes.len();
    }

    /// Returns the items whose boxes pass a test, which must pass for every box that contains such
    /// a box; in no particular order.
    pub(super) fn items(&self, test: impl Fn(&Bounds) -> bool) -> impl Iterator<Item = usize> {
        let mut index = 0;
        std::iter::from_fn(move || {
            while let Some(node) = self.nodes.get(index) {
                if !test(&node.bounds) {
                    index = node.next;
                    continue;
                }
                index += 1;
                if node.item.is_some() {
                    return node.item;
                }
            }
            None
        })
    }
}

/// Returns true if a box contains a point, boundary included.
pub(super) fn contains(bounds: &Bounds, p: DVec3) -> bool {
    bounds[0].cmple(p).all() && bounds[1].cmpge(p).all()
}

/// Returns true if a ray crosses a box, which should be larger than what is in it by the rounding
/// error of the ray's points.
pub(super) fn crosses(bounds: &Bounds, origin: DVec3, direction: DVec3) -> bool {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [0, 1].map(|end| (bounds[end][axis] - origin[axis]) / direction[axis]);
        // NaN, for a ray in a box's plane, bounds nothing.
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    enter <= leave
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::random::Rng;

    #[test]
    fn points_and_rays_find_same_boxes_as_linear_search() {
        let mut random = Rng::new(4);
        let mut point = |scale: f64| DVec3::from([0; 3].map(|_| random.unit() * scale));
        let mut boxes: Vec<(usize, Bounds)> = (0..200)
            .map(|item| {
                let low = point(10.0);
                (item, [low, low + point(2.0)])
            })
            .collect();
        let same = boxes[7].1;
        boxes.extend((200..300).map(|item| (item, same)));
        let tree = BoxTree::new(boxes.clone());
        for _ in 0..500 {
            let (p, direction) = (point(12.0), point(2.0) - DVec3::ONE);
            let direction = if p.x < 1.0 { DVec3::Y } else { direction };
            let tests: [&dyn Fn(&Bounds) -> bool; 2] = [&|bounds| contains(bounds, p), &|bounds| {
                crosses(bounds, p, direction)
            }];
            for test in tests {
                let mut found: Vec<usize> = tree.items(test).collect();
                found.sort_unstable();
                let passing = boxes.iter().filter(|(_, bounds)| test(bounds));
                let expected: Vec<usize> = passing.map(|(item, _)| *item).collect();
                assert_eq!(found, expected, "{p} {direction}");
            }
        }
        assert_eq!(BoxTree::new(Vec::new()).items(|_| true).count(), 0);
    }
}
