//! Gaps in the surfaces of a window's LDI, mended: rays that are aimed where a sample is missing
//! for certain.
//!
//! Few of the random rays through an opening go to what shows only at a grazing angle, or through a
//! second door behind it, and what is farther speckles what they leave out. Where the two
//! neighbours of a pixel lie on one plane and the pixel itself has nothing of it, one ray from the
//! centre that looks for it there, and only there, decides (as [`headbox_ldi::surfaces::repair`]
//! does for cube LDIs). The centre may be in front of the opening, or not see the surface at all:
//! what lies between two samples that show through the opening shows through it too, or hides
//! behind them. What that brings: docs/decisions/0022.

use crate::house::House;
use glam::{DVec3, Vec3};
use headbox_core::color::srgb8_from_linear;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_trace::bvh::Ray;
use rayon::prelude::*;

/// Number of passes over all faces: repaired pixels count as neighbours, so that wider gaps close
/// from their ends.
const PASSES: usize = 3;

/// Normals of one surface are no farther apart than this cosine: about 18 degrees.
const ALIKE: f32 = 0.95;

/// Context of the repair beside the faces.
pub(super) struct BackdropMender<'a> {
    pub(super) house: &'a House,
    /// Centre of the cube, world metres.
    pub(super) centre: DVec3,
    /// The difference of inverse depths that counts as similar, 1/m.
    pub(super) tolerance: f32,
}

impl BackdropMender<'_> {
    /// Adds what is missing to a cube's faces.
    pub(super) fn mend(&self, faces: &mut [LayeredDepthImage]) {
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

    /// The missing samples of row `y` with the numbers of their pixels in the face, in order.
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
                    let plane = Plane::of(face, before, sample);
                    let [expected, beyond] = [1.0, 2.0].map(|steps| plane.after(steps, [x, y]));
                    let similar = |q: f32, other: &DepthPixel| {
                        (q - other.inverse_depth).abs() <= self.tolerance
                    };
                    let goes_on = after.iter().any(|b| {
                        similar(beyond, b) && plane.normal.dot(b.normal.decode()) >= ALIKE
                    });
                    let mut known = here
                        .iter()
                        .chain(found[first..].iter().map(|(_, sample)| sample));
                    if goes_on
                        && !known.any(|known| similar(expected, known))
                        && let Some(sample) = self.look_for(face, [x, y], expected, plane.normal)
                    {
                        found.push((y * face.size_px + x, sample));
                    }
                }
            }
        }
        found
    }

    /// The surface of an inverse depth and a normal in the middle of a pixel.
    fn look_for(
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
        let reach = self.tolerance / 2.0;
        if !(inverse_depth > 0.0 && inverse_depth.is_finite()) {
            return None;
        }
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
        let (color, found) = self.house.surface(&ray, &hit);
        let cosine = found.dot(normal);
        let [r, g, b] = color.to_array().map(srgb8_from_linear);
        // The ray may meet its other side.
        (cosine.abs() >= ALIKE).then(|| DepthPixel {
            inverse_depth: 1.0 / hit.t,
            normal: EncodedNormal::new(found * cosine.signum()),
            color_srgb: [r, g, b, 255],
        })
    }
}

/// The plane of a sample.
struct Plane<'a> {
    face: &'a LayeredDepthImage,
    pixel: [u32; 2],
    inverse_depth: f32,
    normal: Vec3,
}

impl<'a> Plane<'a> {
    fn of(face: &'a LayeredDepthImage, pixel: [u32; 2], sample: &DepthPixel) -> Self {
        Self {
            face,
            pixel,
            inverse_depth: sample.inverse_depth,
            normal: sample.normal.decode(),
        }
    }

    /// Its inverse depth so many times as far from its pixel as another pixel is, which is linear
    /// on a face. Infinite or NaN for a plane through the centre.
    fn after(&self, steps: f32, [x, y]: [u32; 2]) -> f32 {
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

/// Puts samples, in the order of their pixels, into their places.
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
                let [r, g, b] = color.to_array().map(srgb8_from_linear);
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
        for centre in (0..4).filter_map(|cell| house.middle_of(cell)) {
            let mender = BackdropMender {
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
                mender.mend(&mut mended);
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
