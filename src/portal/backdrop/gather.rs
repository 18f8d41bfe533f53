//! From rays behind a portal to a cube LDI: hits, their pixels, and what becomes of those at similar depth (R11,
//! P2, D1, D2, C11).
//!
//! *Similar depth* is measured in inverse depth, by parallax: two samples of a pixel that part by at most a pixel when the
//! eye moves by [`BASELINE_M`] from the cube's centre. It needs no tuning per model (D2).
//!
//! A depth pixel is drawn from the middle of its pixel, but random rays hit anywhere in it. So a hit counts with the depth that
//! its surface has in the middle: hits of a slanted surface agree, and lie on it. At most half of what is similar is changed, so
//! that a surface that the centre sees nearly edge-on keeps several samples a pixel; footprints alone do not close it
//! (docs/decisions.md: a hit counts with its surface's depth in the middle of its pixel).
//! Images are taken as they are: the papers' rules compare what their pixels hold.

use super::mend::Mender;
use crate::capture::rig::Face;
use crate::capture::srgb8_from_linear;
use crate::capture::trace::{HitPacket, PACKET, Ray, RayPacket};
use crate::environment::Environment;
use crate::ldi::accumulate::DepthBins;
use crate::ldi::merge::MergeRule;
use crate::ldi::parameters::CaptureParameters;
use crate::ldi::{CaptureInfo, CubeLdi, DepthPixel, EncodedNormal, LayeredDepthImage};
use crate::packed::{PackError, PackedCube, SplatIndexLayout, Split};
use crate::portal::house::House;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// How far an eye is from the centre of a backdrop's cube for which depths are told apart, metres.
const BASELINE_M: f64 = 1.5;

/// Half of the edge of the headbox whose corners are so far from its centre, metres.
const HALF_SIZE_M: f64 = BASELINE_M / 1.732_050_807_568_877_2;

/// Texels a side of the sky behind a portal.
const ENVIRONMENT_PX: u32 = 64;

/// Rays that are traced together, in the tracer's local frame.
#[derive(Default)]
pub(super) struct Batch {
    /// Which image they belong to; image 0 is pinned (C11).
    pub(super) image: u8,
    /// From where surfaces look as large as they were sampled: the eye of an image, or `None` for the rays' own starts.
    pub(super) eye: Option<Vec3>,
    /// Starts, on the portal's plane, and directions.
    pub(super) rays: Vec<(Vec3, Vec3)>,
}

/// A cube to be filled.
pub(super) struct CubeJob<'a> {
    pub(super) house: &'a House,
    /// World metres.
    pub(super) centre: DVec3,
    pub(super) face_px: u32,
    pub(super) rule: MergeRule,
    /// Whether gaps are mended ([`Mender`]); images are taken as they are.
    pub(super) mends: bool,
}

/// A hit in its pixel.
#[derive(Clone, Copy)]
struct Sample {
    /// Number of the pixel: face, row and column, in this order of significance.
    pixel: u32,
    inverse_depth: f32,
    normal: Vec3,
    color: Vec3,
    area: f32,
    image: u8,
}

/// A row of a face: each pixel that has samples with their number, and the depth pixels of all.
type Row = (Vec<(u32, u32)>, Vec<DepthPixel>);

/// A depth pixel in the making.
struct Layer {
    inverse_depth: f32,
    normal: Vec3,
    color: Vec3,
    count: f32,
    area: f32,
    image: u8,
}

impl CubeJob<'_> {
    /// Traces batches `0..count`, which `fill` makes, and packs what they meet.
    pub(super) fn run(&self, count: u32, fill: impl Fn(u32, &mut Batch) + Sync) -> Result<PackedCube, PackError> {
        let batches = (0..count).into_par_iter().map_init(Batch::default, |batch, i| {
            batch.rays.clear();
            fill(i, batch);
            self.trace(batch)
        });
        let (samples, misses): (Vec<_>, Vec<_>) = batches.unzip();
        let mut reached = vec![false; 6 * (ENVIRONMENT_PX as usize).pow(2)];
        let missed = misses.iter().any(|misses| !misses.is_empty());
        misses.into_iter().flatten().for_each(|texel: u32| reached[texel as usize] = true);
        let environment = match missed {
            true => Environment::of_sky(ENVIRONMENT_PX, self.house.lighting(), |texel| reached[texel]),
            false => Environment::default(),
        };
        let samples: Vec<Sample> = samples.concat();
        let mut cube = self.merge(&samples, environment);
        if self.mends {
            let mender = Mender { house: self.house, centre: self.centre, tolerance: self.tolerance() };
            mender.mend(&mut cube.faces);
        }
        PackedCube::pack(&cube, SplatIndexLayout::Normal, Split::Auto)
    }

    /// The samples of a batch, and the environment's texels that its misses reach.
    fn trace(&self, batch: &Batch) -> (Vec<Sample>, Vec<u32>) {
        let tracer = self.house.tracer();
        let from_centre = (tracer.origin() - self.centre).as_vec3();
        let most = self.tolerance() / 2.0;
        let (mut samples, mut misses) = (Vec::with_capacity(batch.rays.len()), Vec::new());
        for rays in batch.rays.chunks(PACKET) {
            let ray = |&(origin, direction): &(Vec3, Vec3)| Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let rays: Vec<Ray> = rays.iter().map(ray).collect();
            let hits: HitPacket = tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, ray) in rays.iter().enumerate() {
                let Some(hit) = hits.hit(lane) else {
                    let (face, [right, up, depth]) = Face::locate(ray.direction);
                    misses.push(texel(face, right / depth, up / depth, ENVIRONMENT_PX));
                    continue;
                };
                let position = ray.origin + ray.direction * hit.t;
                let (face, [right, up, depth]) = Face::locate(position + from_centre);
                if depth <= 0.0 {
                    continue;
                }
                let (color, normal) = self.house.surface(ray, &hit);
                let seen_from = position - batch.eye.unwrap_or(ray.origin);
                // Z^3 / |n . p|: the area of a pixel's patch, up to the image's focal length (C10).
                let area = seen_from.abs().max_element().powi(3) / normal.dot(seen_from).abs().max(1e-6);
                let pixel = texel(face, right / depth, up / depth, self.face_px);
                let mut inverse_depth = 1.0 / depth;
                if batch.eye.is_none() {
                    let [x, y] = middle(pixel, self.face_px);
                    let shift = slope(face, normal, position + from_centre, [x - right / depth, y - up / depth]);
                    // Far away half of what is similar can be more than all there is.
                    let most = most.min(inverse_depth / 2.0);
                    // `max` and `min` also turn the NaN of a plane through the centre into a number.
                    inverse_depth += shift.max(-most).min(most);
                }
                samples.push(Sample { pixel, inverse_depth, normal, color, area, image: batch.image });
            }
        }
        (samples, misses)
    }

    /// The difference of inverse depths that counts as similar, 1/m.
    fn tolerance(&self) -> f32 {
        DepthBins::new(HALF_SIZE_M, self.face_px).inverse_depth(1.0) as f32
    }

    /// The cube of samples in the order of their rays.
    fn merge(&self, samples: &[Sample], environment: Environment) -> CubeLdi {
        let tolerance = self.tolerance();
        // Pixel by pixel, those of a pixel in the order of their rays: their numbers are sorted, which are smaller than they.
        let mut order: Vec<(u32, u32)> =
            samples.par_iter().enumerate().map(|(i, sample)| (sample.pixel, i as u32)).collect();
        order.par_sort_unstable_by_key(|&(pixel, i)| u64::from(pixel) << 32 | u64::from(i));
        let rows: Vec<Row> = order
            .par_chunk_by(|a, b| a.0 / self.face_px == b.0 / self.face_px)
            .map(|row| {
                let (mut counts, mut merged, mut layers) = (Vec::new(), Vec::new(), Vec::new());
                for pixel in row.chunk_by(|a, b| a.0 == b.0) {
                    layers.clear();
                    let samples = pixel.iter().map(|&(_, i)| &samples[i as usize]);
                    samples.for_each(|sample| insert(&mut layers, sample, self.rule, tolerance));
                    layers.sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
                    merged.extend(layers.iter().map(Layer::finish));
                    counts.push((pixel[0].0, layers.len() as u32));
                }
                (counts, merged)
            })
            .collect();
        let mut faces = Face::ALL.map(|face| LayeredDepthImage::empty(face, self.face_px));
        let per_face = self.face_px.pow(2);
        for (counts, merged) in rows {
            let Some(&(first, _)) = counts.first() else { continue };
            let face = &mut faces[(first / per_face) as usize % 6];
            counts.iter().for_each(|&(pixel, count)| face.offsets[(pixel % per_face) as usize + 1] = count);
            face.samples.extend(merged);
        }
        for face in &mut faces {
            let mut total = 0;
            for offset in &mut face.offsets {
                total += *offset;
                *offset = total;
            }
        }
        // No strata: what was gathered says where its rays came from.
        let parameters = CaptureParameters { merge_rule: self.rule, ..CaptureParameters::unlit(0, 0) };
        let info = CaptureInfo {
            scene: self.house.scene().name.clone(),
            centre: self.centre,
            half_size_m: HALF_SIZE_M,
            frame: self.house.scene().frame,
            exposure: self.house.lighting().exposure,
            parameters,
            rays_traced: samples.len() as u64,
            ..CaptureInfo::default()
        };
        CubeLdi { info, faces: faces.into(), environment }
    }
}

/// Number of a texel: face, row, column; `right` and `up` in -1..1.
fn texel(face: Face, right: f32, up: f32, size_px: u32) -> u32 {
    let half = size_px as f32 / 2.0;
    let at = |c: f32| ((half * (1.0 + c)) as u32).min(size_px - 1);
    (face.index() as u32 * size_px + at(-up)) * size_px + at(right)
}

/// The middle of a texel: right and up, in -1..1.
fn middle(texel: u32, size_px: u32) -> [f32; 2] {
    let at = |i: u32| (2 * (i % size_px) + 1) as f32 / size_px as f32 - 1.0;
    [at(texel), -at(texel / size_px)]
}

/// What a step to the right and up on a face changes the inverse depth by of a plane with some normal through a point
/// (relative to the cube's centre), 1/m. Infinite or NaN for a plane through the centre.
fn slope(face: Face, normal: Vec3, point: Vec3, [right, up]: [f32; 2]) -> f32 {
    let step = face.right().as_vec3() * right + face.up().as_vec3() * up;
    normal.dot(step) / normal.dot(point)
}

/// Colours closer than this in every channel (sRGB levels) count as equal for [`MergeRule::ColorsApart`].
const SAME_COLOR_LEVELS: u8 = 16;

/// Adds a sample to the layers of its pixel. Samples come image by image, the central one first.
fn insert(layers: &mut Vec<Layer>, sample: &Sample, rule: MergeRule, tolerance: f32) {
    let apart = |layer: &Layer| (layer.inverse_depth - sample.inverse_depth).abs();
    let nearest = layers.iter_mut().min_by(|a, b| apart(a).total_cmp(&apart(b)));
    let Some(layer) = nearest.filter(|layer| apart(layer) <= tolerance) else {
        layers.push(Layer::new(sample));
        return;
    };
    match rule {
        MergeRule::Average => {
            let total = layer.count + 1.0;
            let share = 1.0 / total;
            layer.inverse_depth += (sample.inverse_depth - layer.inverse_depth) * share;
            layer.color += (sample.color - layer.color) * share;
            layer.count = total;
        }
        // Samples of one image are all kept: a surface nearly parallel to the pixel's ray. Those of the central image are
        // never displaced.
        MergeRule::SmallerArea if layer.image == sample.image => layers.push(Layer::new(sample)),
        MergeRule::SmallerArea if layer.image != 0 && sample.area < layer.area => *layer = Layer::new(sample),
        MergeRule::SmallerArea => {}
        MergeRule::ColorsApart => {
            let level = |color: Vec3| color.to_array().map(srgb8_from_linear);
            let (a, b) = (level(layer.color), level(sample.color));
            if (0..3).any(|c| a[c].abs_diff(b[c]) >= SAME_COLOR_LEVELS) {
                layers.push(Layer::new(sample));
            }
        }
    }
}

impl Layer {
    fn new(sample: &Sample) -> Self {
        let &Sample { inverse_depth, normal, color, area, image, .. } = sample;
        Self { inverse_depth, normal, color, count: 1.0, area, image }
    }

    fn finish(&self) -> DepthPixel {
        let [r, g, b] = self.color.to_array().map(srgb8_from_linear);
        DepthPixel {
            inverse_depth: self.inverse_depth,
            normal: EncodedNormal::new(self.normal),
            color_srgb: [r, g, b, 255],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(image: u8, inverse_depth: f32, grey: f32, area: f32) -> Sample {
        Sample { pixel: 0, inverse_depth, normal: Vec3::Z, color: Vec3::splat(grey), area, image }
    }

    fn merged(rule: MergeRule, samples: &[Sample]) -> Vec<(f32, f32)> {
        let mut layers = Vec::new();
        samples.iter().for_each(|sample| insert(&mut layers, sample, rule, 0.01));
        layers.iter().map(|layer| (layer.inverse_depth, layer.color.x)).collect()
    }

    #[test]
    fn a_hit_counts_with_the_depth_of_its_plane_in_the_middle_of_its_pixel() {
        let (normal, point) = (Vec3::new(0.6, 0.64, 0.48), Vec3::new(0.7, -1.1, 3.0));
        let (face, [right, up, depth]) = Face::locate(point);
        let pixel = texel(face, right / depth, up / depth, 8);
        let [x, y] = middle(pixel, 8);
        assert_eq!(texel(face, x, y, 8), pixel);
        assert!((x - right / depth).abs() <= 0.125 && (y - up / depth).abs() <= 0.125, "in one pixel");
        let (column, row) = (f64::from(pixel % 8) + 0.5, f64::from(pixel / 8 % 8) + 0.5);
        let direction = face.direction(column, row, 8).as_vec3();
        let expected = normal.dot(direction) / normal.dot(point);
        let found = 1.0 / depth + slope(face, normal, point, [x - right / depth, y - up / depth]);
        assert!(
            (found - expected).abs() < 1e-6 && (found - 1.0 / depth).abs() > 1e-3,
            "{found} {expected}: rounding of f32"
        );
    }

    #[test]
    fn the_conflict_rules_of_three_papers() {
        let near_and_far = [sample(0, 0.5, 0.1, 1.0), sample(1, 0.2, 0.2, 1.0)];
        for rule in [MergeRule::Average, MergeRule::SmallerArea, MergeRule::ColorsApart] {
            assert_eq!(merged(rule, &near_and_far), [(0.5, 0.1), (0.2, 0.2)], "{rule:?}: different depths never meet");
        }
        let (pinned, better, same) = (sample(0, 0.5, 0.1, 3.0), sample(1, 0.504, 0.3, 1.0), sample(1, 0.502, 0.3, 2.0));
        assert_eq!(merged(MergeRule::SmallerArea, &[pinned, better]), [(0.5, 0.1)], "the central image stays");
        assert_eq!(merged(MergeRule::SmallerArea, &[same, sample(2, 0.5, 0.4, 1.0)]), [(0.5, 0.4)], "smaller area");
        assert_eq!(merged(MergeRule::SmallerArea, &[same, sample(2, 0.5, 0.4, 9.0)]), [(0.502, 0.3)]);
        assert_eq!(merged(MergeRule::SmallerArea, &[same, better]).len(), 2, "two of one image are both kept");
        assert_eq!(merged(MergeRule::ColorsApart, &[pinned, better]).len(), 2);
        assert_eq!(merged(MergeRule::ColorsApart, &[better, same]), [(0.504, 0.3)]);
        let [(q, grey)] = merged(MergeRule::Average, &[pinned, better])[..] else { panic!("one layer") };
        assert!((q - 0.502).abs() < 1e-6 && (grey - 0.2).abs() < 1e-6);
    }
}
