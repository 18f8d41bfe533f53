//! Gaps of one pixel in a surface, mended: rays that are aimed where a depth pixel is missing for certain.
//!
//! Rays are random. What a thousand of them would find anyway, the last few depth pixels of a wall, they find late, and each that
//! is missing is a speck through which the background shows (docs/decisions/0017).
//! Where both neighbours of a pixel lie on one surface and the pixel itself has nothing of it, one ray from the centre
//! that looks for it there, and only there, decides. What it meets becomes a depth pixel like any other.

use crate::accumulate::accumulator::{Accumulator, Sample, sixteen_bits};
use crate::light::pool::same_surface;
use crate::light::shade::{LitPart, Shader};
use crate::surfaces::surface_samples::FaceParts;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_trace::bvh::Ray;
use headbox_trace::sampler::RayKey;
use rayon::prelude::*;

/// How far before and behind the neighbours' plane a missing sample is looked for, as a share of its distance: twice of what
/// [`same_surface`] allows.
const REACH: f32 = 2e-3;

/// What mending needs beside the parts.
pub(crate) struct Mender<'a> {
    /// The face.
    pub face: Face,
    /// Knows what surfaces are.
    pub shader: &'a Shader<'a>,
    /// Depth bins of the capture.
    pub bins: &'a DepthBins,
    /// Half of the headbox's edge, metres; nothing inside it is a depth pixel.
    pub half_size_m: f32,
}

impl Mender<'_> {
    /// Adds the missing parts of a face.
    pub(crate) fn mend(&self, parts: &mut FaceParts) {
        let rows = (0..parts.size_px)
            .into_par_iter()
            .map(|y| self.missing_in_row(parts, y));
        let found: Vec<(u32, u32, LitPart)> = rows.flatten_iter().collect();
        insert(parts, &found);
    }

    /// The missing parts of row `y`, each with the row's pixel and the place in `parts` before which it belongs, in order.
    fn missing_in_row(&self, parts: &FaceParts, y: u32) -> Vec<(u32, u32, LitPart)> {
        let last = parts.size_px - 1;
        let mut found: Vec<(u32, u32, LitPart)> = Vec::new();
        for x in 0..parts.size_px {
            let (first_of_pixel, here) = (found.len(), parts.pixel(x, y));
            let across =
                (x > 0 && x < last).then(|| [parts.pixel(x - 1, y), parts.pixel(x + 1, y)]);
            let down = (y > 0 && y < last).then(|| [parts.pixel(x, y - 1), parts.pixel(x, y + 1)]);
            for [before, after] in across.into_iter().chain(down) {
                for neighbour in before {
                    let is_same = |other: &LitPart| same_surface(neighbour, other);
                    let is_gap = !here.iter().any(is_same) && after.iter().any(is_same);
                    if is_gap
                        && !found[first_of_pixel..]
                            .iter()
                            .any(|(.., part)| is_same(part))
                        && let Some(part) = self.look_for(neighbour, x, y)
                    {
                        let rank = here
                            .partition_point(|p| (p.bin, p.class) < (part.bin, part.class))
                            as u32;
                        found.push((y * parts.size_px + x, rank, part));
                    }
                }
            }
            found[first_of_pixel..].sort_by_key(|(_, rank, part)| (*rank, part.bin, part.class));
        }
        found
    }

    /// What lies on a neighbour's surface in the middle of pixel (x, y).
    fn look_for(&self, neighbour: &LitPart, x: u32, y: u32) -> Option<LitPart> {
        let tracer = self.shader.tracer;
        let direction = self
            .face
            .direction(
                f64::from(x) + 0.5,
                f64::from(y) + 0.5,
                self.shader.face_size_px,
            )
            .as_vec3();
        // The direction has eye depth 1, so that `t` is an eye depth. Of an edge-on plane it is infinite or NaN.
        let t = neighbour.plane_distance / neighbour.plane_normal.dot(direction);
        if !(t.is_finite() && t > self.half_size_m) {
            return None;
        }
        let (t_min, t_max) = ((t * (1.0 - REACH)).max(self.half_size_m), t * (1.0 + REACH));
        let hit = tracer.closest(&Ray {
            origin: Vec3::ZERO,
            direction,
            t_min,
            t_max,
        })?;
        let (bin, offset) = self.bins.place(1.0 / hit.t);
        let scene = tracer.scene();
        let distance = hit.t * direction.length();
        let cos = neighbour.plane_normal.dot(direction) / direction.length();
        let sample = Sample {
            face: self.face,
            x: x as u16,
            y: y as u16,
            bin,
            offset,
            class: neighbour.class,
            albedo: scene
                .paint(hit.primitive)
                .albedo(hit.u, hit.v)
                .map(sixteen_bits),
            primitive: hit.primitive,
            barycentric: [hit.u, hit.v].map(sixteen_bits),
            area: distance * distance / cos.abs().max(1e-6),
            key: RayKey(u64::MAX),
        };
        let material = scene.triangles[hit.primitive as usize].material;
        let acc = Accumulator::new(&sample);
        let part = self.shader.part(&acc, self.face, x, y);
        let is_it =
            Accumulator::class(material, acc.is_back(), part.plane_normal) == neighbour.class;
        (is_it && same_surface(neighbour, &part)).then_some(part)
    }
}

/// Puts parts in their places, from the last to the first, so that each part moves once and a face's parts are in memory
/// only once.
fn insert(parts: &mut FaceParts, found: &[(u32, u32, LitPart)]) {
    let Some((_, _, any)) = found.first() else {
        return;
    };
    let mut from = parts.parts.len();
    parts.parts.resize(from + found.len(), *any);
    for (before, (pixel, rank, part)) in found.iter().enumerate().rev() {
        let place = (parts.offsets[*pixel as usize] + rank) as usize;
        parts.parts.copy_within(place..from, place + before + 1);
        parts.parts[place + before] = *part;
        from = place;
    }
    let (mut added, mut rest) = (0, found);
    for (pixel, offset) in (0..).zip(&mut parts.offsets) {
        let new = rest.partition_point(|(of, ..)| *of < pixel);
        (added, rest) = (added + new as u32, &rest[new..]);
        *offset += added;
    }
}
