//! Portal textures: the view through a portal from an eye in front of it, as a texture on the
//! portal's plane (R2).

use super::BackdropQuality;
use crate::house::House;
use crate::portal_opening::Opening;
use glam::{DVec2, DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::image::texels;
use headbox_trace::bvh::Ray;
use rayon::prelude::*;

/// Number of rays along each side of a texel.
const RAYS_PER_SIDE: u32 = 2;

/// Textures of one opening from one or more eye positions.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureSet {
    /// Opening whose bounding rectangle the textures cover.
    pub(crate) opening: Opening,
    /// Columns and rows of each texture.
    pub(crate) size: [u32; 2],
    /// Eye position of each texture, world metres.
    pub(crate) places: Vec<DVec3>,
    /// Texels, sRGB, row 0 on top, one texture after the other.
    pub(crate) texels: Vec<[u8; 4]>,
}

impl TextureSet {
    pub(super) fn capture(
        house: &House,
        opening: &Opening,
        places: &[DVec3],
        quality: &BackdropQuality,
    ) -> Self {
        let scale = f64::from(quality.texture_px) / opening.half.max_element();
        let size =
            [opening.half.x, opening.half.y].map(|half| ((half * scale).round() as u32).max(1));
        let origin = house.tracer().origin();
        let row = |i: u32| -> Vec<[u8; 4]> {
            let (place, y) = (places[(i / size[1]) as usize], i % size[1]);
            (0..size[0])
                .map(|x| trace_texel(house, opening, origin, place, [x, y], size))
                .collect()
        };
        let rows: Vec<_> = (0..places.len() as u32 * size[1])
            .into_par_iter()
            .map(row)
            .collect();
        Self {
            opening: opening.clone(),
            size,
            places: places.to_vec(),
            texels: rows.concat(),
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        4 * self.texels.len() as u64
    }

    /// Returns the index of the texture whose eye position is nearest in direction to the eye, as
    /// seen from the portal's middle.
    fn nearest(&self, eye: DVec3) -> usize {
        let toward = (eye - self.opening.centre).normalize_or_zero();
        let cosine = |place: &DVec3| {
            (*place - self.opening.centre)
                .normalize_or_zero()
                .dot(toward)
        };
        let places = &self.places;
        (0..places.len())
            .max_by(|&a, &b| cosine(&places[a]).total_cmp(&cosine(&places[b])))
            .unwrap_or(0)
    }

    /// Draws the texture of the nearest eye position; pixels outside the rectangle are not changed.
    pub(super) fn draw(&self, camera: &Camera, frame: &mut Frame) {
        let [width, height] = self.size.map(|pixels| pixels as usize);
        let texture = self
            .texels
            .chunks_exact(width * height)
            .nth(self.nearest(camera.eye()));
        let Some(texture) = texture else { return };
        let opening = &self.opening;
        let to_centre = opening.centre - camera.eye();
        let along = opening.normal.dot(to_centre);
        let columns = frame.width as usize;
        let rows = frame
            .color
            .par_chunks_mut(columns)
            .zip(frame.coverage.par_chunks_mut(columns));
        rows.enumerate()
            .with_min_len(8)
            .for_each(|(y, (colors, coverages))| {
                let start = camera.direction(0.5, y as f64 + 0.5);
                let step = camera.direction(1.5, y as f64 + 0.5) - start;
                // Texture coordinates are quotients of functions that are linear along the row.
                let plane = |axis: DVec3, half: f64, direction: DVec3| {
                    (axis.dot(direction) * along
                        - axis.dot(to_centre) * opening.normal.dot(direction))
                        / half
                };
                let linear = |direction: DVec3| {
                    let (u, v) = (
                        plane(opening.right, opening.half.x, direction),
                        plane(opening.up, opening.half.y, direction),
                    );
                    DVec3::new(u, -v, opening.normal.dot(direction))
                };
                let (start, step) = (linear(start), linear(step));
                for (x, (color, coverage)) in colors.iter_mut().zip(coverages).enumerate() {
                    let at = (start + step * x as f64).as_vec3();
                    // The plane faces the eye: the ray runs against its normal.
                    if at.z >= 0.0 || along >= 0.0 {
                        continue;
                    }
                    let inverse = 1.0 / at.z;
                    let (u, v) = (at.x * inverse, at.y * inverse);
                    if u.abs() <= MARGIN && v.abs() <= MARGIN {
                        let position = [
                            (u * 0.5 + 0.5) * width as f32 - 0.5,
                            (v * 0.5 + 0.5) * height as f32 - 0.5,
                        ];
                        *color = bilinear(texture, [width, height], position);
                        *coverage = Coverage::FULL;
                    }
                }
            });
    }
}

/// Bound of texture coordinates: slightly beyond 1, for the pixels on the border.
const MARGIN: f32 = 1.05;

/// Traces the rays through a texel; returns their mean.
fn trace_texel(
    house: &House,
    opening: &Opening,
    origin: DVec3,
    place: DVec3,
    [x, y]: [u32; 2],
    size: [u32; 2],
) -> [u8; 4] {
    let mut sum = Vec3::ZERO;
    for i in 0..RAYS_PER_SIDE * RAYS_PER_SIDE {
        let at = |pixel: u32, k: u32, pixels: u32| {
            (f64::from(pixel) + (f64::from(k) + 0.5) / f64::from(RAYS_PER_SIDE)) / f64::from(pixels)
                * 2.0
                - 1.0
        };
        let flat = DVec2::new(
            at(x, i % RAYS_PER_SIDE, size[0]),
            -at(y, i / RAYS_PER_SIDE, size[1]),
        );
        let point = opening.point(flat);
        let ray = Ray {
            origin: (point - origin).as_vec3(),
            direction: (point - place).as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        sum += house.radiance(&ray).0;
    }
    let mean = sum / (RAYS_PER_SIDE * RAYS_PER_SIDE) as f32;
    let [r, g, b] = house.lighting().tone.levels(mean);
    [r, g, b, 255]
}

/// Samples bilinearly in sRGB, clamped to the edge.
fn bilinear(image: &[[u8; 4]], [width, height]: [usize; 2], [x, y]: [f32; 2]) -> [u8; 4] {
    let split = |c: f32, size: usize| {
        let c = c.max(0.0).min((size - 1) as f32);
        let first = (c as usize).min(size - 1);
        (first, (first + 1).min(size - 1), c - first as f32)
    };
    let ((x0, x1, fx), (y0, y1, fy)) = (split(x, width), split(y, height));
    let at = |x: usize, y: usize| image.get(y * width + x).copied().unwrap_or([0; 4]);
    let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
    let mut mixed = [255; 4];
    for i in 0..3 {
        let levels = [a, b, c, d].map(|texel| f32::from(texel[i]));
        mixed[i] = (texels::bilinear(levels, [fx, fy]) + 0.5) as u8;
    }
    mixed
}
