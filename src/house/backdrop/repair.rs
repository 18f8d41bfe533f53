//! Repair of gaps in the surfaces of a portal-window LDI: rays aimed at pixels where a sample is
//! certainly missing.
//!
//! Few of the random rays through an opening reach surfaces at grazing angles, or behind a second
//! door, and farther surfaces show through their gaps. If two neighbours of a pixel lie on one
//! plane and the pixel itself has no sample of it, one ray from the centre tests for the surface at
//! that depth only (as [`headbox_ldi::surfaces::repair`] does for cube LDIs). The centre may be in
//! front of the opening, or have no line of sight to the surface: what lies between two samples
//! that are visible through the opening is visible too, or occluded by them. Measurements:
//! docs/decisions/0022.

use crate::house::House;
use glam::{DVec3, Vec3};
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_trace::bvh::Ray;
use rayon::prelude::*;

/// Number of passes over all faces: repaired pixels count as neighbours, so that wider gaps close
/// from their ends.
const PASSES: usize = 3;

/// Smallest cosine between normals of one surface: about 18 degrees.
const MIN_COSINE: f32 = 0.95;

/// Inputs of the repair.
pub(super) struct BackdropRepair<'a> {
    pub(super) house: &'a House,
    /// Centre of the cube, world metres.
    pub(super) centre: DVec3,
    /// Largest difference of similar inverse depths, 1/m.
    pub(super) tolerance: f32,
}

impl BackdropRepair<'_> {
    /// Adds the missing samples to a cube's faces.
    pub(super) fn run(&self, faces: &mut [LayeredDepthImage]) {
        for _ in 0..PASSES {
            for face in &mut *faces {
                let rows = (0..face.size_px)
                    .into_par_iter()
                    .map(|y| self.missing_in_row(face, y));
                let found: Vec<(u32, DepthPixel)> = rows.flatten_iter().collect();
                insert(face, &found);
            }
        }
    }

    /// Returns the missing samples of row `y` with the indices of their pixels in the face, in
    /// order.
    fn missing_in_row(&self, face: &LayeredDepthImage, y: u32) -> Vec<(u32, DepthPixel)> {
        let last = face.size_px - 1;
        let mut found: Vec<(u32, DepthPixel)> = Vec::new();
        for x in 0..face.size_px {
            let (here, first) = (face.pixel(x, y), found.len());
            let across = (x > 0 && x < last).then(|| [[x - 1, y], [x + 1, y]]);
            let down = (y > 0 && y < last).then(|| [[x, y - 1], [x, y + 1]]);
            for [before, after] in across.into_iter().chain(down) {
                let after = face.pixel(after[0], after[1]);
                if after.is_empty() {
                    continue;
                }
                for sample in face.pixel(before[0], before[1]) {
                    let plane = SamplePlane::new(face, before, sample);
                    let [expected, beyond] =
                        [1.0, 2.0].map(|steps| plane.extrapolate(steps, [x, y]));
                    let similar = |q: f32, other: &DepthPixel| {
                        (q - other.inverse_depth).abs() <= self.tolerance
                    };
                    let continues = after.iter().any(|b| {
                        similar(beyond, b) && plane.normal.dot(b.normal.decode()) >= MIN_COSINE
                    });
                    let mut known = here
                        .iter()
                        .chain(found[first..].iter().map(|(_, sample)| sample));
                    if continues
                        && !known.any(|known| similar(expected, known))
                        && let Some(sample) = self.find_sample(face, [x, y], expected, plane.normal)
                    {
                        found.push((y * face.size_px + x, sample));
                    }
                }
            }
        }
        found
    }

    /// Traces a ray through the centre of a pixel to a surface with a given inverse depth and
    /// normal.
    fn find_sample(
        &self,
        face: &LayeredDepthImage,
        [x, y]: [u32; 2],
        inverse_depth: f32,
        normal: Vec3,
    ) -> Option<DepthPixel> {
        let tracer = self.house.tracer();
        // The direction has eye depth 1, so that `t` is an eye depth.
        let direction = face
            .face
            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face.size_px)
            .as_vec3();
        if !(inverse_depth > 0.0 && inverse_depth.is_finite()) {
            return None;
        }
        let reach = self.tolerance / 2.0;
        let ray = Ray {
            origin: (self.centre - tracer.origin()).as_vec3(),
            direction,
            t_min: 1.0 / (inverse_depth + reach),
            t_max: if inverse_depth > reach {
                1.0 / (inverse_depth - reach)
            } else {
                f32::INFINITY
            },
        };
        let hit = tracer.closest(&ray)?;
        let (color, hit_normal) = self.house.surface(&ray, &hit);
        let cosine = hit_normal.dot(normal);
        let [r, g, b] = self.house.lighting().tone.levels(color);
        // The ray may hit its other side.
        (cosine.abs() >= MIN_COSINE).then(|| DepthPixel {
            inverse_depth: 1.0 / hit.t,
            normal: EncodedNormal::new(hit_normal * cosine.signum()),
            color_srgb: [r, g, b, 255],
        })
    }
}

/// Plane of a sample.
struct SamplePlane<'a> {
    face: &'a LayeredDepthImage,
    pixel: [u32; 2],
    inverse_depth: f32,
    normal: Vec3,
}

impl<'a> SamplePlane<'a> {
    fn new(face: &'a LayeredDepthImage, pixel: [u32; 2], sample: &DepthPixel) -> Self {
        Self {
            face,
            pixel,
            inverse_depth: sample.inverse_depth,
            normal: sample.normal.decode(),
        }
    }

    /// Extrapolates the inverse depth, which is linear on a face, by `steps` times the step to
    /// another pixel. Infinite or NaN for a plane through the centre.
    fn extrapolate(&self, steps: f32, [x, y]: [u32; 2]) -> f32 {
        let direction = |[x, y]: [u32; 2]| {
            self.face
                .face
                .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, self.face.size_px)
        };
        let here = direction(self.pixel);
        let step = (direction([x, y]) - here).as_vec3();
        self.inverse_depth * (1.0 + steps * self.normal.dot(step) / self.normal.dot(here.as_vec3()))
    }
}

/// Inserts samples, given in the order of their pixels.
fn insert(face: &mut LayeredDepthImage, found: &[(u32, DepthPixel)]) {
    if found.is_empty() {
        return;
    }
    let mut samples = Vec::with_capacity(face.samples.len() + found.len());
    let mut rest = found;
    for pixel in 0..face.offsets.len() - 1 {
        let start = samples.len();
        samples.extend_from_slice(
            &face.samples[face.offsets[pixel] as usize..face.offsets[pixel + 1] as usize],
        );
        let (new, others) = rest.split_at(rest.partition_point(|(of, _)| *of as usize <= pixel));
        samples.extend(new.iter().map(|(_, sample)| *sample));
        samples[start..].sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
        (face.offsets[pixel], rest) = (start as u32, others);
    }
    if let Some(end) = face.offsets.last_mut() {
        *end = samples.len() as u32;
    }
    face.samples = samples;
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::cube_face::Face;

    const SIZE_PX: u32 = 48;

    /// The nearest surfaces of a house from a place.
    fn seen(house: &House, centre: DVec3, face: Face) -> LayeredDepthImage {
        let mut image = LayeredDepthImage::empty(face, SIZE_PX);
        let origin = (centre - house.tracer().origin()).as_vec3();
        for pixel in 0..SIZE_PX * SIZE_PX {
            let [x, y] = [pixel % SIZE_PX, pixel / SIZE_PX].map(|c| f64::from(c) + 0.5);
            let ray = Ray {
                origin,
                direction: face.direction(x, y, SIZE_PX).as_vec3(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            if let Some(hit) = house.tracer().closest(&ray) {
                let (color, normal) = house.surface(&ray, &hit);
                let [r, g, b] = house.lighting().tone.levels(color);
                let normal = EncodedNormal::new(normal);
                image.samples.push(DepthPixel {
                    inverse_depth: 1.0 / hit.t,
                    normal,
                    color_srgb: [r, g, b, 255],
                });
            }
            image.offsets[pixel as usize + 1] = image.samples.len() as u32;
        }
        image
    }

    #[test]
    fn repair_fills_gaps_between_neighbours_only() {
        let house = House::new(headbox_scenes::house(0, 5_000)).expect("a built-in scene");
        let (mut removed, mut restored, mut beside) = (0, 0, 0);
        for centre in (0..4).filter_map(|cell| house.cell_centre(cell)) {
            let repair = BackdropRepair {
                house: &house,
                centre,
                tolerance: 0.01,
            };
            for face in Face::ALL {
                let whole = seen(&house, centre, face);
                // A fifth of the pixels, scattered.
                let is_kept = |pixel: u32| !(pixel * 7 + pixel / SIZE_PX * 3).is_multiple_of(5);
                let mut holed = LayeredDepthImage::empty(face, SIZE_PX);
                for pixel in 0..SIZE_PX * SIZE_PX {
                    let there = whole.pixel(pixel % SIZE_PX, pixel / SIZE_PX);
                    holed
                        .samples
                        .extend(there.iter().filter(|_| is_kept(pixel)));
                    holed.offsets[pixel as usize + 1] = holed.samples.len() as u32;
                }
                let mut mended = [holed];
                repair.run(&mut mended);
                for pixel in 0..SIZE_PX * SIZE_PX {
                    let (x, y) = (pixel % SIZE_PX, pixel / SIZE_PX);
                    let Some(truth) = whole.pixel(x, y).first() else {
                        continue;
                    };
                    removed += u32::from(!is_kept(pixel));
                    for sample in mended[0].pixel(x, y) {
                        let is_truth = (sample.inverse_depth - truth.inverse_depth).abs() < 1e-5;
                        restored += u32::from(
                            is_truth && !is_kept(pixel) && sample.color_srgb == truth.color_srgb,
                        );
                        // Else it is what goes on behind a thing that both neighbours pass by.
                        assert!(
                            is_truth || sample.inverse_depth < truth.inverse_depth,
                            "{sample:?} {truth:?}"
                        );
                        beside += u32::from(!is_truth);
                    }
                }
            }
        }
        assert!(
            removed > 5000 && restored * 10 > removed * 8,
            "{restored} of {removed}"
        );
        assert!(beside * 20 < removed, "{beside} of {removed}");
    }
}
