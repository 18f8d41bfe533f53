//! Reference renderer for tests: f64, from the unpacked LDI, in any order, with a depth buffer and
//! each sample's exact footprint.

use crate::model::samples::{CubeSamples, DepthPixel, LayeredDepthImage};
use crate::render::setup::transfer::Transfer;
use glam::{DMat3, DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};

/// Largest tangent of the angle between a sample's normal and its ray, as in the fast renderer: a
/// surface that the LDI sees edge-on does not extend across the whole scene.
const MAX_SLOPE: f64 = 12.0;

/// Least Z2 / Z1 that is drawn, as in the fast renderer.
const W_NEAR: f64 = 1.0 / 1024.0;

/// Footprint of a sample: the LDI pixel's square on the sample's tangent plane, in the frame.
struct Patch {
    /// Homogeneous frame position of (1, dx, dy), from the principal point, where -1/2 <= dx, dy <=
    /// 1/2 are face pixels.
    frame_from_offset: DMat3,
    /// Inverse depth in the LDI, 1/m, as coefficients of (1, dx, dy).
    inverse_depth: DVec3,
}

impl Patch {
    fn new(
        transfer: &Transfer,
        face: &LayeredDepthImage,
        x: f64,
        y: f64,
        sample: &DepthPixel,
    ) -> Self {
        let q = f64::from(sample.inverse_depth);
        let slope = face.inverse_depth_slope(x, y, sample, MAX_SLOPE);
        let inverse_depth = dvec3(q, q * slope.x, q * slope.y);
        let column = |v: DVec3, q: f64| v + transfer.inverse_depth * q;
        let frame_from_offset = DMat3::from_cols(
            column(transfer.map_infinite(x, y), inverse_depth.x),
            column(transfer.x_step, inverse_depth.y),
            column(transfer.y_step, inverse_depth.z),
        );
        Self {
            frame_from_offset,
            inverse_depth,
        }
    }

    /// Returns the smallest and largest frame position, px from the principal point, or `None` if
    /// the patch is completely behind the eye.
    fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let corners = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
        let corners = corners.map(|(dx, dy)| self.frame_from_offset * dvec3(1.0, dx, dy));
        if corners.iter().all(|c| c.z < W_NEAR) {
            return None;
        }
        if corners.iter().any(|c| c.z < W_NEAR) {
            return Some([[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]]);
        }
        let positions = corners.map(|c| [c.x / c.z, c.y / c.z]);
        let extreme = |pick: fn(f64, f64) -> f64| {
            [0, 1].map(|i| positions.iter().map(|c| c[i]).reduce(pick).unwrap_or(0.0))
        };
        Some([extreme(f64::min), extreme(f64::max)])
    }

    /// Returns 1 / eye depth in the frame at (x, y) from the principal point, if the patch covers
    /// that position.
    fn inverse_depth_at(&self, offset_from_frame: &DMat3, x: f64, y: f64) -> Option<f64> {
        let solution = *offset_from_frame * dvec3(x, y, 1.0);
        let offset = solution / solution.x;
        let inside = |d: f64| d.abs() <= 0.5 + 1e-9;
        let w = (self.frame_from_offset * offset).z;
        (inside(offset.y) && inside(offset.z) && w >= W_NEAR)
            .then(|| self.inverse_depth.dot(offset) / w)
    }
}

/// Renders an LDI that [`CubeSamples::validate`] accepts, with depths; splats cover a pixel
/// completely or not at all. Slow.
pub fn render_oracle(ldi: &CubeSamples, camera: &Camera) -> Frame {
    let mut frame = Frame::default();
    frame.reset(camera.width(), camera.height(), [0; 3]);
    let mut inverse_depth = vec![0.0; frame.color.len()];
    let size = [f64::from(camera.width()), f64::from(camera.height())];
    for face in &ldi.faces {
        let transfer = Transfer::new(
            camera,
            camera.eye() - ldi.info.centre,
            face.face,
            face.size_px,
        );
        for (y, x) in (0..face.size_px).flat_map(|y| (0..face.size_px).map(move |x| (y, x))) {
            for sample in face.pixel(x, y) {
                let patch = Patch::new(
                    &transfer,
                    face,
                    f64::from(x) + 0.5,
                    f64::from(y) + 0.5,
                    sample,
                );
                let offset_from_frame = patch.frame_from_offset.inverse();
                let Some([low, high]) = patch.bounds().filter(|_| offset_from_frame.is_finite())
                else {
                    continue;
                };
                let pixels = |i: usize| {
                    let clip = |v: f64| (v + size[i] / 2.0).clamp(0.0, size[i]);
                    (clip(low[i]).floor() as usize, clip(high[i]).ceil() as usize)
                };
                let (left, right) = pixels(0);
                let (top, bottom) = pixels(1);
                for (py, px) in (top..bottom).flat_map(|py| (left..right).map(move |px| (py, px))) {
                    let x = px as f64 + 0.5 - size[0] / 2.0;
                    let y = py as f64 + 0.5 - size[1] / 2.0;
                    let index = py * frame.width as usize + px;
                    if let Some(q) = patch.inverse_depth_at(&offset_from_frame, x, y)
                        && q > inverse_depth[index]
                    {
                        let [r, g, b, _] = sample.color_srgb;
                        inverse_depth[index] = q;
                        frame.color[index] = [r, g, b, 255];
                        frame.coverage[index] = Coverage::FULL;
                    }
                }
            }
        }
    }
    for (index, (color, coverage)) in frame.color.iter_mut().zip(&mut frame.coverage).enumerate() {
        let px = index % frame.width as usize;
        let py = index / frame.width as usize;
        let direction = camera.direction(px as f64 + 0.5, py as f64 + 0.5).as_vec3();
        if let Some([r, g, b]) = ldi
            .environment
            .sample(direction)
            .filter(|_| coverage.is_hole())
        {
            *color = [r, g, b, 255];
            *coverage = Coverage::ENVIRONMENT;
        }
    }
    frame.depth_m = inverse_depth.iter().map(|q| (1.0 / q) as f32).collect();
    frame
}
