//! Light tree: samples an emissive triangle approximately in proportion to its contribution at the
//! lit point (Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree
//! Splitting"; emission is two-sided here, so that lights have no cones).

use crate::light::LitPoint;
use glam::Vec3;
use std::f32::consts::PI;

/// Minimum of the cosine bound of a light: bounds are rounded, so that no light may get probability
/// zero.
const MIN_COSINE: f32 = 1e-3;

/// Light to insert into the tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leaf {
    /// Bounding box.
    pub(crate) bounds: [Vec3; 2],
    pub(crate) power: f32,
    /// Identifier chosen by the caller.
    pub(crate) id: u32,
}

/// Maximum number of children of a node.
const WIDTH: usize = 8;

/// Node with its children's bounds as structure of arrays, whose weights are computed together. A
/// tree of hundreds of lights has few levels.
#[derive(Clone, Debug, PartialEq)]
struct LightNode {
    /// Centres of the boxes, `[axis][box]`.
    centre: [[f32; WIDTH]; 3],
    /// Radii of the boxes' bounding spheres.
    radius: [f32; WIDTH],
    power: [f32; WIDTH],
    /// Index of each box's first light, in the order of the tree; `u32::MAX` in unused slots.
    first: [u32; WIDTH],
    child: [NodeChild; WIDTH],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum NodeChild {
    /// Light, by its identifier.
    Light(u32),
    /// Node, by its index.
    LightNode(u32),
}

/// Tree of all lights of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LightTree {
    /// Nodes, parents before children.
    nodes: Vec<LightNode>,
    /// Identifier of each light and its index in the order of the tree, sorted by identifier.
    order: Vec<(u32, u32)>,
}

impl LightTree {
    pub(crate) fn new(mut leaves: Vec<Leaf>) -> Self {
        let mut tree = Self::default();
        if !leaves.is_empty() {
            tree.push(&mut leaves, 0);
        }
        tree.order = leaves
            .iter()
            .zip(0..)
            .map(|(leaf, number)| (leaf.id, number))
            .collect();
        tree.order.sort_unstable();
        tree
    }

    /// Adds a node for lights of consecutive indices from `first` on, and all nodes below it.
    /// Returns the index of the node.
    fn push(&mut self, leaves: &mut [Leaf], mut first: u32) -> u32 {
        let number = self.nodes.len();
        self.nodes.push(LightNode::EMPTY);
        for (i, group) in split_into_groups(leaves).into_iter().enumerate() {
            self.nodes[number].set(i, group, first);
            let count = group.len() as u32;
            if count > 1 {
                self.nodes[number].child[i] = NodeChild::LightNode(self.push(group, first));
            }
            first += count;
        }
        number as u32
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Returns an upper bound, up to the bounds of groups, of the radiosity per albedo by which the
    /// lights light a box: twice their power over pi times the squared distance, unobstructed.
    pub(crate) fn light_bound(&self, [low, high]: [Vec3; 2]) -> f32 {
        let middle = low + (high - low) / 2.0;
        let radius = (high - low).length() / 2.0;
        let mut waiting = vec![0];
        let mut light = 0.0;
        while let Some(node) = waiting.pop().and_then(|i: usize| self.nodes.get(i)) {
            for i in (0..WIDTH).filter(|&i| node.first[i] != u32::MAX) {
                let centre = Vec3::from_array([0, 1, 2].map(|axis| node.centre[axis][i]));
                let distance = centre.distance(middle) - radius;
                match node.child[i] {
                    NodeChild::LightNode(child) if distance < 2.0 * node.radius[i] => {
                        waiting.push(child as usize);
                    }
                    _ => light += node.power[i] / (PI * distance.max(0.0).powi(2)),
                }
            }
        }
        light
    }

    /// Samples a light from a number in [0, 1): returns its identifier and its probability, or
    /// `None` if the tree is empty.
    pub(crate) fn sample(&self, point: &LitPoint, mut number: f32) -> Option<(u32, f32)> {
        let mut index = 0;
        let mut probability = 1.0;
        loop {
            let node = self.nodes.get(index)?;
            let probabilities = node.probabilities(point);
            // Rounding may leave the number beyond the last box of nonzero probability.
            let mut chosen = None;
            for (i, share) in probabilities
                .into_iter()
                .enumerate()
                .filter(|(_, share)| *share > 0.0)
            {
                let box_probability = probability * share;
                chosen = Some((i, box_probability));
                if number < box_probability {
                    break;
                }
                number -= box_probability;
            }
            let (i, box_probability) = chosen?;
            number = number.min(box_probability * BELOW_ONE);
            probability = box_probability;
            match node.child[i] {
                NodeChild::Light(id) => return Some((id, probability)),
                NodeChild::LightNode(child) => index = child as usize,
            }
        }
    }

    /// Returns the probability with which [`Self::sample`] samples a light; 0 if there is no such
    /// light.
    pub(crate) fn probability(&self, point: &LitPoint, id: u32) -> f32 {
        let Ok(position) = self.order.binary_search_by_key(&id, |&(id, _)| id) else {
            return 0.0;
        };
        let number = self.order[position].1;
        let mut index = 0;
        let mut probability = 1.0;
        loop {
            let node = &self.nodes[index];
            let i = node.first.partition_point(|&first| first <= number) - 1;
            probability *= node.probabilities(point)[i];
            match node.child[i] {
                NodeChild::Light(_) => return probability,
                NodeChild::LightNode(child) => index = child as usize,
            }
        }
    }
}

/// Largest number below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// Splits lights into [`WIDTH`] groups, or into single lights if there are fewer, by repeatedly
/// splitting the group with the largest box.
fn split_into_groups(leaves: &mut [Leaf]) -> Vec<&mut [Leaf]> {
    let mut groups = vec![leaves];
    while groups.len() < WIDTH {
        let sizes = groups
            .iter()
            .enumerate()
            .filter(|(_, group)| group.len() > 1)
            .map(|(i, group)| (i, extent(group).1.max_element()));
        let largest = sizes.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        let Some((i, _)) = largest else { break };
        let (left, right) = split(groups.remove(i));
        groups.insert(i, right);
        groups.insert(i, left);
    }
    groups
}

/// Returns the lower corner and the size of the bounding box of lights.
fn extent(leaves: &[Leaf]) -> (Vec3, Vec3) {
    let around =
        |[low, high]: [Vec3; 2], leaf: &Leaf| [low.min(leaf.bounds[0]), high.max(leaf.bounds[1])];
    let [low, high] = leaves
        .iter()
        .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], around);
    (low, high - low)
}

/// Splits two or more lights at the centre of the longest edge of their box, so that distant lights
/// are separated early.
fn split(leaves: &mut [Leaf]) -> (&mut [Leaf], &mut [Leaf]) {
    let (low, edges) = extent(leaves);
    let axis = edges.max_position();
    let key = |leaf: &Leaf| leaf.bounds[0][axis] + leaf.bounds[1][axis];
    leaves.sort_unstable_by(|a, b| key(a).total_cmp(&key(b)).then(a.id.cmp(&b.id)));
    let lower = leaves.partition_point(|leaf| key(leaf) < 2.0 * low[axis] + edges[axis]);
    let half = if lower == 0 || lower == leaves.len() {
        leaves.len() / 2
    } else {
        lower
    };
    leaves.split_at_mut(half)
}

impl LightNode {
    const EMPTY: Self = Self {
        centre: [[0.0; WIDTH]; 3],
        radius: [0.0; WIDTH],
        power: [0.0; WIDTH],
        first: [u32::MAX; WIDTH],
        child: [NodeChild::Light(u32::MAX); WIDTH],
    };

    /// Sets box `i` to the bounds of lights of consecutive indices from `first` on.
    fn set(&mut self, i: usize, leaves: &[Leaf], first: u32) {
        let (low, edges) = extent(leaves);
        (0..3).for_each(|axis| self.centre[axis][i] = low[axis] + edges[axis] / 2.0);
        self.radius[i] = edges.length() / 2.0;
        self.power[i] = leaves.iter().map(|leaf| leaf.power).sum();
        self.first[i] = first;
        self.child[i] = NodeChild::Light(leaves[0].id);
    }

    /// Returns the probability of each box: approximately proportional to its contribution at a
    /// point, power over squared distance times a bound of the cosine there. No point of a sphere
    /// is higher above the horizon than its centre's height plus its radius, so the bound costs
    /// only a square root and a division.
    #[inline]
    fn probabilities(&self, point: &LitPoint) -> [f32; WIDTH] {
        let position = point.position;
        let normal = point.shading_normal;
        let mut probabilities = [0.0; WIDTH];
        for (i, share) in probabilities.iter_mut().enumerate() {
            let x = self.centre[0][i] - position.x;
            let y = self.centre[1][i] - position.y;
            let z = self.centre[2][i] - position.z;
            let distance2 = (x * x + y * y + z * z).max(self.radius[i] * self.radius[i]);
            let distance = distance2.sqrt();
            let height = x * normal.x + y * normal.y + z * normal.z + self.radius[i];
            *share = self.power[i] * height.max(MIN_COSINE * distance).min(distance)
                / (distance2 * distance);
        }
        let scale = 1.0 / probabilities.iter().sum::<f32>();
        if scale > 0.0 && scale.is_finite() {
            probabilities.iter_mut().for_each(|share| *share *= scale);
            return probabilities;
        }
        // Weights overflow if a point-sized light coincides with the point: fall back to uniform.
        let count = self
            .first
            .iter()
            .filter(|first| **first != u32::MAX)
            .count();
        std::array::from_fn(|i| if i < count { 1.0 / count as f32 } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::tests::lit_point;
    use crate::sampler::{random4, unit_float};

    fn leaves(count: u32) -> Vec<Leaf> {
        let leaf = |id: u32| {
            let [x, y, z, power] = random4([id, 5, 6, 7]).map(unit_float);
            let corner = Vec3::new(x, y, z) * 10.0 - 5.0;
            Leaf {
                bounds: [corner, corner + 0.1],
                power: power + 0.1,
                id,
            }
        };
        (0..count).map(leaf).collect()
    }

    fn point() -> LitPoint {
        lit_point(Vec3::new(1.0, -2.0, 0.5), Vec3::new(0.6, 0.0, 0.8), 1.0)
    }

    #[test]
    fn light_frequency_matches_probability() {
        const DRAWS: u32 = 1 << 16;
        for count in [1, 2, 3, 50] {
            let tree = LightTree::new(leaves(count));
            let mut drawn = vec![(0u32, 0.0f32); count as usize];
            for i in 0..DRAWS {
                let (id, probability) = tree
                    .sample(&point(), (i as f32 + 0.5) / DRAWS as f32)
                    .expect("there are lights");
                assert_eq!(tree.probability(&point(), id), probability);
                let (times, expected) = &mut drawn[id as usize];
                (*times, *expected) = (*times + 1, probability);
            }
            for (times, probability) in &drawn {
                let off = (*times as f32 / DRAWS as f32 - probability).abs();
                // Numbers are evenly spaced: those of a light are one interval, whose ends are
                // rounded at each of up to 6 nodes.
                assert!(
                    off < 2e-4,
                    "{count}: drawn {times} times, for {probability}"
                );
            }
            let sum: f32 = drawn.iter().map(|(_, probability)| probability).sum();
            assert!(
                (sum - 1.0).abs() < 1e-2,
                "{count}: probabilities sum to {sum}"
            );
        }
        let none = LightTree::new(Vec::new());
        assert_eq!(
            (none.sample(&point(), 0.5), none.probability(&point(), 0)),
            (None, 0.0)
        );
    }

    #[test]
    fn near_light_outweighs_thousand_far_lights() {
        let mut all = leaves(1000);
        all.iter_mut()
            .for_each(|leaf| leaf.bounds = leaf.bounds.map(|corner| corner + Vec3::X * 100.0));
        let near = point().position + point().normal;
        all.push(Leaf {
            bounds: [near, near + 0.1],
            power: 0.5,
            id: 1000,
        });
        let tree = LightTree::new(all);
        let times = (0..1000)
            .filter(|i| {
                tree.sample(&point(), (*i as f32 + 0.5) / 1000.0)
                    .is_some_and(|it| it.0 == 1000)
            })
            .count();
        // About 0.5 at 1 m against 600 at 100 m.
        assert!((800..1000).contains(&times), "{times} of 1000");
    }

    #[test]
    fn point_sized_lights_have_probability() {
        let leaf = |id| Leaf {
            bounds: [point().position; 2],
            power: 1.0,
            id,
        };
        let tree = LightTree::new((0..5).map(leaf).collect());
        for number in [0.0, 0.3, BELOW_ONE] {
            let (_, probability) = tree.sample(&point(), number).expect("a light");
            assert!(probability > 0.0 && probability <= 1.0);
        }
    }
}
