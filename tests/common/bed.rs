//! Analytic scenes: boxes, spheres and disks with procedural textures, and a gradient for a sky.

use glam::{DVec2, DVec3, dvec3};
use headbox_core::color::srgb8_from_linear;
use headbox_core::random::Rng;

/// Hit of a ray: `origin + t * direction`.
pub struct Hit {
    pub t: f64,
    /// Unit normal, toward the ray's origin.
    pub normal: DVec3,
    /// Linear colour.
    pub color: [f64; 3],
}

pub enum Shape {
    /// Axis-aligned, seen from inside or outside.
    Box {
        min: DVec3,
        max: DVec3,
    },
    Sphere {
        centre: DVec3,
        radius: f64,
    },
    /// With a unit normal.
    Disk {
        centre: DVec3,
        normal: DVec3,
        radius: f64,
    },
}

pub struct Scene {
    pub shapes: Vec<Shape>,
    /// Cycles per metre of the finest texture.
    pub detail: f64,
}

impl Shape {
    /// Reports every intersection of a ray with the shape: t and a normal.
    fn meet(&self, o: DVec3, d: DVec3, mut offer: impl FnMut(f64, DVec3)) {
        match *self {
            Self::Box { min, max } => {
                let (a, b) = ((min - o) / d, (max - o) / d);
                let (low, high) = (a.min(b), a.max(b));
                let (enter, leave) = (low.max_element(), high.min_element());
                if enter <= leave {
                    for (t, by_axis) in [(enter, low), (leave, high)] {
                        let axis = [DVec3::X, DVec3::Y, DVec3::Z]
                            .into_iter()
                            .find(|a| by_axis.dot(*a) == t);
                        offer(t, axis.unwrap_or(DVec3::X));
                    }
                }
            }
            Self::Sphere { centre, radius } => {
                let from = o - centre;
                let (a, b, c) = (d.dot(d), from.dot(d), from.dot(from) - radius * radius);
                let root = b * b - a * c;
                if root > 0.0 {
                    for t in [(-b - root.sqrt()) / a, (-b + root.sqrt()) / a] {
                        offer(t, (from + d * t) / radius);
                    }
                }
            }
            Self::Disk {
                centre,
                normal,
                radius,
            } => {
                let t = (centre - o).dot(normal) / d.dot(normal);
                if t.is_finite() && (o + d * t - centre).length_squared() < radius * radius {
                    offer(t, normal);
                }
            }
        }
    }
}

impl Scene {
    pub fn hit(&self, o: DVec3, d: DVec3) -> Option<Hit> {
        let mut best: Option<(f64, DVec3, usize)> = None;
        for (id, shape) in self.shapes.iter().enumerate() {
            shape.meet(o, d, |t, normal| {
                if t > 1e-6 && best.is_none_or(|b| t < b.0) {
                    best = Some((t, normal, id));
                }
            });
        }
        best.map(|(t, normal, id)| {
            let normal = if normal.dot(d) > 0.0 { -normal } else { normal };
            let light = 0.6 + 0.4 * normal.dot(dvec3(0.3, 0.8, 0.5).normalize()).max(0.0);
            let color = texture(o + d * t, normal, self.detail, id as i64).map(|c| c * light);
            Hit { t, normal, color }
        })
    }

    /// Linear radiance along a ray.
    pub fn radiance(&self, o: DVec3, d: DVec3) -> [f64; 3] {
        self.hit(o, d).map_or_else(|| sky(d), |hit| hit.color)
    }
}

/// Linear radiance of the sky.
pub fn sky(d: DVec3) -> [f64; 3] {
    let t = 0.5 + 0.5 * d.normalize().y;
    [0.3 + 0.2 * t, 0.4 + 0.3 * t, 0.5 + 0.5 * t]
}

pub fn srgb(linear: [f64; 3]) -> [u8; 4] {
    let [r, g, b] = linear.map(|c| srgb8_from_linear(c as f32));
    [r, g, b, 255]
}

fn hash(x: i64, y: i64, seed: i64) -> f64 {
    let mix =
        x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ seed.wrapping_mul(83_492_791);
    Rng::keyed(mix as u64).unit()
}

fn value_noise(p: DVec2, seed: i64) -> f64 {
    let (x, y) = (p.x.floor(), p.y.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (smooth(p.x - x), smooth(p.y - y));
    let at = |i: i64, j: i64| hash(x as i64 + i, y as i64 + j, seed);
    (at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v) + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v
}

/// Five octaves of noise on tiles of random tint: soft and sharp detail.
fn texture(p: DVec3, normal: DVec3, detail: f64, seed: i64) -> [f64; 3] {
    let a = normal.abs();
    let uv = match (a.x >= a.y && a.x >= a.z, a.y >= a.z) {
        (true, _) => DVec2::new(p.y, p.z),
        (_, true) => DVec2::new(p.x, p.z),
        _ => DVec2::new(p.x, p.y),
    };
    let octave = |o: i32| {
        0.5 * 0.6f64.powi(o)
            * value_noise(uv * detail / 16.0 * 2f64.powi(o), seed * 10 + i64::from(o))
    };
    let noise: f64 = (0..5).map(octave).sum();
    let tile = (uv * detail / 12.0).floor();
    let tint = hash(tile.x as i64, tile.y as i64, seed + 5);
    let gray = 0.1 + 0.45 * noise * (0.5 + tint);
    [gray * (0.7 + 0.6 * tint), gray, gray * (1.2 - 0.5 * tint)]
}

/// A closed, furnished room with the headbox's centre at the origin.
pub fn room(detail: f64) -> Scene {
    let cuboid = |a: [f64; 3], c: [f64; 3]| Shape::Box {
        min: a.into(),
        max: c.into(),
    };
    let sphere = |c: [f64; 3], radius| Shape::Sphere {
        centre: c.into(),
        radius,
    };
    let disk = |c: [f64; 3], n: DVec3, radius| Shape::Disk {
        centre: c.into(),
        normal: n.normalize(),
        radius,
    };
    Scene {
        shapes: vec![
            cuboid([-3.0, -1.5, -4.0], [3.5, 1.6, 3.0]),
            cuboid([-2.0, -1.5, -2.6], [-1.0, -0.2, -1.8]),
            cuboid([0.8, -1.5, -3.2], [1.2, 1.0, -2.9]),
            sphere([0.1, -0.6, -1.9], 0.5),
            sphere([1.8, 0.4, -1.2], 0.35),
            disk([-1.2, 0.6, -2.5], dvec3(0.5, 0.3, 0.8), 0.5),
            sphere([-1.9, 0.1, 0.9], 0.6),
            disk([0.4, 0.9, 1.8], dvec3(0.5, 0.8, -0.3), 0.7),
        ],
        detail,
    }
}

/// Foliage: many random disks over ground, under a sky; none nearer than 1 m to the origin.
pub fn leaves(detail: f64) -> Scene {
    let mut r = Rng::keyed(7);
    let mut shapes = vec![Shape::Disk {
        centre: dvec3(0.0, -1.5, 0.0),
        normal: DVec3::Y,
        radius: 30.0,
    }];
    while shapes.len() < 120 {
        let centre = r.in_cube(3.0);
        let normal = r.in_cube(1.0).normalize_or(DVec3::X);
        if centre.abs().max_element() > 1.2 && centre.y > -1.2 {
            shapes.push(Shape::Disk {
                centre,
                normal,
                radius: r.between(0.1, 0.3),
            });
        }
    }
    Scene { shapes, detail }
}
