//! Fills pinholes: gaps of one pixel in a surface, where rays are aimed at the missing sample.
//!
//! Rays are random. The last few depth pixels of a wall are found late, after thousands of rays for
//! each, and a missing one is a speck through which the background shows (docs/decisions/0017).
//! Where both neighbours of a pixel lie on one surface and the pixel itself has no sample of it,
//! rays from the centre, limited to the depth where the surface must be, search for it. The first
//! hit becomes a surface sample like any other.

use super::surface_samples::FaceSurfaces;
use crate::accumulate::accumulator::{Accumulator, Sample, to_unorm16};
use crate::light::pool::same_surface;
use crate::light::shade::{Shader, SurfaceSample};
use crate::merge::centre_rays::CentreRays;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_trace::bvh::{PACKET, Ray};
use headbox_trace::sampler::RayKey;
use rayon::prelude::*;

/// Range before and behind the neighbours' plane in which a missing sample is searched, as a share
/// of its distance: twice the tolerance of [`same_surface`].
const REACH: f32 = 2e-3;

/// Repair of one face.
struct PinholeRepair<'a> {
    rays: CentreRays,
    shader: &'a Shader<'a>,
    bins: DepthBins,
    /// Half of the headbox's edge, metres; nothing inside it is a depth pixel.
    half_size_m: f32,
}

/// A sample to insert: its pixel in row-major order, its rank among the samples of that pixel, and
/// the sample.
type Insertion = (u32, u32, SurfaceSample);

/// Adds the missing samples of a face.
pub(crate) fn repair_pinholes(surfaces: &mut FaceSurfaces, face: Face, shader: &Shader) {
    let spec = shader.capture.spec;
    let repair = PinholeRepair {
        rays: CentreRays {
            face,
            size_px: surfaces.size_px,
        },
        shader,
        bins: spec.depth_bins(),
        half_size_m: spec.half_size_m as f32,
    };
    let rows = (0..surfaces.size_px).into_par_iter();
    let insertions: Vec<Insertion> = rows
        .flat_map_iter(|y| repair.missing_in_row(surfaces, y))
        .collect();
    insert(surfaces, &insertions);
}

impl PinholeRepair<'_> {
    /// The missing samples of row `y`, in order.
    fn missing_in_row(&self, surfaces: &FaceSurfaces, y: u32) -> Vec<Insertion> {
        let last = surfaces.size_px - 1;
        let mut missing: Vec<Insertion> = Vec::new();
        for x in 0..surfaces.size_px {
            let pixel_start = missing.len();
            let here = surfaces.pixel(x, y);
            let across =
                (x > 0 && x < last).then(|| [surfaces.pixel(x - 1, y), surfaces.pixel(x + 1, y)]);
            let down =
                (y > 0 && y < last).then(|| [surfaces.pixel(x, y - 1), surfaces.pixel(x, y + 1)]);
            for [before, after] in across.into_iter().chain(down) {
                for neighbour in before {
                    let is_same = |other: &SurfaceSample| same_surface(neighbour, other);
                    let is_gap = !here.iter().any(is_same) && after.iter().any(is_same);
                    if is_gap
                        && !missing[pixel_start..]
                            .iter()
                            .any(|(.., sample)| is_same(sample))
                        && let Some(sample) = self.trace_missing(neighbour, [x, y])
                    {
                        let rank = here
                            .partition_point(|p| (p.bin, p.class) < (sample.bin, sample.class))
                            as u32;
                        missing.push((y * surfaces.size_px + x, rank, sample));
                    }
                }
            }
            missing[pixel_start..]
                .sort_by_key(|(_, rank, sample)| (*rank, sample.bin, sample.class));
        }
        missing
    }

    /// Traces the sample of a neighbour's surface in the middle of a pixel; or elsewhere in it, if
    /// another surface is there at its depth: it may be a strip narrower than the pixel.
    fn trace_missing(&self, neighbour: &SurfaceSample, pixel: [u32; 2]) -> Option<SurfaceSample> {
        let is_same = |sample: &SurfaceSample| same_surface(neighbour, sample);
        let middle = self.trace_at(neighbour, pixel, [0.5; 2])?;
        if is_same(&middle) {
            return Some(middle);
        }
        self.rays
            .offsets(pixel)
            .take(PACKET)
            .filter_map(|offset| self.trace_at(neighbour, pixel, offset))
            .find(is_same)
    }

    /// Traces a sample near a neighbour's plane at a position in a pixel.
    fn trace_at(
        &self,
        neighbour: &SurfaceSample,
        pixel: [u32; 2],
        offset: [f64; 2],
    ) -> Option<SurfaceSample> {
        let tracer = self.shader.capture.tracer;
        let direction = self.rays.ray(pixel, offset, [0.0; 2]).direction;
        // The direction has eye depth 1, so that `t` is an eye depth. For an edge-on plane it is
        // infinite or NaN.
        let t = neighbour.plane_distance / neighbour.plane_normal.dot(direction);
        if !(t.is_finite() && t > self.half_size_m) {
            return None;
        }
        let hit = tracer.closest(&Ray {
            origin: Vec3::ZERO,
            direction,
            t_min: (t * (1.0 - REACH)).max(self.half_size_m),
            t_max: t * (1.0 + REACH),
        })?;
        let (bin, offset) = self.bins.place(1.0 / hit.t);
        let scene = tracer.scene();
        let distance = hit.t * direction.length();
        let (class, cos) = Accumulator::class_of_hit(tracer, direction, hit.primitive);
        let hit_sample = Sample {
            face: self.rays.face,
            x: pixel[0] as u16,
            y: pixel[1] as u16,
            bin,
            offset,
            class,
            albedo: scene
                .paint(hit.primitive)
                .albedo(hit.u, hit.v)
                .map(to_unorm16),
            primitive: hit.primitive,
            barycentric: [hit.u, hit.v].map(to_unorm16),
            area: distance * distance / (cos.abs() / direction.length()).max(1e-6),
            key: RayKey(u64::MAX),
        };
        let acc = Accumulator::new(&hit_sample);
        let [x, y] = pixel;
        Some(self.shader.surface_sample(&acc, self.rays.face, x, y))
    }
}

/// Inserts samples from the last to the first, so that each sample of the face moves once and the
/// face is in memory only once.
fn insert(surfaces: &mut FaceSurfaces, insertions: &[Insertion]) {
    let Some((_, _, any)) = insertions.first() else {
        return;
    };
    let mut end = surfaces.samples.len();
    surfaces.samples.resize(end + insertions.len(), *any);
    for (before, (pixel, rank, sample)) in insertions.iter().enumerate().rev() {
        let index = (surfaces.offsets[*pixel as usize] + rank) as usize;
        surfaces.samples.copy_within(index..end, index + before + 1);
        surfaces.samples[index + before] = *sample;
        end = index;
    }
    let mut added = 0;
    let mut rest = insertions;
    for (pixel, offset) in (0..).zip(&mut surfaces.offsets) {
        let passed = rest.partition_point(|(insertion_pixel, ..)| *insertion_pixel < pixel);
        added += passed as u32;
        rest = &rest[passed..];
        *offset += added;
    }
}
