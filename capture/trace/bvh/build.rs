//! Construction of the tree: local triangles, the binary tree of `obvhs`, and its collapse to eight
//! children per node.

use super::MAX_COORDINATE;
use super::cutout::Cutouts;
use super::tree::{BLOCK, Block, Bounds, Child, Node, Tree, WIDTH};
use crate::sampler::{random4, unit_float};
use glam::{DVec3, Vec3, Vec3A};
use headbox_scene::scene::Scene;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::triangle::Triangle;
use rayon::prelude::*;

/// Share of the nodes that are moved to better places in the first round (docs/decisions/0021).
const REINSERTED_SHARE: f32 = 0.1;
/// Number of nodes that a ray through the scene's box may visit on average for nodes to be moved:
/// the search for a better place visits as many. Where nearly all boxes contain one point, that
/// would be nearly all nodes (docs/decisions/0069).
const MAX_VISITED: f64 = 16_384.0;

/// Returns the positions of a triangle's vertices relative to `origin`; `None` if an index is out
/// of range.
pub(super) fn local_triangle(scene: &Scene, origin: DVec3, primitive: u32) -> Option<[Vec3; 3]> {
    let [a, b, c] = scene.triangles.get(primitive as usize)?.vertices;
    let local = |i: u32| {
        scene
            .positions
            .get(i as usize)
            .map(|p| (*p - origin).as_vec3())
    };
    Some([local(a)?, local(b)?, local(c)?])
}

/// Returns true if a ray can hit the triangle: its coordinates are in range and its area is not
/// zero.
fn is_solid(triangle: &[Vec3; 3]) -> bool {
    let in_range = triangle
        .iter()
        .all(|p| p.abs().max_element() <= MAX_COORDINATE); // false for NaN
    let [a, b, c] = triangle.map(|p| p.as_dvec3());
    in_range && (b - a).cross(c - a) != DVec3::ZERO
}

/// Returns true if only the front of a triangle is there.
pub(super) fn is_single_sided(scene: &Scene, primitive: u32) -> bool {
    let material = scene
        .triangles
        .get(primitive as usize)
        .and_then(|triangle| scene.materials.get(triangle.material as usize));
    material.is_some_and(|material| material.single_sided)
}

/// Builds the tree over the triangles that can be hit.
pub(super) fn build(scene: &Scene, origin: DVec3, cutouts: &Cutouts) -> Tree {
    // Primitive indices are u32 and u32::MAX means none.
    let count = scene.triangles.len().min(u32::MAX as usize) as u32;
    let solid: Vec<(u32, [Vec3; 3])> = (0..count)
        .into_par_iter()
        .filter_map(|i| {
            local_triangle(scene, origin, i)
                .filter(is_solid)
                .map(|triangle| (i, triangle))
        })
        .collect();
    if solid.is_empty() {
        return Tree::default();
    }
    let triangles: Vec<Triangle> = solid
        .par_iter()
        .map(|(primitive, triangle)| jitter(*primitive, triangle))
        .collect();
    let binary = build_binary(&triangles);
    let has_cutout = |primitive: u32| cutouts.has(scene.triangles[primitive as usize].material);
    let single_sided = |primitive: u32| is_single_sided(scene, primitive);
    Collapse {
        binary: &binary,
        solid: &solid,
        has_cutout: &has_cutout,
        single_sided: &single_sided,
        tree: Tree::default(),
    }
    .run()
}

/// Builds the binary tree. Boxes are not split: a triangle would be in several leaves, and a hit
/// would depend on which of them is visited first (rule 3 of [`super`]).
fn build_binary(triangles: &[Triangle]) -> Bvh2 {
    const SEARCH_DEPTH_THRESHOLD: usize = 3;
    const TRAVERSAL_COST: f32 = 10.0;
    let mut tree = PlocBuilder::with_capacity(triangles.len()).build(
        PlocSearchDistance::Medium,
        triangles,
        (0..triangles.len() as u32).collect(),
        SortPrecision::U64,
        SEARCH_DEPTH_THRESHOLD,
    );
    if visited_nodes(&tree) <= MAX_VISITED {
        ReinsertionOptimizer::default().run(&mut tree, REINSERTED_SHARE, None);
    }
    collapse(&mut tree, BLOCK as u32, TRAVERSAL_COST);
    tree
}

/// Average number of nodes that a random line through the box of a tree meets.
fn visited_nodes(tree: &Bvh2) -> f64 {
    let area = |node: &Bvh2Node| f64::from(node.aabb().half_area());
    tree.nodes.iter().map(area).sum::<f64>() / area(&tree.nodes[0])
}

/// Moves a triangle by a small share of its size, at random. Clustering joins two boxes that are
/// each other's best partner; among boxes that are equal or in a row, all would prefer the same
/// side, and each round would join only a few of them (docs/decisions/0069). The final boxes are
/// those of the triangles where they are.
fn jitter(primitive: u32, triangle: &[Vec3; 3]) -> Triangle {
    const SHARE: f32 = 1.0 / 128.0;
    let [a, b, c] = triangle.map(Vec3A::from);
    let size = a.max(b).max(c) - a.min(b).min(c);
    let [x, y, z, _] = random4([primitive, 0, 0, 0xb0c5]).map(unit_float);
    let offset = (Vec3A::new(x, y, z) - 0.5) * size * SHARE;
    Triangle {
        v0: a + offset,
        v1: b + offset,
        v2: c + offset,
    }
}

/// The collapse of the binary tree into nodes of eight children.
struct Collapse<'a> {
    binary: &'a Bvh2,
    solid: &'a [(u32, [Vec3; 3])],
    has_cutout: &'a dyn Fn(u32) -> bool,
    single_sided: &'a dyn Fn(u32) -> bool,
    tree: Tree,
}

/// A subtree of the binary tree that is not collapsed yet.
struct Pending {
    binary: u32,
    /// Parent node and slot; `None` for the root.
    parent: Option<(usize, usize)>,
    depth: usize,
}

impl Collapse<'_> {
    /// Collapses the tree depth first, so that a node's subtree lies together in memory. With an
    /// explicit stack: a binary tree over many coincident triangles may be deep.
    fn run(mut self) -> Tree {
        let mut pending = vec![Pending {
            binary: 0,
            parent: None,
            depth: 1,
        }];
        let mut deepest = 1;
        while let Some(Pending {
            binary,
            parent,
            depth,
        }) = pending.pop()
        {
            deepest = deepest.max(depth);
            let index = self.tree.nodes.len();
            if let Some((node, slot)) = parent {
                self.tree.nodes[node].child[slot] = Child::node(index);
            }
            self.tree.nodes.push(Node::EMPTY);
            let children = self.widen(binary);
            for (slot, &child) in children.iter().enumerate() {
                let binary = self.binary.nodes[child as usize];
                if binary.is_leaf() {
                    self.add_leaf(index, slot, binary);
                }
            }
            // Last pushed is next: slot 0's subtree follows its node.
            for (slot, &child) in children.iter().enumerate().rev() {
                if !self.binary.nodes[child as usize].is_leaf() {
                    pending.push(Pending {
                        binary: child,
                        parent: Some((index, slot)),
                        depth: depth + 1,
                    });
                }
            }
        }
        self.fit_bounds();
        // Each level leaves at most all but one of its node's children on the stack.
        self.tree.stack_len = deepest * (WIDTH - 1) + 1;
        self.tree
    }

    /// Returns up to eight subtrees of a binary node, opening the largest until there are eight.
    fn widen(&self, root: u32) -> Vec<u32> {
        let node = |i: u32| &self.binary.nodes[i as usize];
        let mut children = vec![root];
        while children.len() < WIDTH {
            let inner = children
                .iter()
                .enumerate()
                .filter(|&(_, &c)| !node(c).is_leaf());
            let area = |c: u32| node(c).aabb().half_area();
            let Some((slot, _)) = inner.max_by(|a, b| area(*a.1).total_cmp(&area(*b.1))) else {
                break;
            };
            let first = node(children[slot]).first_index;
            children[slot] = first;
            children.insert(slot + 1, first + 1);
        }
        children
    }

    fn add_leaf(&mut self, node: usize, slot: usize, leaf: Bvh2Node) {
        let range = leaf.first_index as usize..(leaf.first_index + leaf.prim_count) as usize;
        let members: Vec<(u32, [Vec3; 3])> = self.binary.primitive_indices[range]
            .iter()
            .map(|&i| self.solid[i as usize])
            .collect();
        let first = self.tree.blocks.len();
        let mut chunks = members.chunks(BLOCK).peekable();
        while let Some(chunk) = chunks.next() {
            let mut block = Block {
                more: chunks.peek().is_some(),
                ..Block::EMPTY
            };
            for &(primitive, triangle) in chunk {
                block.push(
                    primitive,
                    triangle,
                    (self.has_cutout)(primitive),
                    (self.single_sided)(primitive),
                );
            }
            self.tree.blocks.push(block);
        }
        let wide = &mut self.tree.nodes[node];
        wide.child[slot] = Child::leaf(first);
        wide.set_bounds(slot, Bounds::from_triangles(members.iter().map(|m| m.1)));
    }

    /// Computes boxes of inner nodes from the leaves up as exact unions of their children, so that
    /// entering distances never fall on the way down.
    fn fit_bounds(&mut self) {
        for index in (0..self.tree.nodes.len()).rev() {
            let (before, after) = self.tree.nodes.split_at_mut(index + 1);
            let node = &mut before[index];
            for slot in 0..WIDTH {
                let child = node.child[slot];
                if child != Child::NONE && child.first_block().is_none() {
                    // Children come after their parents.
                    let child = child.index() as usize;
                    node.set_bounds(slot, after[child - index - 1].bounds());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{MAX_VISITED, build_binary, jitter, visited_nodes};
    use glam::Vec3;
    use obvhs::bvh2::Bvh2;
    use obvhs::triangle::Triangle;

    /// Builds a tree over many triangles. `place` returns the size and the offset of a triangle by
    /// its number.
    fn tree(place: impl Fn(f32) -> (f32, Vec3)) -> Bvh2 {
        let corners = [[1.0, 0.0, -0.5], [-0.5, 0.8, -0.5], [-0.5, -0.8, 1.0]].map(Vec3::from);
        let triangles: Vec<Triangle> = (0..60_000_u16)
            .map(|i| {
                let (size, offset) = place(f32::from(i));
                jitter(i.into(), &corners.map(|corner| corner * size + offset))
            })
            .collect();
        build_binary(&triangles)
    }

    /// It would take minutes. Only reinsertion leaves the numbers of the parents behind.
    #[test]
    fn nodes_are_not_moved_where_all_boxes_contain_one_point() {
        let concentric = tree(|i| (1.0 + i * 1e-5, Vec3::ZERO));
        let on_line = tree(|i| (1.0, Vec3::splat(i)));
        let visited = [&concentric, &on_line].map(visited_nodes);
        assert!(visited[0] > MAX_VISITED && visited[1] < 64.0, "{visited:?}");
        assert!(concentric.parents.is_empty() && !on_line.parents.is_empty());
    }
}
