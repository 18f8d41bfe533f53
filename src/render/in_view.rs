//! Which sheets a frame shows, nearest first.

use super::clip::W_NEAR;
use super::transfer::Transfer;
use crate::capture::Camera;
use crate::capture::rig::Face;
use crate::packed::PackedCube;
use crate::packed::sheets::{PLACE_COLUMNS, PLACE_ROWS, Sheet, Sheets};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A sheet that may show.
#[derive(Clone, Copy, Debug)]
pub(super) struct SheetInView {
    /// Which of the cube's.
    pub(super) index: u32,
    /// Columns and rows of the frame that it may touch: first and the one after the last.
    pub(super) columns: [i32; 2],
    pub(super) rows: [i32; 2],
    /// 1 / eye depth of its nearest sample in the frame at most, 1/m.
    pub(super) nearest: f32,
    /// Homogeneous position in the frame of its first entry at infinity.
    pub(super) anchor: Vec3,
}

/// The steps of a [`Transfer`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FaceSteps {
    pub(super) one: Vec3,
    pub(super) x: Vec3,
    pub(super) y: Vec3,
    pub(super) inverse_depth: Vec3,
}

/// All sheets of a cube in the view of one frame.
#[derive(Default)]
pub(super) struct InView {
    pub(super) sheets: Vec<SheetInView>,
    /// Of each face.
    pub(super) faces: [FaceSteps; 6],
    /// Of the viewing axis, px.
    pub(super) principal_px: [f32; 2],
}

/// Face pixels by which a footprint may reach beyond the centre of its sample.
const REACH: f64 = 1.6;

impl InView {
    /// Finds them.
    pub(super) fn prepare(&mut self, cube: &PackedCube, camera: &Camera, unclipped: bool) {
        let (sheets, face_px) = (cube.sheets(), cube.face_size_px);
        let eye = camera.eye() - cube.info.centre;
        let transfers = Face::ALL.map(|face| Transfer::new(camera, eye, face, face_px));
        self.faces = transfers.map(|t| FaceSteps {
            one: t.one.as_vec3(),
            x: t.x_step.as_vec3(),
            y: t.y_step.as_vec3(),
            inverse_depth: t.inverse_depth.as_vec3(),
        });
        let principal = camera.principal_px();
        self.principal_px = principal.map(|c| c as f32);
        let frame = FrameEdges { size: [camera.width(), camera.height()].map(f64::from), principal, unclipped };
        self.sheets.clear();
        let found = sheets.sheets.par_chunks(1024).enumerate().map(|(chunk, some)| {
            let seen = |(i, sheet): (usize, &Sheet)| {
                frame.sees(&transfers[sheet.face.index()], sheet, sheets, (chunk * 1024 + i) as u32)
            };
            some.iter().enumerate().filter_map(seen).collect::<Vec<_>>()
        });
        for some in found.collect::<Vec<_>>() {
            self.sheets.extend(some);
        }
        self.sheets.sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest).then(a.index.cmp(&b.index)));
    }
}

struct FrameEdges {
    size: [f64; 2],
    principal: [f64; 2],
    unclipped: bool,
}

impl FrameEdges {
    /// The sheet as the frame sees it, or `None` if nothing of it shows.
    fn sees(&self, transfer: &Transfer, sheet: &Sheet, sheets: &Sheets, index: u32) -> Option<SheetInView> {
        let [width, height] = self.size;
        let (x0, y0) = (f64::from(sheet.x0), f64::from(sheet.y0));
        let anchor = transfer.at(x0 - 0.5, y0 - 0.5).as_vec3();
        let all =
            SheetInView { index, columns: [0, width as i32], rows: [0, height as i32], nearest: f32::INFINITY, anchor };
        if self.unclipped {
            return Some(all);
        }
        let q = sheet.inverse_depth.map(f64::from);
        let steepest = f64::from(sheets.slope_unit) * 2048.0 * REACH;
        let ends = |start: f64, length: u32| [start - REACH, start + f64::from(length) + REACH];
        let (x, y) = (ends(x0, PLACE_COLUMNS), ends(y0, PLACE_ROWS));
        let wide = [q[0] * (1.0 - steepest), q[1] * (1.0 + steepest)];
        let corners: [DVec3; 8] =
            std::array::from_fn(|i| transfer.at(x[i & 1], y[i >> 1 & 1]) + transfer.inverse_depth * wide[i >> 2]);
        let w = f64::from(W_NEAR);
        if corners.iter().all(|h| h.z < w) {
            return None;
        }
        if corners.iter().any(|h| h.z < w) {
            let [left, top] = self.principal.map(|c| -c);
            let (right, bottom) = (width + left, height + top);
            let outside = corners.iter().all(|h| h.x < left * h.z)
                || corners.iter().all(|h| h.x > right * h.z)
                || corners.iter().all(|h| h.y < top * h.z)
                || corners.iter().all(|h| h.y > bottom * h.z);
            return (!outside).then_some(all);
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut nearest = 0.0f64;
        for (i, h) in corners.iter().enumerate() {
            let reciprocal = 1.0 / h.z;
            for (axis, v) in [h.x, h.y].into_iter().enumerate() {
                let at = v * reciprocal + self.principal[axis];
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
            nearest = nearest.max(wide[i >> 2] * reciprocal);
        }
        let range = |axis: usize, size: f64| {
            [(low[axis] - 1.5).floor().clamp(0.0, size) as i32, (high[axis] + 1.5).ceil().clamp(0.0, size) as i32]
        };
        let (columns, rows) = (range(0, width), range(1, height));
        let shows = columns[0] < columns[1] && rows[0] < rows[1];
        shows.then_some(SheetInView { index, columns, rows, nearest: (nearest * (1.0 + 1e-5)) as f32, anchor })
    }
}
