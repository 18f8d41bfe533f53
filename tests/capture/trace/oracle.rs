//! Scenes, rays and the oracle of the tracer's tests.

use glam::{DVec3, dvec3};
use headbox_core::random::Rng;
use headbox_scene::material::Material;
use headbox_scene::scene::Scene;
use headbox_scene::scene::Triangle;
use headbox_trace::bvh::{Hit, Ray};

pub(crate) use headbox_core::simd::levels;

/// A scene of separate triangles.
pub(crate) fn scene_from_triangles(triangles: &[[DVec3; 3]]) -> Scene {
    Scene {
        positions: triangles.as_flattened().to_vec(),
        triangles: (0..triangles.len() as u32)
            .map(|i| Triangle {
                vertices: [3 * i, 3 * i + 1, 3 * i + 2],
                material: 0,
            })
            .collect(),
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

/// Random triangles of about `size`, in a cube of edge `scale`.
pub(crate) fn soup(random: &mut Rng, count: usize, size: f64, scale: f64) -> Vec<[DVec3; 3]> {
    (0..count)
        .map(|_| {
            let at = random.in_cube(0.5);
            [(); 3].map(|()| (at + random.in_cube(0.5) * size) * scale)
        })
        .collect()
}

/// A flat square grid of `n` by `n` quads in the plane z = 0, [-0.5, 0.5]^2.
pub(crate) fn grid(n: u32) -> Vec<[DVec3; 3]> {
    let at = |i: u32, j: u32| {
        dvec3(
            f64::from(i) / f64::from(n) - 0.5,
            f64::from(j) / f64::from(n) - 0.5,
            0.0,
        )
    };
    let quad = |i, j| {
        [
            [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
            [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
        ]
    };
    (0..n * n).flat_map(|k| quad(k % n, k / n)).collect()
}

/// An octahedron, each triangle divided into four `depth` times, its vertices on the unit sphere.
pub(crate) fn sphere(depth: u32) -> Vec<[DVec3; 3]> {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let mut triangles = Vec::new();
    for (a, b) in [(x, y), (y, -x), (-x, -y), (-y, x)] {
        triangles.extend([[a, b, z], [b, a, -z]]);
    }
    for _ in 0..depth {
        let divide = |[a, b, c]: [DVec3; 3]| {
            // The midpoint of an edge is the same from either side: addition commutes.
            let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(divide).collect();
    }
    triangles
}

/// Rays from inside and outside a cube of edge `scale`: sixteen at a time with similar directions,
/// then random ones.
pub(crate) fn rays_for(random: &mut Rng, count: usize, scale: f64) -> Vec<Ray> {
    let mut rays = Vec::with_capacity(count);
    while rays.len() < count {
        let (from, toward) = (random.in_cube(0.5) * 2.0, random.in_cube(0.5) * 0.8);
        let coherent = random.below(3) > 0;
        for _ in 0..16 {
            let (from, toward) = if coherent {
                (
                    from + random.in_cube(0.5) * 0.05,
                    toward + random.in_cube(0.5) * 0.1,
                )
            } else {
                (random.in_cube(0.5) * 2.0, random.in_cube(0.5))
            };
            let length = if random.below(4) == 0 { 1e-2 } else { 1.0 };
            rays.push(Ray {
                origin: (from * scale).as_vec3(),
                direction: ((toward - from) * scale * length).as_vec3(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            });
        }
    }
    rays
}

/// A hit of the oracle.
#[derive(Debug)]
pub(crate) struct OracleHit {
    pub(crate) t: f64,
    pub(crate) primitive: u32,
    /// Margin inside the triangle: the least barycentric weight times the cosine at the ray; or the
    /// distance from the ray's origin in units of the triangle's size, if that is less. Negative
    /// for near misses.
    pub(crate) margin: f64,
    /// Cosine-like: area seen by the ray over the product of two edges. 0 is edge-on.
    pub(crate) facing: f64,
}

/// Bits of a hit, for exact comparison.
pub(crate) fn bits(hit: Option<Hit>) -> Option<[u32; 4]> {
    hit.map(|h| [h.t.to_bits(), h.primitive, h.u.to_bits(), h.v.to_bits()])
}

/// Finds every hit and near miss of a ray, by Möller and Trumbore (1997) in `f64`.
pub(crate) fn oracle_hits(triangles: &[[DVec3; 3]], ray: &Ray) -> Vec<OracleHit> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut hits = Vec::new();
    for (i, &[a, b, c]) in triangles.iter().enumerate() {
        let (e1, e2) = (b - a, c - a);
        let p = d.cross(e2);
        let determinant = e1.dot(p);
        let s = o - a;
        let q = s.cross(e1);
        let (u, v, t) = (
            s.dot(p) / determinant,
            d.dot(q) / determinant,
            e2.dot(q) / determinant,
        );
        let facing = determinant.abs() / (d.length() * e1.length() * e2.length());
        let inside = u.min(v).min(1.0 - u - v) * facing;
        // Near the origin the sign of t is as uncertain as the border, so a little before it counts
        // as a near miss.
        let away = (t - f64::from(ray.t_min)) * d.length() / (e1.length() + e2.length());
        let margin = inside.min(away);
        if margin > -1e-3 && t <= f64::from(ray.t_max) {
            hits.push(OracleHit {
                t,
                primitive: i as u32,
                margin,
                facing,
            });
        }
    }
    hits
}
