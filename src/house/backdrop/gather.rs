//! Cube LDIs from rays behind a portal: tracing, assignment of hits to pixels, and merging of
//! samples at similar depth (R11, P2, D1, D2, C11).
//!
//! *Similar depth* is a bound on the difference of inverse depths: two samples of a pixel that move
//! apart by at most a pixel when the eye moves by [`BASELINE_M`] from the cube's centre. It needs
//! no tuning per model (D2).
//!
//! A depth pixel is drawn at the centre of its pixel, but random rays hit anywhere in it. So a hit
//! is moved to the depth of its surface at the pixel's centre: hits on a slanted surface then
//! agree, and lie on it. The shift is at most half of the similarity bound, so that a surface seen
//! nearly edge-on from the cube's centre keeps several samples per pixel; footprints alone do not
//! close it (docs/decisions/0022). Samples of images are not shifted: the papers' rules compare
//! their pixels as they are.

use super::repair::BackdropRepair;
use crate::house::House;
use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::parameters::{CaptureParameters, MergeRule};
use headbox_cube::model::samples::{CubeSamples, EncodedNormal};
use headbox_cube::pack::{CubeLdi, PackError, SplatIndexLayout, Split};
use headbox_cube::planes as primitives;
use headbox_ldi::from_images::layers::LayerCube;
use headbox_ldi::from_images::row_samples::{ImageSample, LinearColor16, RowSamples};
use headbox_trace::bvh::{PACKET, Ray, RayPacket};
use rayon::prelude::*;

/// Largest assumed distance of an eye from the centre of a backdrop's cube, for merging depths,
/// metres.
const BASELINE_M: f64 = 1.5;

/// Half edge of the headbox whose corners are [`BASELINE_M`] from its centre, metres.
const HALF_SIZE_M: f64 = BASELINE_M / 1.732_050_807_568_877_2;

/// Error bound of plane textures, pixels of the frames in [`primitives::Bound`], for eyes within
/// [`BASELINE_M`]. Faces of 308 pixels have frames with a focal length of 200 px; frames of 640x512
/// have 443, hence half a pixel there.
const ERROR_PX: f64 = 0.25;

/// Face size of the environment behind a portal, texels.
const ENVIRONMENT_PX: u32 = 64;

/// A sample with its row number: face times rows per face, plus row.
type RowSample = (u32, ImageSample);

/// Rays that are traced together, in the tracer's local space.
#[derive(Default)]
pub(super) struct RayBatch {
    /// Index of the source image; image 0 is pinned (C11).
    pub(super) image: u8,
    /// Eye from which the area of samples is measured: that of the image, or `None` for each ray's
    /// own start.
    pub(super) eye: Option<Vec3>,
    /// Origins, on the portal's plane, and directions.
    pub(super) rays: Vec<(Vec3, Vec3)>,
}

/// Capture of one cube LDI.
pub(super) struct CubeJob<'a> {
    pub(super) house: &'a House,
    /// Centre of the cube, world metres.
    pub(super) centre: DVec3,
    pub(super) face_px: u32,
    pub(super) rule: MergeRule,
    /// True to repair gaps ([`BackdropRepair`]) and to replace planar parts by plane textures;
    /// false for images.
    pub(super) repairs: bool,
}

impl CubeJob<'_> {
    /// Traces the batches `0..count`, whose rays `fill` generates, and packs the samples.
    pub(super) fn run(
        &self,
        count: u32,
        fill: impl Fn(u32, &mut RayBatch) + Sync,
    ) -> Result<CubeLdi, PackError> {
        let batches = (0..count)
            .into_par_iter()
            .map_init(RayBatch::default, |batch, i| {
                batch.rays.clear();
                fill(i, batch);
                let (samples, misses) = self.trace(batch);
                ((batch.image, samples), misses)
            });
        let (samples, misses): (Vec<_>, Vec<Vec<u32>>) = batches.unzip();
        let mut reached = vec![false; 6 * (ENVIRONMENT_PX as usize).pow(2)];
        for &texel in misses.iter().flatten() {
            reached[texel as usize] = true;
        }
        let environment = if reached.contains(&true) {
            let lighting = self.house.lighting();
            lighting.environment_where(ENVIRONMENT_PX, |texel| reached[texel])
        } else {
            Environment::default()
        };
        let mut cube = self.merge(&samples, environment);
        if !self.repairs {
            return CubeLdi::pack(&cube, SplatIndexLayout::Normal, Split::Auto);
        }
        let repair = BackdropRepair {
            house: self.house,
            centre: self.centre,
            tolerance: self.tolerance(),
        };
        repair.run(&mut cube.faces);
        primitives::pack_keeping_all_textures(cube, SplatIndexLayout::Normal, Split::Auto, ERROR_PX)
    }

    /// Traces a batch. Returns its samples, each with its row, and the environment texels of rays
    /// without a hit.
    fn trace(&self, batch: &RayBatch) -> (Vec<RowSample>, Vec<u32>) {
        let tracer = self.house.tracer();
        let tone = self.house.lighting().tone;
        let from_centre = (tracer.origin() - self.centre).as_vec3();
        let most = self.tolerance() / 2.0;
        let (mut samples, mut misses) = (Vec::with_capacity(batch.rays.len()), Vec::new());
        for rays in batch.rays.chunks(PACKET) {
            let ray = |&(origin, direction): &(Vec3, Vec3)| Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            let rays: Vec<Ray> = rays.iter().map(ray).collect();
            let hits = tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, ray) in rays.iter().enumerate() {
                let Some(hit) = hits.hit(lane) else {
                    let (face, [right, up, depth]) = Face::locate(ray.direction);
                    misses.push(texel_index(face, right / depth, up / depth, ENVIRONMENT_PX));
                    continue;
                };
                let position = ray.origin + ray.direction * hit.t;
                let (face, [right, up, depth]) = Face::locate(position + from_centre);
                if depth <= 0.0 {
                    continue;
                }
                let (color, normal) = self.house.surface(ray, &hit);
                let from_eye = position - batch.eye.unwrap_or(ray.origin);
                let area = patch_area(from_eye, normal);
                let pixel = texel_index(face, right / depth, up / depth, self.face_px);
                let mut inverse_depth = 1.0 / depth;
                if batch.eye.is_none() {
                    let [x, y] = texel_center(pixel, self.face_px);
                    let step = [x - right / depth, y - up / depth];
                    let shift = inverse_depth_change(face, normal, position + from_centre, step);
                    // Far away half of the similarity bound can exceed the inverse depth.
                    let most = most.min(inverse_depth / 2.0);
                    // `max` and `min` also remove the NaN of a plane through the centre.
                    inverse_depth += shift.max(-most).min(most);
                }
                let sample = ImageSample {
                    column: (pixel % self.face_px) as u16,
                    inverse_depth,
                    normal: EncodedNormal::new(normal),
                    // Under the tone curve: 16 bits would be too coarse for all that it compresses.
                    color: LinearColor16::new(color.map(|c| tone.compressed(c))),
                    weight: 1.0,
                    area,
                };
                samples.push((pixel / self.face_px, sample));
            }
        }
        (samples, misses)
    }

    /// Returns the similarity bound: the largest difference of similar inverse depths, 1/m.
    fn tolerance(&self) -> f32 {
        DepthBins::new(HALF_SIZE_M, self.face_px).inverse_depth(1.0) as f32
    }

    /// Merges samples, given in the order of their rays, batch by batch with its image, to a cube.
    fn merge(&self, batches: &[(u8, Vec<RowSample>)], environment: Environment) -> CubeSamples {
        let image_samples = |batches: &[(u8, Vec<RowSample>)]| {
            let mut rows = RowSamples::new(self.face_px, batches[0].0.into());
            for &(row, sample) in batches.iter().flat_map(|(_, samples)| samples) {
                rows.push(row, sample);
            }
            rows
        };
        let images = batches.chunk_by(|a, b| a.0 == b.0).map(image_samples);
        let mut cube = LayerCube::new(self.face_px, self.rule, self.tolerance());
        cube.add(&images.collect::<Vec<_>>());
        // No strata: the rays do not start in a headbox.
        let parameters = CaptureParameters {
            merge_rule: self.rule,
            ..CaptureParameters::unlit(0, 0)
        };
        let info = CaptureInfo {
            scene: self.house.scene().name.clone(),
            centre: self.centre,
            half_size_m: HALF_SIZE_M,
            frame: self.house.scene().frame,
            exposure: self.house.lighting().exposure,
            tone: self.house.lighting().tone,
            parameters,
            rays_traced: batches
                .iter()
                .map(|(_, samples)| samples.len() as u64)
                .sum(),
            ..CaptureInfo::default()
        };
        CubeSamples {
            info,
            faces: cube.finish(),
            environment,
        }
    }
}

/// Returns the area of the surface patch that a pixel of an image covers, times the square of the
/// image's focal length in pixels: Z^3 / |n . p| for the point `p` relative to the image's eye,
/// metres (C10). The images are cubes, so Z is the largest component.
fn patch_area(p: Vec3, normal: Vec3) -> f32 {
    p.abs().max_element().powi(3) / normal.dot(p).abs().max(1e-6)
}

/// Returns the index of a texel (face, row, column) at a position on a face; `right` and `up` in
/// -1..1.
fn texel_index(face: Face, right: f32, up: f32, size_px: u32) -> u32 {
    let half = size_px as f32 / 2.0;
    let index = |c: f32| ((half * (1.0 + c)) as u32).min(size_px - 1);
    (face.index() as u32 * size_px + index(-up)) * size_px + index(right)
}

/// Returns the centre of a texel: right and up, in -1..1.
fn texel_center(texel: u32, size_px: u32) -> [f32; 2] {
    let at = |i: u32| (2 * (i % size_px) + 1) as f32 / size_px as f32 - 1.0;
    [at(texel), -at(texel / size_px)]
}

/// Returns the change of inverse depth for a step to the right and up on a face, 1/m, on a plane
/// through a point (relative to the cube's centre) with a normal. Infinite or NaN for a plane
/// through the centre.
fn inverse_depth_change(face: Face, normal: Vec3, point: Vec3, [right, up]: [f32; 2]) -> f32 {
    let step = face.right().as_vec3() * right + face.up().as_vec3() * up;
    normal.dot(step) / normal.dot(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Focal length of the small pixels below, pixels.
    const FOCAL_PX: f32 = 512.0;

    /// Corners of the small pixel about a direction, on the face that it falls on.
    fn pixel_corners(direction: Vec3) -> [Vec3; 4] {
        let (face, [.., depth]) = Face::locate(direction);
        let half = depth / FOCAL_PX / 2.0;
        let (right, up) = (face.right().as_vec3() * half, face.up().as_vec3() * half);
        [-right - up, right - up, right + up, up - right].map(|corner| direction + corner)
    }

    /// Area of a quadrilateral, m^2, from its diagonals.
    fn quad_area([a, b, c, d]: [Vec3; 4]) -> f32 {
        (c - a).cross(d - b).length() / 2.0
    }

    /// Relative difference between the patch at a pixel's centre and its true extent: (n . step /
    /// n . p)^2 for surfaces seen at more than `LEAST_COSINE`, and roundings of f32.
    const AREA_TOLERANCE: f32 = 0.005;
    const LEAST_COSINE: f32 = 0.1;

    #[test]
    fn patch_area_is_that_of_the_pixels_quadrilateral() {
        let mut rng = headbox_core::random::Rng::keyed(5);
        let mut directions = || rng.in_cube(1.0).as_vec3();
        let mut faces = [0; 6];
        for _ in 0..2000 {
            let (p, normal) = (directions() * 9.0, directions().normalize());
            if normal.dot(p.normalize()).abs() < LEAST_COSINE {
                continue;
            }
            let on_plane = |ray: Vec3| ray * (normal.dot(p) / normal.dot(ray));
            let expected = quad_area(pixel_corners(p).map(on_plane)) * FOCAL_PX.powi(2);
            let found = patch_area(p, normal);
            assert!(
                (found / expected - 1.0).abs() < AREA_TOLERANCE,
                "{p} {normal}: {found} {expected}"
            );
            faces[Face::locate(p).0.index()] += 1;
        }
        assert!(faces.iter().all(|count| *count > 100), "{faces:?}");
    }

    /// The area that a small pixel about a ray covers on a house's surface, by tracing its corners;
    /// `None` where these do not lie on one plane, or a ray meets nothing.
    fn traced_area(house: &House, eye: Vec3, direction: Vec3) -> Option<f32> {
        let hit = |direction: Vec3| {
            let ray = Ray {
                origin: eye,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            let hit = house.tracer().closest(&ray)?;
            let (_, normal) = house.surface(&ray, &hit);
            Some((direction * hit.t, normal))
        };
        let (p, normal) = hit(direction)?;
        let mut corners = [Vec3::ZERO; 4];
        for (found, ray) in corners.iter_mut().zip(pixel_corners(direction)) {
            let (corner, other) = hit(ray)?;
            let off = normal.dot(corner - p).abs() / p.length();
            if other.dot(normal) < 0.999 || off > 1e-5 {
                return None;
            }
            *found = corner;
        }
        let slanted = normal.dot(p.normalize()).abs() < LEAST_COSINE;
        (!slanted).then(|| quad_area(corners) * FOCAL_PX.powi(2))
    }

    #[test]
    fn traced_samples_have_the_area_seen_from_the_images_eye() {
        let house = House::new(headbox_scenes::house(0, 5_000)).expect("a built-in scene");
        let eye = house.cell_centre(0).expect("a cell");
        let job = CubeJob {
            house: &house,
            centre: eye,
            face_px: 32,
            rule: MergeRule::SmallerArea,
            repairs: false,
        };
        let local = (eye - house.tracer().origin()).as_vec3();
        let mut rng = headbox_core::random::Rng::keyed(6);
        let mut compared = 0;
        for _ in 0..1000 {
            let direction = rng.in_cube(1.0).as_vec3().normalize();
            let Some(expected) = traced_area(&house, local, direction) else {
                continue;
            };
            // A ray starts on the way, as at a portal, and its image's eye counts; without an
            // image, the eye is where the ray starts.
            let starts = [(Some(local), local + direction * 0.1), (None, local)];
            for (eye, start) in starts {
                let batch = RayBatch {
                    image: 0,
                    eye,
                    rays: vec![(start, direction)],
                };
                let (samples, _) = job.trace(&batch);
                let [(_, sample)] = samples[..] else {
                    panic!("{} samples of a ray", samples.len());
                };
                assert!(
                    (sample.area / expected - 1.0).abs() < AREA_TOLERANCE,
                    "{eye:?} {direction}: {} {expected}",
                    sample.area
                );
                compared += 1;
            }
        }
        assert!(compared > 500, "{compared} samples compared");
    }

    #[test]
    fn hit_depth_is_plane_at_pixel_centre() {
        let (normal, point) = (Vec3::new(0.6, 0.64, 0.48), Vec3::new(0.7, -1.1, 3.0));
        let (face, [right, up, depth]) = Face::locate(point);
        let pixel = texel_index(face, right / depth, up / depth, 8);
        let [x, y] = texel_center(pixel, 8);
        assert_eq!(texel_index(face, x, y, 8), pixel);
        assert!(
            (x - right / depth).abs() <= 0.125 && (y - up / depth).abs() <= 0.125,
            "in one pixel"
        );
        let (column, row) = (f64::from(pixel % 8) + 0.5, f64::from(pixel / 8 % 8) + 0.5);
        let direction = face.direction(column, row, 8).as_vec3();
        let expected = normal.dot(direction) / normal.dot(point);
        let found = 1.0 / depth
            + inverse_depth_change(face, normal, point, [x - right / depth, y - up / depth]);
        assert!(
            (found - expected).abs() < 1e-6 && (found - 1.0 / depth).abs() > 1e-3,
            "{found} {expected}: rounding of f32"
        );
    }
}
