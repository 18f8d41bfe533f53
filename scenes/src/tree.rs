//! `tree`: a broad-leaved tree on a meadow, after the chestnut of the papers.

use crate::mesh::{Mesh, Vertex};
use crate::texture::{fractal, mix, noise, paint, shade};
use glam::{DQuat, DVec2, DVec3};
use headbox_core::random::Rng;
use headbox_scene::material::Texture;
use headbox_scene::scene::Scene;
use std::f64::consts::TAU;

/// Number of leaves, of five leaflets with eight triangles each: 440,000 triangles.
const LEAVES: usize = 11_000;

/// Number of palmate leaflets of a leaf.
const LEAFLETS: usize = 5;

/// Growth parameters of one order of branching.
struct Order {
    steps: usize,
    sides: usize,
    /// Random change of direction per step.
    wander: f64,
    /// Weight of the upward vector that is added to the direction at each step.
    upward: f64,
    /// Number of children.
    children: usize,
    /// Position of the first child along the branch, 0 to 1.
    first_child: f64,
    /// Length of a child relative to its parent.
    child_length: f64,
    /// Angles between the first and last children and their parent, degrees.
    child_angle_deg: [f64; 2],
}

/// Orders of branching: trunk, limbs, branches, twigs.
const ORDERS: [Order; 4] = [
    Order {
        steps: 12,
        sides: 20,
        wander: 0.05,
        upward: 0.05,
        children: 17,
        first_child: 0.3,
        child_length: 0.78,
        child_angle_deg: [86.0, 26.0],
    },
    Order {
        steps: 10,
        sides: 10,
        wander: 0.14,
        upward: 0.05,
        children: 10,
        first_child: 0.2,
        child_length: 0.5,
        child_angle_deg: [70.0, 40.0],
    },
    Order {
        steps: 7,
        sides: 6,
        wander: 0.2,
        upward: 0.03,
        children: 8,
        first_child: 0.15,
        child_length: 0.5,
        child_angle_deg: [65.0, 35.0],
    },
    Order {
        steps: 5,
        sides: 4,
        wander: 0.2,
        upward: 0.02,
        children: 0,
        first_child: 0.0,
        child_length: 0.0,
        child_angle_deg: [0.0; 2],
    },
];

/// Start and size of a branch.
struct Branch {
    start: DVec3,
    direction: DVec3,
    length: f64,
    radius: f64,
}

struct Tree {
    mesh: Mesh,
    bark: u32,
    /// Centre lines of all twigs, which carry the leaves.
    twigs: Vec<Vec<(DVec3, f64)>>,
}

pub(crate) fn build(seed: u64) -> Scene {
    let rng = Rng::new(seed);
    let mut mesh = Mesh::default();
    add_meadow(&mut mesh, seed);
    let bark = mesh.textured("bark", bark_texture(seed));
    let leaf = mesh.plain("leaf", [0.33, 0.45, 0.10]);

    let mut tree = Tree {
        mesh,
        bark,
        twigs: Vec::new(),
    };
    let start = DVec3::Y * (ground_height(0.0, 0.0) - 0.15);
    tree.grow(
        Branch {
            start,
            direction: DVec3::Y,
            length: 5.4,
            radius: 0.34,
        },
        0,
        &rng.fork(0),
    );
    tree.add_leaves(leaf, &rng.fork(1));

    let centre = DVec3::new(1.2, ground_height(1.2, 7.5) + 1.8, 7.5);
    tree.mesh.finish("tree", centre, 0.75)
}

impl Tree {
    /// Grows a branch and all its descendants.
    fn grow(&mut self, branch: Branch, level: usize, rng: &Rng) {
        let order = &ORDERS[level];
        let path = branch_path(&branch, order, level == 0, &mut rng.fork(0));
        self.mesh.add_tube(&path, order.sides, 1.5, self.bark);
        if order.children == 0 {
            self.twigs.push(path);
            return;
        }
        for child in 0..order.children {
            let mut random = rng.fork(1 + child as u64);
            // The last child continues its parent.
            let is_leader = child + 1 == order.children;
            let share = (child as f64 + random.between(0.1, 0.9)) / (order.children - 1) as f64;
            let at = if is_leader {
                1.0
            } else {
                order.first_child + (0.97 - order.first_child) * share.min(1.0)
            };
            let (start, radius, along) = point_on(&path, at);
            let [low, high] = order.child_angle_deg;
            let angle = if is_leader {
                0.15
            } else {
                (low + (high - low) * at + random.between(-10.0, 10.0)).to_radians()
            };
            // The golden angle distributes branches evenly around their parent.
            let around = child as f64 * 2.399_963 + random.between(-0.4, 0.4);
            let across = DQuat::from_axis_angle(along, around) * along.any_orthonormal_vector();
            let reach = 1.0 - 0.42 * (at - order.first_child);
            let child_branch = Branch {
                start,
                direction: (along * angle.cos() + across * angle.sin()).normalize(),
                length: branch.length * order.child_length * reach * random.between(0.8, 1.15),
                radius: (radius * if is_leader { 0.9 } else { 0.55 }).max(0.003),
            };
            self.grow(child_branch, level + 1, &random.fork(0));
        }
    }

    fn add_leaves(&mut self, material: u32, rng: &Rng) {
        for index in 0..LEAVES {
            let mut random = rng.fork(index as u64);
            let twig = &self.twigs[index % self.twigs.len()];
            let (start, _, along) = point_on(twig, random.between(0.15, 1.0));
            let around = DQuat::from_axis_angle(along, random.between(0.0, TAU));
            let across = around * along.any_orthonormal_vector();
            let stalk = (across + along * 0.6 + DVec3::Y * 0.25).normalize();
            let normal = (DVec3::Y + random.in_cube(1.0) * 0.55 + stalk * 0.25).normalize();
            let forward = stalk
                .reject_from(normal)
                .try_normalize()
                .unwrap_or_else(|| normal.any_orthonormal_vector());
            let color = leaf_color(&mut random);
            let hub = start + stalk * random.between(0.06, 0.14);
            let length = random.between(0.13, 0.21);
            for leaflet in 0..LEAFLETS {
                let spread = (leaflet as f64 - (LEAFLETS - 1) as f64 / 2.0) * 0.62;
                let direction = DQuat::from_axis_angle(normal, spread) * forward;
                let length = length * (1.0 - 0.16 * spread * spread);
                add_leaflet(
                    &mut self.mesh,
                    Leaflet {
                        hub,
                        direction,
                        normal,
                        length,
                        color,
                    },
                    material,
                );
            }
        }
    }
}

/// Returns the centre line of a branch, with its radius at each step.
fn branch_path(
    branch: &Branch,
    order: &Order,
    is_trunk: bool,
    random: &mut Rng,
) -> Vec<(DVec3, f64)> {
    let (mut at, mut direction) = (branch.start, branch.direction);
    let mut path = Vec::with_capacity(order.steps + 1);
    for step in 0..=order.steps {
        let t = step as f64 / order.steps as f64;
        let flare = if is_trunk {
            1.0 + 0.6 * (1.0 - t * 6.0).max(0.0).powi(2)
        } else {
            1.0
        };
        path.push((at, branch.radius * (1.0 - 0.62 * t) * flare));
        direction =
            (direction + random.in_cube(1.0) * order.wander + DVec3::Y * order.upward).normalize();
        at += direction * (branch.length / order.steps as f64);
    }
    path
}

/// Returns point, radius and direction at a position (0..=1) on a path of at least two points.
fn point_on(path: &[(DVec3, f64)], at: f64) -> (DVec3, f64, DVec3) {
    let x = at * (path.len() - 1) as f64;
    let first = (x as usize).min(path.len() - 2);
    let ((a, radius_a), (b, radius_b)) = (path[first], path[first + 1]);
    let t = x - first as f64;
    (
        a.lerp(b, t),
        radius_a + (radius_b - radius_a) * t,
        (b - a).normalize(),
    )
}

/// Returns a leaf's colour: mostly green, lighter or darker; a few are yellow or brown.
fn leaf_color(random: &mut Rng) -> [f64; 3] {
    let green = mix([0.55, 0.72, 0.45], [0.75, 1.0, 0.6], random.unit());
    let turned = random.unit();
    let tint = mix([1.0, 0.75, 0.4], [0.9, 0.45, 0.35], random.unit());
    mix(green, tint, if turned > 0.96 { 0.8 } else { turned * 0.15 })
}

struct Leaflet {
    hub: DVec3,
    direction: DVec3,
    normal: DVec3,
    length: f64,
    color: [f64; 3],
}

/// Adds a leaflet of eight triangles, widest beyond its middle, folded along its rib and bent down
/// toward the tip.
fn add_leaflet(mesh: &mut Mesh, leaflet: Leaflet, material: u32) {
    let Leaflet {
        hub,
        direction,
        normal,
        length,
        color,
    } = leaflet;
    let side = normal.cross(direction);
    let mut vertex = |along: f64, across: f64, light: f64| {
        let lift = 0.35 * across.abs() - 0.3 * along * along;
        let position = hub + (direction * along + side * across + normal * lift) * length;
        let color = shade(color, light);
        mesh.add_vertex(Vertex {
            position,
            normal: DVec3::ZERO,
            texcoord: DVec2::ZERO,
            color,
        })
    };
    let rib = [0.0, 0.4, 0.72, 1.0].map(|along| vertex(along, 0.0, 1.0));
    let edges = [-1.0, 1.0].map(|sign| {
        [
            vertex(0.36, 0.13 * sign, 0.88),
            vertex(0.7, 0.2 * sign, 0.88),
        ]
    });
    for (edge, is_left) in edges.into_iter().zip([false, true]) {
        let half = [
            [rib[0], edge[0], rib[1]],
            [rib[1], edge[0], edge[1]],
            [rib[1], edge[1], rib[2]],
            [rib[2], edge[1], rib[3]],
        ];
        for [a, b, c] in half {
            mesh.add_triangle(if is_left { [a, c, b] } else { [a, b, c] }, material);
        }
    }
}

/// Returns the height of the meadow, metres: gentle waves, at most 0.75 m up or down.
fn ground_height(x: f64, z: f64) -> f64 {
    0.3 * (x * 0.11 + 0.4).sin() * (z * 0.09).cos()
        + 0.2 * (x * 0.23 - z * 0.17).sin()
        + 0.08 * (z * 0.5 + x * 0.31).sin()
}

/// Adds the ground to a distance of 160 m, in rings that widen outward.
fn add_meadow(mesh: &mut Mesh, seed: u64) {
    let grass = mesh.textured("meadow", grass_texture(seed));
    mesh.add_grid(96, 72, grass, |column, row| {
        let radius = 160.0 * (1.0 - row as f64 / 72.0).powi(2);
        let around = column as f64 / 96.0 * TAU;
        let (x, z) = if row == 72 {
            (0.0, 0.0)
        } else {
            (radius * around.cos(), -radius * around.sin())
        };
        let slope = |dx: f64, dz: f64| {
            (ground_height(x + dx, z + dz) - ground_height(x - dx, z - dz)) / 0.02
        };
        let normal = DVec3::new(-slope(0.01, 0.0), 1.0, -slope(0.0, 0.01)).normalize();
        Vertex::new(
            DVec3::new(x, ground_height(x, z), z),
            normal,
            DVec2::new(x, -z) / 3.0,
        )
    });
}

fn grass_texture(seed: u64) -> Texture {
    paint(512, 512, |u, v| {
        let patch = fractal(u, v, 4, 4, seed + 10);
        let blade = noise(u, v, 128, 256, seed + 20);
        let earth = (fractal(u, v, 8, 8, seed + 30) - 0.62).max(0.0) * 5.0;
        let green = mix([0.26, 0.36, 0.12], [0.50, 0.56, 0.22], patch);
        mix(
            shade(green, 0.65 + 0.55 * blade),
            [0.38, 0.30, 0.20],
            earth.min(0.8),
        )
    })
}

fn bark_texture(seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        // Furrows run along the stem with small deviations.
        let wander = (noise(u, v, 4, 8, seed + 40) - 0.5) * 0.12;
        let furrow = (noise(u + wander, v, 24, 5, seed + 50) - 0.5).abs() * 2.0;
        let grain = fractal(u, v, 16, 8, seed + 60);
        mix(
            [0.20, 0.16, 0.12],
            [0.52, 0.45, 0.37],
            furrow.sqrt() * (0.5 + 0.5 * grain),
        )
    })
}
