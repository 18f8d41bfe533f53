//! Samples of a cube by face, in the order of a quadtree, and their visibility from the headbox.

use super::cluster::{Cluster, FaceGrid};
use crate::points::surfels::{ENVIRONMENT, SurfaceSample, Surfel, surface_samples};
use glam::{DVec2, Vec3};
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Tolerance of the depth test, relative: of neighbours on slanted surfaces none hides another.
const DEPTH_TOLERANCE: f32 = 0.05;
/// Coverage from which a sample hides others, of 255.
const OCCLUDER_ALPHA: u8 = 128;
/// Range of the widths of depth buffers' faces, pixels.
const DEPTH_BUFFER_PX: [u32; 2] = [16, 1024];

/// Number of eyes from which visibility is measured: the centre and the corners of the headbox.
const EYES: usize = 9;

/// A sample.
#[derive(Clone, Copy)]
pub(super) struct Leaf {
    /// Column and row, interleaved: its number along the Morton curve.
    pub(super) morton: u32,
    /// Index on its face.
    pub(super) number: u32,
    pub(super) surface: u32,
    column: i16,
    row: i16,
    /// Inverse depth, 1/m.
    pub(super) inverse_depth: f32,
    pub(super) normal: Vec3,
    pub(super) color_srgb: [u8; 4],
    /// Number of the [`EYES`] that see it.
    eyes: u8,
}

impl Leaf {
    fn new(sample: &SurfaceSample) -> Self {
        // Plane textures reach one pixel beyond their face.
        let number = |c: i32| (c + 1).max(0) as u32;
        Self {
            morton: spread(number(sample.column)) | spread(number(sample.row)) << 1,
            number: 0,
            surface: sample.surface,
            column: sample.column as i16,
            row: sample.row as i16,
            inverse_depth: (sample.inverse_depth as f32).max(f32::MIN_POSITIVE),
            normal: sample.normal.as_vec3(),
            color_srgb: sample.color_srgb,
            eyes: 0,
        }
    }

    /// Share of the eyes that see it. Nothing is invisible from everywhere: half an eye sees it.
    pub(super) fn visibility(&self) -> f64 {
        (f64::from(self.eyes) + 0.5) / (EYES as f64 + 0.5)
    }

    /// Centre of its pixel on the face.
    pub(super) fn at(&self) -> DVec2 {
        DVec2::new(f64::from(self.column), f64::from(self.row)) + 0.5
    }
}

/// Puts a zero between the bits of a number below 2^16.
fn spread(c: u32) -> u32 {
    let c = (c | c << 8) & 0x00ff_00ff;
    let c = (c | c << 4) & 0x0f0f_0f0f;
    let c = (c | c << 2) & 0x3333_3333;
    (c | c << 1) & 0x5555_5555
}

/// All samples of a face, of the cube or of the environment.
pub(super) struct LeafFace {
    pub(super) grid: FaceGrid,
    /// In Morton order.
    pub(super) leaves: Vec<Leaf>,
}

impl LeafFace {
    /// Returns the surfel of a cluster.
    pub(super) fn surfel(&self, cluster: &Cluster) -> Surfel {
        if cluster.count > 1.0 {
            return self.grid.surfel(cluster);
        }
        let leaf = &self.leaves[cluster.leaf as usize];
        let FaceGrid { face, face_px, .. } = self.grid;
        let d = self.grid.direction(leaf.at());
        let (q, normal) = (f64::from(leaf.inverse_depth), leaf.normal.as_dvec3());
        Surfel::new(face, face_px, d, q, normal, leaf.color_srgb)
    }
}

/// Collects the samples of a cube, with `sky` those of the environment too.
pub(super) fn faces(cube: &CubeLdi, sky: bool, progress: &dyn Progress) -> Vec<LeafFace> {
    let face_px = cube.face_size_px;
    let parallax = cube.info.half_size_m * f64::from(face_px) / 2.0;
    let grid = |face, grid_px: u32| FaceGrid {
        face,
        face_px: grid_px,
        solid_angle: (f64::from(face_px) / f64::from(grid_px.max(1))).powi(2),
        parallax,
        max_displacement_px: 0.0,
    };
    let mut faces: Vec<LeafFace> = [face_px, cube.environment.size_px]
        .into_iter()
        .flat_map(|px| Face::ALL.map(|face| grid(face, px)))
        .map(|grid| LeafFace {
            grid,
            leaves: Vec::new(),
        })
        .collect();
    for sample in surface_samples(cube, sky) {
        let first = if sample.surface == ENVIRONMENT { 6 } else { 0 };
        let leaves = &mut faces[first + sample.face.index()].leaves;
        leaves.push(Leaf::new(&sample));
    }
    for face in &mut faces {
        face.leaves.par_sort_by_key(|leaf| leaf.morton);
        for (number, leaf) in (0..).zip(&mut face.leaves) {
            leaf.number = number;
        }
    }
    measure_visibility(&mut faces, cube, progress);
    faces
}

/// Measures from how many of the [`EYES`] each sample is visible, by depth buffers of half the
/// resolution.
fn measure_visibility(faces: &mut [LeafFace], cube: &CubeLdi, progress: &dyn Progress) {
    let half = cube.info.half_size_m as f32;
    let side = |i: usize, axis: usize| if i >> axis & 1 == 1 { half } else { -half };
    let eyes: [Vec3; EYES] = std::array::from_fn(|i| match i {
        0 => Vec3::ZERO,
        _ => Vec3::new(side(i, 0), side(i, 1), side(i, 2)),
    });
    let [least, most] = DEPTH_BUFFER_PX;
    let px = (cube.face_size_px / 2).clamp(least, most);
    progress.begin("visibility", "eyes", EYES as u64);
    for eye in eyes {
        let buffer = DepthBuffer::new(px);
        for face in faces.iter() {
            let occluders = face.leaves.par_iter();
            let occluders = occluders.filter(|leaf| leaf.color_srgb[3] >= OCCLUDER_ALPHA);
            occluders.for_each(|leaf| buffer.draw(face.grid.position(leaf) - eye));
        }
        for LeafFace { grid, leaves } in faces.iter_mut() {
            leaves.par_iter_mut().for_each(|leaf| {
                leaf.eyes += u8::from(buffer.shows(grid.position(leaf) - eye));
            });
        }
        progress.advance(1);
    }
}

/// Largest inverse depths around an eye, on the six faces of a cube; the order of drawing does not
/// matter.
struct DepthBuffer {
    px: u32,
    /// Bits of floating-point numbers above 0, which are in the order of the numbers.
    inverse_depths: Vec<AtomicU32>,
}

impl DepthBuffer {
    fn new(px: u32) -> Self {
        let count = 6 * px as usize * px as usize;
        Self {
            px,
            inverse_depths: (0..count).map(|_| AtomicU32::new(0)).collect(),
        }
    }

    /// Returns the cell and the inverse depth of a position relative to the eye; `None` at the eye.
    fn locate(&self, position: Vec3) -> Option<(usize, f32)> {
        let (face, [right, up, depth]) = Face::locate(position);
        if depth <= 0.0 {
            return None;
        }
        let half = self.px as f32 / 2.0;
        let cell = |c: f32| ((c * half) as u32).min(self.px - 1) as usize;
        let (column, row) = (cell(1.0 + right / depth), cell(1.0 - up / depth));
        let px = self.px as usize;
        Some(((face.index() * px + row) * px + column, 1.0 / depth))
    }

    fn draw(&self, position: Vec3) {
        if let Some((cell, inverse_depth)) = self.locate(position) {
            self.inverse_depths[cell].fetch_max(inverse_depth.to_bits(), Ordering::Relaxed);
        }
    }

    fn shows(&self, position: Vec3) -> bool {
        self.locate(position).is_some_and(|(cell, inverse_depth)| {
            let nearest = f32::from_bits(self.inverse_depths[cell].load(Ordering::Relaxed));
            inverse_depth >= nearest * (1.0 - DEPTH_TOLERANCE)
        })
    }
}
