//! Photograph whose colours candidates are compared with, and its pixels claimed by kept
//! candidates.

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};
use glam::{DMat3, DVec3, Vec3};
use headbox_core::cube_face::Face;
use headbox_core::image::texels::{blend_quads, gather_quads, locate};
use headbox_images::{Lens, LoadedView};

/// Photograph with its camera relative to a cube's centre.
pub(super) struct Photograph {
    width: usize,
    height: usize,
    /// sRGB; the fourth channel is [`EXCLUDED`] where the view is masked out or a kept candidate
    /// has claimed the pixel, [`BACKDROP`] for background, else 255.
    color: Vec<[u8; 4]>,
    /// True if any pixel shows background.
    pub(super) has_backdrop: bool,
    /// Projection matrix by rows: x w, y w, and w (eye depth) of a point relative to the eye.
    rows: DMat3,
    /// Eye relative to the centre, metres.
    pub(super) eye: DVec3,
    /// Pixels per radian.
    focal_px: f64,
}

/// Marks pixels that are ignored.
const EXCLUDED: u8 = 0;

/// Marks pixels that show background.
const BACKDROP: u8 = 1;

/// Projection of a pixel (x, y, 1) of a face at eye depth 1 to x w, y w, w in a photograph; `start`
/// is added once, independent of the depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    start: Vec3,
    across: Vec3,
    down: Vec3,
    corner: Vec3,
}

impl Projection {
    /// Returns, at an eye depth, the homogeneous position (x w, y w, w) of the first pixel's
    /// centre, and its change per pixel right and down.
    pub(super) fn at(&self, depth: f32) -> [Vec3; 3] {
        [
            self.start + self.corner * depth,
            self.across * depth,
            self.down * depth,
        ]
    }
}

impl Photograph {
    /// Bytes of memory per pixel of a view.
    pub(super) const BYTES_PER_PIXEL: u64 = 4;

    /// Prepares a loaded view; `None` for a panorama, and for an image of a single row or column.
    pub(super) fn new(view: LoadedView, centre: DVec3, dark: Option<u8>) -> Option<Self> {
        let Lens::Pinhole(pinhole) = view.lens else {
            return None;
        };
        let [width, height] = view.size_px.map(|side| side as usize);
        if width < 2 || height < 2 {
            return None;
        }
        let mut color = view.color;
        if let Some(dark) = dark {
            mark_backdrop(&mut color, width, dark);
        }
        let [right, up, back] = view.pose.world_from_eye.to_cols_array_2d().map(DVec3::from);
        let [fx, fy] = pinhole.focal_px;
        let [cx, cy] = pinhole.principal_px;
        let rows =
            DMat3::from_cols(right * fx - back * cx, -up * fy - back * cy, -back).transpose();
        Some(Self {
            width,
            height,
            has_backdrop: color.iter().any(|pixel| pixel[3] == BACKDROP),
            color,
            rows,
            eye: view.pose.eye - centre,
            focal_px: view.lens.pixels_per_radian(view.size_px),
        })
    }

    /// Returns true if the eye is inside the shell at an eye depth of the faces.
    pub(super) fn is_inside(&self, depth: f64) -> bool {
        self.eye.abs().max_element() < depth
    }

    /// Returns the size in pixels of a metre across the line of sight at a point relative to the
    /// centre.
    pub(super) fn pixels_per_metre(&self, point: DVec3) -> f64 {
        self.focal_px / self.eye.distance(point)
    }

    /// Projects a point relative to the centre; `None` outside the image.
    pub(super) fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        let h = self.rows * (point - self.eye);
        let [x, y] = [h.x / h.z, h.y / h.z];
        let inside =
            h.z > 0.0 && x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then_some([x, y])
    }

    /// Intersects the rays of `side` by `side` pixels, border to border, with the shell at an eye
    /// depth of the faces; positions relative to the centre. The eye is inside of the shell.
    pub(super) fn points_on_shell(&self, depth: f64, side: usize) -> impl Iterator<Item = DVec3> {
        let unproject = self.rows.inverse();
        let at =
            move |i: usize, pixels: usize| 0.5 + (pixels - 1) as f64 * i as f64 / (side - 1) as f64;
        (0..side * side).map(move |i| {
            let ray =
                unproject * DVec3::new(at(i % side, self.width), at(i / side, self.height), 1.0);
            let walls = (ray.signum() * depth - self.eye) / ray;
            self.eye + ray * walls.min_element()
        })
    }

    /// Returns the projection of a face's pixels.
    pub(super) fn projection(&self, face: Face, face_px: u32) -> Projection {
        let step = 2.0 / f64::from(face_px);
        let corner =
            face.normal() - face.right() + face.up() + (face.right() - face.up()) * (step / 2.0);
        let project = |vector: DVec3| (self.rows * vector).as_vec3();
        Projection {
            start: project(-self.eye),
            across: project(face.right() * step),
            down: project(-face.up() * step),
            corner: project(corner),
        }
    }

    /// Width and height, pixels.
    pub(super) fn size(&self) -> [f32; 2] {
        [self.width as f32, self.height as f32]
    }

    /// Returns a mask of the positions that show background; arbitrary for positions outside of the
    /// image.
    #[inline(always)]
    pub(super) fn shows_backdrop<S: Simd>(&self, [x, y]: [f32x16<S>; 2]) -> mask32x16<S> {
        let last = [self.width as u32 - 1, self.height as u32 - 1];
        let column = u32x16::truncate_from(x.max(0.0)).min(last[0]);
        let row = u32x16::truncate_from(y.max(0.0)).min(last[1]);
        let mut marks = (row * self.width as u32 + column).to_array();
        for mark in &mut marks {
            *mark = self
                .color
                .get(*mark as usize)
                .map_or(0, |pixel| u32::from(pixel[3]));
        }
        u32x16::load_array(x.token(), marks).simd_eq(u32::from(BACKDROP))
    }

    /// Samples the colours at sixteen positions inside of the image, sRGB levels in bytes of a
    /// word; the mask is set where the pixel is not excluded.
    #[inline(always)]
    pub(super) fn colors<S: Simd>(
        &self,
        simd: S,
        [x, y]: [f32x16<S>; 2],
    ) -> (u32x16<S>, mask32x16<S>) {
        let (left, across) = locate(x - 0.5, self.width as u32);
        let (top, down) = locate(y - 0.5, self.height as u32);
        let Some(four) = gather_quads(
            simd,
            &self.color,
            top * self.width as u32 + left,
            self.width,
        ) else {
            return (left, x.simd_lt(f32::NEG_INFINITY)); // never: there are two rows and columns
        };
        let [right, below] = [across.simd_ge(128), down.simd_ge(128)];
        let nearest = below.select(
            right.select(four[3], four[2]),
            right.select(four[1], four[0]),
        );
        (
            blend_quads(four, [across, down]),
            (nearest >> 24).simd_eq(255),
        )
    }

    /// Claims the pixels with centres within `reach` of a position on either side; at least the one
    /// that contains it.
    pub(super) fn claim(&mut self, x: f32, y: f32, reach: f32) {
        let range = |at: f32, side: usize| {
            let own = at as i64;
            let first = ((at - reach - 0.5).ceil() as i64)
                .min(own)
                .clamp(0, side as i64);
            let last = ((at + reach - 0.5).floor() as i64)
                .max(own)
                .clamp(-1, side as i64 - 1);
            first as usize..(last + 1) as usize
        };
        for row in range(y, self.height) {
            for column in range(x, self.width) {
                let mark = &mut self.color[row * self.width + column][3];
                if *mark != BACKDROP {
                    *mark = EXCLUDED;
                }
            }
        }
    }
}

/// Marks the pixels that show a background of levels up to `dark`. Those adjacent to other pixels
/// are excluded: calibrations err by about a pixel.
fn mark_backdrop(color: &mut [[u8; 4]], width: usize, dark: u8) {
    let shows =
        |pixel: &[u8; 4]| pixel[3] != EXCLUDED && pixel[..3].iter().all(|level| *level <= dark);
    let dark: Vec<bool> = color.iter().map(shows).collect();
    let height = dark.len() / width;
    for (i, pixel) in color.iter_mut().enumerate().filter(|(i, _)| dark[*i]) {
        let (x, y) = (i % width, i / width);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let mut around =
            rows.map(|row| &dark[row * width + columns.start..row * width + columns.end]);
        pixel[3] = if around.all(|row| row.iter().all(|dark| *dark)) {
            BACKDROP
        } else {
            EXCLUDED
        };
    }
}
