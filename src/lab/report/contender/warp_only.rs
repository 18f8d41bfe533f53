//! The warp alone, in three arithmetics (S18, C8): the gain of incremental evaluation.
//!
//! Every depth pixel becomes one frame pixel in a depth buffer: no footprints, no order, no
//! clipping, no SIMD, one thread. Only the computation of the position differs.

use super::points::NearestColors;
use super::{ContenderFrame, Draw};
use glam::{DMat4, DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_cube::pack::blocks::BLOCK_COLUMNS;
use headbox_cube::pack::{CubeLdi, PackedSegment};
use headbox_cube::render::setup::transfer::{RowTransfer, Transfer};
use std::sync::Arc;

/// Arithmetic of the warp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WarpArithmetic {
    /// Unprojection of each depth pixel, then projection by the camera's matrix, in f64.
    Direct,
    /// Running sum along the whole row, in f32, as in the paper.
    RunningSum,
    /// Multiples of a step from an anchor every [`BLOCK_COLUMNS`] columns, in f32, as in the
    /// renderer.
    Anchored,
}

/// Draws the depth pixels of a cube as single pixels.
pub struct WarpOnly {
    cube: Arc<CubeLdi>,
    arithmetic: WarpArithmetic,
    nearest: NearestColors,
}

/// Warp of the depth pixels of a row.
trait RowWarp {
    /// Starts a row at `column`.
    fn start(&mut self, column: u32, row: u32);
    /// Advances to the next column, `column`.
    fn advance(&mut self, column: u32);
    /// Returns the homogeneous frame position (x w, y w, w) of the sample with inverse depth
    /// `code`: x and y from the top left corner, px; w = Z2 / Z1.
    fn homogeneous(&self, code: u32) -> Vec3;
}

/// Common part of the incremental warps.
struct Incremental {
    transfer: Transfer,
    inverse_depth_min: f64,
    inverse_depth_step: f64,
}

impl Incremental {
    fn new(camera: &Camera, cube: &CubeLdi, segment: &PackedSegment) -> Self {
        let eye = camera.eye() - cube.info.centre;
        let mut transfer = Transfer::new(camera, eye, segment.face, cube.face_size_px);
        // The origin is the corner, as in the direct warp, not the principal point.
        let corner = DVec3::new(f64::from(camera.width()), f64::from(camera.height()), 0.0) / 2.0;
        for column in [
            &mut transfer.one,
            &mut transfer.x_step,
            &mut transfer.y_step,
            &mut transfer.inverse_depth,
        ] {
            *column += corner * column.z;
        }
        Self {
            transfer,
            inverse_depth_min: f64::from(segment.inverse_depth_min),
            inverse_depth_step: segment.inverse_depth_step(),
        }
    }

    fn anchor(&self, column: u32, row: u32) -> RowTransfer {
        self.transfer
            .anchor(column, row, self.inverse_depth_min, self.inverse_depth_step)
    }
}

struct RunningSum {
    shared: Incremental,
    at: RowTransfer,
}

impl RowWarp for RunningSum {
    fn start(&mut self, column: u32, row: u32) {
        self.at = self.shared.anchor(column, row);
    }

    #[inline]
    fn advance(&mut self, _: u32) {
        self.at.anchor += self.at.step;
    }

    #[inline]
    fn homogeneous(&self, code: u32) -> Vec3 {
        self.at.anchor + self.at.per_code * code as f32
    }
}

struct Anchored {
    shared: Incremental,
    at: RowTransfer,
    row: u32,
    here: Vec3,
}

impl RowWarp for Anchored {
    fn start(&mut self, column: u32, row: u32) {
        self.row = row;
        self.at = self.shared.anchor(column - column % BLOCK_COLUMNS, row);
        self.here = self.at.anchor + self.at.step * (column % BLOCK_COLUMNS) as f32;
    }

    #[inline]
    fn advance(&mut self, column: u32) {
        let from_anchor = column % BLOCK_COLUMNS;
        if from_anchor == 0 {
            self.at = self.shared.anchor(column, self.row);
        }
        self.here = self.at.anchor + self.at.step * from_anchor as f32;
    }

    #[inline]
    fn homogeneous(&self, code: u32) -> Vec3 {
        self.here + self.at.per_code * code as f32
    }
}

struct Direct<'a> {
    segment: &'a PackedSegment,
    face: Face,
    face_px: u32,
    image_from_centre: DMat4,
    at: [f64; 2],
}

impl RowWarp for Direct<'_> {
    fn start(&mut self, column: u32, row: u32) {
        self.at = [column, row].map(|c| f64::from(c) + 0.5);
    }

    #[inline]
    fn advance(&mut self, column: u32) {
        self.at[0] = f64::from(column) + 0.5;
    }

    #[inline]
    fn homogeneous(&self, code: u32) -> Vec3 {
        let inverse_depth = self.segment.inverse_depth(code);
        let point = self.face.direction(self.at[0], self.at[1], self.face_px) / inverse_depth;
        let h = self.image_from_centre * point.extend(1.0);
        (DVec3::new(h.x, h.y, h.w) * inverse_depth).as_vec3()
    }
}

impl WarpOnly {
    /// Draws `cube`.
    pub fn new(cube: Arc<CubeLdi>, arithmetic: WarpArithmetic) -> Self {
        Self {
            cube,
            arithmetic,
            nearest: NearestColors::default(),
        }
    }

    fn warp(&mut self, camera: &Camera) {
        self.nearest.reset(camera);
        let cube = Arc::clone(&self.cube);
        let at = RowTransfer {
            anchor: Vec3::ZERO,
            step: Vec3::ZERO,
            per_code: Vec3::ZERO,
        };
        let image_from_centre = camera
            .with_eye(camera.eye() - cube.info.centre)
            .image_from_world();
        for segment in &cube.segments {
            let shared = || Incremental::new(camera, &cube, segment);
            match self.arithmetic {
                WarpArithmetic::Direct => {
                    let warp = Direct {
                        segment,
                        face: segment.face,
                        face_px: cube.face_size_px,
                        image_from_centre,
                        at: [0.0; 2],
                    };
                    self.warp_segment(segment, warp);
                }
                WarpArithmetic::RunningSum => {
                    let shared = shared();
                    self.warp_segment(segment, RunningSum { shared, at });
                }
                WarpArithmetic::Anchored => {
                    let warp = Anchored {
                        shared: shared(),
                        at,
                        row: 0,
                        here: Vec3::ZERO,
                    };
                    self.warp_segment(segment, warp);
                }
            }
        }
    }

    fn warp_segment(&mut self, segment: &PackedSegment, mut warp: impl RowWarp) {
        let min = segment.inverse_depth_min;
        let step = segment.inverse_depth_step() as f32;
        for y in 0..segment.height {
            let (samples, counts) = segment.row(y);
            warp.start(segment.x0, segment.y0 + y);
            for (x, ends) in counts.windows(2).enumerate() {
                if x > 0 {
                    warp.advance(segment.x0 + x as u32);
                }
                for pixel in samples
                    .get(ends[0] as usize..ends[1] as usize)
                    .unwrap_or(&[])
                {
                    let code = pixel.inverse_depth_code();
                    let h = warp.homogeneous(code);
                    if h.z > 1e-6 && pixel.color_srgb[3] >= 128 {
                        let inverse_depth = (min + step * code as f32) / h.z;
                        let (x, y) = (h.x / h.z, h.y / h.z);
                        self.nearest
                            .draw_point(x, y, inverse_depth, pixel.color_srgb);
                    }
                }
            }
        }
    }
}

impl Draw for WarpOnly {
    fn draw(&mut self, camera: &Camera) {
        self.warp(camera);
    }

    fn depth_pixels(&mut self, _: &Camera) -> u64 {
        self.cube.depth_pixel_count() as u64
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        self.warp(camera);
        self.nearest.picture(camera, &self.cube.environment)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::contender::PointCloud;
    use crate::stability::room;

    #[test]
    fn three_arithmetics_draw_same_points() {
        let cube = Arc::new(room().expect("captured").clone());
        let eye = cube.info.centre + DVec3::new(0.1, -0.05, 0.08);
        let camera = Camera::look_at(
            eye,
            eye + DVec3::new(0.3, 0.1, -1.0),
            DVec3::Y,
            75.0,
            [80, 60],
        )
        .expect("valid");
        let cloud = PointCloud::new(&cube, 1).picture(&camera);
        for arithmetic in [
            WarpArithmetic::Direct,
            WarpArithmetic::RunningSum,
            WarpArithmetic::Anchored,
        ] {
            let frame = WarpOnly::new(Arc::clone(&cube), arithmetic).picture(&camera);
            let pixels = cloud.color.pixels().zip(frame.color.pixels());
            let differ = pixels.filter(|(a, b)| a != b).count();
            // Points within rounding of a pixel's border fall to either side: 1e-4 px of 4,800
            // pixels' borders.
            assert!(differ < 24, "{arithmetic:?}: {differ} of 4800");
        }
    }
}
