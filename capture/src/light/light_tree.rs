//! Which emissive triangle a light sample goes to, drawn by about what each would bring to the place that is lit: a tree of lights (Conty
//! Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"; emission is two-sided here, so that lights
//! have no cones).

use super::LitPoint;
use glam::Vec3;

/// A light where no bound of its cosine is above this still is drawn as if its cosine were this: bounds are rounded.
const LEAST_COSINE: f32 = 1e-3;

/// A light to be put into the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    /// Its bounding box.
    pub(super) bounds: [Vec3; 2],
    pub(super) power: f32,
    /// Whatever the caller knows it by.
    pub(super) name: u32,
}

/// A box around lights.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    middle: Vec3,
    /// Of the sphere around the box.
    radius: f32,
    power: f32,
    /// The number of its first light, in the order of the tree.
    first: u32,
    below: Below,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Below {
    Light(u32),
    /// The next node, and that of this number.
    Nodes(u32),
}

/// All lights of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LightTree {
    /// Each before what lies below it.
    nodes: Vec<Node>,
    /// The name of each light and its number in the order of the tree, by name.
    numbers: Vec<(u32, u32)>,
}

impl LightTree {
    pub(super) fn new(mut leaves: Vec<Leaf>) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(2 * leaves.len()), numbers: Vec::new() };
        if !leaves.is_empty() {
            tree.push(&mut leaves, 0);
        }
        tree.numbers = leaves.iter().zip(0..).map(|(leaf, number)| (leaf.name, number)).collect();
        tree.numbers.sort_unstable();
        tree
    }

    /// Adds a node around lights, the first of which has this number, and all below it.
    fn push(&mut self, leaves: &mut [Leaf], first: u32) {
        let around = |[low, high]: [Vec3; 2], leaf: &Leaf| [low.min(leaf.bounds[0]), high.max(leaf.bounds[1])];
        let [low, high] = leaves.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], around);
        let power = leaves.iter().map(|leaf| leaf.power).sum();
        let (middle, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
        let at = self.nodes.len();
        self.nodes.push(Node { middle, radius, power, first, below: Below::Light(leaves[0].name) });
        if leaves.len() == 1 {
            return;
        }
        let axis =
            (high - low).to_array().into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |it| it.0);
        let place = |leaf: &Leaf| leaf.bounds[0][axis] + leaf.bounds[1][axis];
        leaves.sort_unstable_by(|a, b| place(a).total_cmp(&place(b)).then(a.name.cmp(&b.name)));
        // In the middle of the box, so that what lies apart is apart at once.
        let lower = leaves.partition_point(|leaf| place(leaf) < low[axis] + high[axis]);
        let half = if lower == 0 || lower == leaves.len() { leaves.len() / 2 } else { lower };
        let (left, right) = leaves.split_at_mut(half);
        self.push(left, first);
        self.nodes[at].below = Below::Nodes(self.nodes.len() as u32);
        self.push(right, first + half as u32);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The light for a number in [0, 1), and the probability with which it is drawn. `None` where there is none.
    pub(super) fn draw(&self, point: &LitPoint, mut number: f32) -> Option<(u32, f32)> {
        let (mut at, mut probability) = (0, 1.0);
        loop {
            match self.nodes.get(at)?.below {
                Below::Light(name) => return Some((name, probability)),
                Below::Nodes(right) => {
                    let share = self.share(at, right, point);
                    let is_first = number < share;
                    let (from, width) = if is_first { (0.0, share) } else { (share, 1.0 - share) };
                    number = ((number - from) / width).clamp(0.0, BELOW_ONE);
                    probability *= width;
                    at = if is_first { at + 1 } else { right as usize };
                }
            }
        }
    }

    /// The probability with which [`Self::draw`] gives the light of this name; 0 if there is none.
    pub(super) fn probability(&self, point: &LitPoint, name: u32) -> f32 {
        let Ok(place) = self.numbers.binary_search_by_key(&name, |&(name, _)| name) else { return 0.0 };
        let number = self.numbers[place].1;
        let (mut at, mut probability) = (0, 1.0);
        while let Below::Nodes(right) = self.nodes[at].below {
            let share = self.share(at, right, point);
            let is_first = number < self.nodes[right as usize].first;
            probability *= if is_first { share } else { 1.0 - share };
            at = if is_first { at + 1 } else { right as usize };
        }
        probability
    }

    /// How often the first of the two nodes below one is drawn, whose second has the number `right`.
    fn share(&self, at: usize, right: u32, point: &LitPoint) -> f32 {
        let (first, second) = (self.nodes[at + 1].importance(point), self.nodes[right as usize].importance(point));
        let share = first / (first + second);
        // Both may be infinite, or nothing, where a light is as small as a point.
        if share.is_nan() { 0.5 } else { share }
    }
}

/// The largest number below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

impl Node {
    /// About what its lights would bring to a point: power over squared distance, times a bound of the cosine there. No point of the
    /// sphere lies higher above the horizon than its middle and radius together; a root and a division are all that it costs.
    #[inline]
    fn importance(&self, point: &LitPoint) -> f32 {
        let to_middle = self.middle - point.position;
        let distance2 = to_middle.length_squared().max(self.radius * self.radius);
        let distance = distance2.sqrt();
        let height = to_middle.dot(point.shading_normal) + self.radius;
        self.power * height.clamp(LEAST_COSINE * distance, distance) / (distance2 * distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{random4, unit_float};

    fn leaves(count: u32) -> Vec<Leaf> {
        let leaf = |name: u32| {
            let [x, y, z, power] = random4([name, 5, 6, 7]).map(unit_float);
            let corner = Vec3::new(x, y, z) * 10.0 - 5.0;
            Leaf { bounds: [corner, corner + 0.1], power: power + 0.1, name }
        };
        (0..count).map(leaf).collect()
    }

    fn point() -> LitPoint {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        LitPoint { position: Vec3::new(1.0, -2.0, 0.5), normal, shading_normal: normal, extent: 1.0 }
    }

    #[test]
    fn lights_are_drawn_as_often_as_they_say() {
        const DRAWS: u32 = 1 << 16;
        for count in [1, 2, 3, 50] {
            let tree = LightTree::new(leaves(count));
            let mut drawn = vec![(0u32, 0.0f32); count as usize];
            for i in 0..DRAWS {
                let (name, probability) =
                    tree.draw(&point(), (i as f32 + 0.5) / DRAWS as f32).expect("there are lights");
                assert_eq!(tree.probability(&point(), name), probability);
                let (times, of_light) = &mut drawn[name as usize];
                (*times, *of_light) = (*times + 1, probability);
            }
            for (times, probability) in &drawn {
                let off = (*times as f32 / DRAWS as f32 - probability).abs();
                // Numbers are spread evenly: a light's are one run, whose ends are rounded at each of up to 6 nodes.
                assert!(off < 2e-4, "{count}: drawn {times} times, for {probability}");
            }
            let sum: f32 = drawn.iter().map(|(_, probability)| probability).sum();
            assert!((sum - 1.0).abs() < 1e-2, "{count}: all that can matter are drawn: {sum}");
        }
        let none = LightTree::new(Vec::new());
        assert_eq!((none.draw(&point(), 0.5), none.probability(&point(), 0)), (None, 0.0));
    }

    #[test]
    fn a_near_light_is_drawn_before_a_thousand_far_ones() {
        let mut all = leaves(1000);
        all.iter_mut().for_each(|leaf| leaf.bounds = leaf.bounds.map(|corner| corner + Vec3::X * 100.0));
        let near = point().position + point().normal;
        all.push(Leaf { bounds: [near, near + 0.1], power: 0.5, name: 1000 });
        let tree = LightTree::new(all);
        let times = (0..1000)
            .filter(|i| tree.draw(&point(), (*i as f32 + 0.5) / 1000.0).is_some_and(|it| it.0 == 1000))
            .count();
        // About 0.5 at 1 m against 600 at 100 m.
        assert!((800..1000).contains(&times), "{times} of 1000");
    }

    #[test]
    fn lights_as_small_as_points_are_lights() {
        let leaf = |name| Leaf { bounds: [point().position; 2], power: 1.0, name };
        let tree = LightTree::new((0..5).map(leaf).collect());
        for number in [0.0, 0.3, BELOW_ONE] {
            let (_, probability) = tree.draw(&point(), number).expect("a light");
            assert!(probability > 0.0 && probability <= 1.0);
        }
    }
}
