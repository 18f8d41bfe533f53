//! Irradiance at vertices.

use super::{BakeOptions, BakeProgress};
use crate::light::{LightSample, Lighting, LitPoint, luminance};
use crate::portal_model::Side;
use crate::sampler::{random4, unit_float};
use crate::scene::{Scene, Triangle};
use crate::trace::Tracer;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Triangles around a vertex without a normal share its light where their normals differ by no more than this: the
/// cosine of 30 degrees.
const SMOOTH_COSINE: f32 = 0.866;

/// Samples by which the brighter side of a surface is told.
const SIDE_SAMPLES: u32 = 4;

/// Vertices between two reports of progress.
const REPORT: usize = 4096;

pub(super) struct VertexLight<'a> {
    /// Over the source scene.
    pub(super) tracer: &'a Tracer,
    pub(super) lighting: &'a Lighting,
    pub(super) options: &'a BakeOptions,
    /// Of triangles of the source scene, the side that is seen; of those beyond its end, any.
    pub(super) sides: &'a [Side],
}

/// Vertices with one normal each, and the triangles around each.
struct Corners {
    /// Unit normals toward the front.
    normals: Vec<Vec3>,
    /// Where the triangles around each vertex begin in `around`.
    first: Vec<u32>,
    /// Triangle and corner.
    around: Vec<(u32, u8)>,
}

/// Light of a vertex, irradiance / pi.
#[derive(Clone, Copy, Default)]
struct Light {
    sun: Vec3,
    soft: Vec3,
}

impl VertexLight<'_> {
    /// Multiplies the vertex colours of `scene` by light. `sources` names the triangle of the tracer's scene that each
    /// of its triangles is a piece of.
    pub(super) fn bake(&self, scene: &mut Scene, sources: &[u32], progress: &BakeProgress<'_>) {
        let corners = separate_creases(scene);
        let count = scene.positions.len();
        let (done, given_up) = (AtomicUsize::new(0), AtomicBool::new(false));
        let mut lights: Vec<Light> = (0..count)
            .into_par_iter()
            .map(|vertex| {
                if given_up.load(Ordering::Relaxed) {
                    return Light::default();
                }
                let light = self.light(scene, sources, &corners, vertex);
                if (done.fetch_add(1, Ordering::Relaxed) + 1).is_multiple_of(REPORT)
                    && progress(done.load(Ordering::Relaxed), count).is_break()
                {
                    given_up.store(true, Ordering::Relaxed);
                }
                light
            })
            .collect();
        for _ in 0..self.options.smoothing {
            lights = smooth(scene, &corners, &lights);
        }
        if !given_up.into_inner() {
            // The end of the work: nothing is left to be given up.
            let _ = progress(count, count);
        }
        let exposure = self.lighting.exposure;
        scene.colors.resize(count, Vec3::ONE);
        for (color, light) in scene.colors.iter_mut().zip(lights) {
            *color *= (light.sun + light.soft) * exposure;
        }
    }

    /// Light on the side of a vertex that is seen, else on the brighter one.
    fn light(&self, scene: &Scene, sources: &[u32], corners: &Corners, vertex: usize) -> Light {
        let at = |side: f32, samples: u32| self.light_of_side(scene, sources, corners, vertex, side, samples);
        let around = &corners.around[corners.first[vertex] as usize..corners.first[vertex + 1] as usize];
        let seen = around.iter().find_map(|&(triangle, _)| match self.sides.get(sources[triangle as usize] as usize) {
            Some(Side::Front) => Some(1.0),
            Some(Side::Back) => Some(-1.0),
            Some(Side::Any) | None => None,
        });
        if let Some(side) = seen {
            return at(side, self.options.samples.max(1));
        }
        let [front, back] = [1.0, -1.0].map(|side| at(side, SIDE_SAMPLES));
        let level = |light: &Light| luminance((light.sun + light.soft).to_array());
        at(if level(&back) > level(&front) { -1.0 } else { 1.0 }, self.options.samples.max(1))
    }

    /// Mean of samples over the surface around a vertex, half way to the far edges of its triangles, so that a vertex
    /// on an edge is lit as the surface beside it is.
    fn light_of_side(
        &self,
        scene: &Scene,
        sources: &[u32],
        corners: &Corners,
        vertex: usize,
        side: f32,
        samples: u32,
    ) -> Light {
        let around = &corners.around[corners.first[vertex] as usize..corners.first[vertex + 1] as usize];
        let mut sum = Light::default();
        for index in 0..samples {
            let Some(&(triangle, corner)) = around.get(index as usize * around.len() / samples as usize) else { break };
            let vertices = scene.triangles[triangle as usize].vertices;
            let [a, b, c] = [0, 1, 2].map(|i| scene.positions[vertices[(corner as usize + i) % 3] as usize]);
            let [u, v, ..] = random4([vertex as u32, index, 0x6261, 0x6b65]).map(unit_float);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let place = a + (b - a) * f64::from(u / 2.0) + (c - a) * f64::from(v / 2.0);
            let geometric = (b - a).cross(c - a).normalize_or_zero().as_vec3();
            let normal = corners.normals[vertex];
            let normal = if normal.dot(geometric) < 0.0 { -normal } else { normal };
            let extent = self
                .tracer
                .triangle(sources[triangle as usize])
                .iter()
                .map(|p| p.abs().max_element())
                .fold(0.0, f32::max);
            let point = LitPoint {
                position: (place - self.tracer.origin()).as_vec3(),
                normal: geometric * side,
                shading_normal: normal * side,
                extent,
            };
            let sample = LightSample { stream: vertex as u32, index };
            sum.sun += self.lighting.sharp_radiosity(self.tracer, &point, &sample);
            sum.soft += self.lighting.soft_radiosity(self.tracer, &point, &sample);
        }
        Light { sun: sum.sun / samples as f32, soft: sum.soft / samples as f32 }
    }
}

/// Gives every vertex one normal: its own, or, where the scene has none for it, that of the triangles around it;
/// triangles that meet there at an angle get vertices of their own.
fn separate_creases(scene: &mut Scene) -> Corners {
    let originals = scene.positions.len();
    let has_normal = |scene: &Scene, vertex: usize| scene.normals.get(vertex).is_some_and(|n| *n != Vec3::ZERO);
    let mut normals: Vec<Vec3> =
        (0..originals).map(|v| if has_normal(scene, v) { scene.normals[v] } else { Vec3::ZERO }).collect();
    // Further vertices at the place of one that stands at a crease: a list through `next`.
    let mut next: Vec<Option<u32>> = vec![None; originals];
    for triangle in 0..scene.triangles.len() {
        let face = scene.geometric_normal(triangle as u32);
        for corner in 0..3 {
            let mut vertex = scene.triangles[triangle].vertices[corner];
            if has_normal(scene, vertex as usize) {
                continue;
            }
            loop {
                let normal = &mut normals[vertex as usize];
                if *normal == Vec3::ZERO {
                    *normal = face;
                }
                if normal.dot(face) >= SMOOTH_COSINE {
                    break;
                }
                vertex = match next[vertex as usize] {
                    Some(other) => other,
                    None => {
                        let copy = duplicate(scene, vertex as usize);
                        next[vertex as usize] = Some(copy);
                        next.push(None);
                        normals.push(Vec3::ZERO);
                        copy
                    }
                };
            }
            scene.triangles[triangle].vertices[corner] = vertex;
        }
    }
    let (first, around) = around_vertices(&scene.triangles, scene.positions.len());
    Corners { normals, first, around }
}

/// Adds a copy of a vertex.
fn duplicate(scene: &mut Scene, vertex: usize) -> u32 {
    scene.positions.push(scene.positions[vertex]);
    if let Some(&normal) = scene.normals.get(vertex) {
        scene.normals.push(normal);
    }
    if let Some(&texcoord) = scene.texcoords.get(vertex) {
        scene.texcoords.push(texcoord);
    }
    if let Some(&color) = scene.colors.get(vertex) {
        scene.colors.push(color);
    }
    scene.positions.len() as u32 - 1
}

/// For each vertex the triangles around it, by counting sort.
fn around_vertices(triangles: &[Triangle], vertices: usize) -> (Vec<u32>, Vec<(u32, u8)>) {
    let mut first = vec![0_u32; vertices + 1];
    for vertex in triangles.iter().flat_map(|t| t.vertices) {
        first[vertex as usize + 1] += 1;
    }
    for i in 0..vertices {
        first[i + 1] += first[i];
    }
    let mut next = first.clone();
    let mut around = vec![(0, 0); triangles.len() * 3];
    for (index, triangle) in (0_u32..).zip(triangles) {
        for (corner, vertex) in (0_u8..).zip(triangle.vertices) {
            let place = &mut next[vertex as usize];
            around[*place as usize] = (index, corner);
            *place += 1;
        }
    }
    (first, around)
}

/// Soft light averaged with that of the neighbours, each vertex counting as much as its neighbours together.
fn smooth(scene: &Scene, corners: &Corners, lights: &[Light]) -> Vec<Light> {
    let smoothed = |vertex: usize| {
        let around = &corners.around[corners.first[vertex] as usize..corners.first[vertex + 1] as usize];
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0_f32);
        for &(triangle, corner) in around {
            let vertices = scene.triangles[triangle as usize].vertices;
            for other in [1, 2].map(|i| vertices[(corner as usize + i) % 3] as usize) {
                sum += lights[other].soft;
                weight += 1.0;
            }
        }
        let own = lights[vertex];
        Light { sun: own.sun, soft: if weight > 0.0 { (own.soft + sum / weight) / 2.0 } else { own.soft } }
    };
    (0..lights.len()).into_par_iter().map(smoothed).collect()
}
