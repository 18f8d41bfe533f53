//! Depth pixels of a cube LDI as a point cloud with a depth buffer: the simplest renderer. All
//! points are projected in any order, and the nearest one of each pixel wins.

use super::{ContenderFrame, Draw, PixelOrigin};
use glam::{Mat4, Vec3};
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_cube::pack::CubeLdi;
use image::RgbImage;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// One point: 16 bytes.
#[derive(Clone, Copy)]
struct Point {
    /// Position relative to the centre, world axes, metres.
    position: Vec3,
    /// Colour and alpha, sRGB.
    color: [u8; 4],
}

/// Depth buffer that keeps the nearest colour of each pixel.
///
/// A cell is an inverse depth (positive f32, whose bits order as numbers do), then 24 bits of
/// colour. The maximum does not depend on the order of arrival, so that threads need no other
/// synchronisation.
#[derive(Default)]
pub(super) struct NearestColors {
    size: [u32; 2],
    cells: Vec<AtomicU64>,
}

impl NearestColors {
    /// Clears the buffer, at the size of the camera's image.
    pub(super) fn reset(&mut self, camera: &Camera) {
        self.size = [camera.width(), camera.height()];
        self.cells.resize_with(
            self.size[0] as usize * self.size[1] as usize,
            AtomicU64::default,
        );
        self.cells
            .par_iter_mut()
            .for_each(|cell| *cell.get_mut() = 0);
    }

    fn cell(inverse_depth: f32, [r, g, b, _]: [u8; 4]) -> u64 {
        u64::from(inverse_depth.to_bits()) << 24 | u64::from(u32::from_le_bytes([r, g, b, 0]))
    }

    /// Draws a point of one pixel if (x, y) lies in the image; for use by a single thread.
    #[inline(always)]
    pub(super) fn draw_point(&mut self, x_px: f32, y_px: f32, inverse_depth: f32, color: [u8; 4]) {
        let [width, height] = self.size;
        // False for NaN too.
        if x_px >= 0.0 && y_px >= 0.0 && x_px < width as f32 && y_px < height as f32 {
            let index = y_px as usize * width as usize + x_px as usize;
            if let Some(cell) = self.cells.get_mut(index) {
                let cell = cell.get_mut();
                *cell = (*cell).max(Self::cell(inverse_depth, color));
            }
        }
    }

    /// Resolves colours with the environment behind them. `camera` as in [`Self::reset`].
    pub(super) fn resolve(
        &self,
        camera: &Camera,
        environment: &Environment,
        color: &mut Vec<[u8; 3]>,
    ) {
        let width = self.size[0] as usize;
        color.resize(self.cells.len(), [0; 3]);
        color
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, color) in row.iter_mut().enumerate() {
                    let cell = self.cells[y * width + x].load(Ordering::Relaxed);
                    *color = if cell == 0 {
                        background(camera, environment, x, y).unwrap_or([0; 3])
                    } else {
                        let [r, g, b, ..] = cell.to_le_bytes();
                        [r, g, b]
                    };
                }
            });
    }

    /// Returns the resolved frame.
    pub(super) fn picture(&self, camera: &Camera, environment: &Environment) -> ContenderFrame {
        let mut color = Vec::new();
        self.resolve(camera, environment, &mut color);
        let [width, height] = self.size;
        let origin = |(index, cell): (usize, &AtomicU64)| {
            let (x, y) = (index % width as usize, index / width as usize);
            if cell.load(Ordering::Relaxed) > 0 {
                PixelOrigin::Surface
            } else if background(camera, environment, x, y).is_some() {
                PixelOrigin::Environment
            } else {
                PixelOrigin::Hole
            }
        };
        ContenderFrame {
            origins: self.cells.iter().enumerate().map(origin).collect(),
            color: RgbImage::from_raw(width, height, color.into_flattened()).unwrap_or_default(),
        }
    }
}

/// Samples the environment behind a pixel, sRGB.
fn background(camera: &Camera, environment: &Environment, x: usize, y: usize) -> Option<[u8; 3]> {
    environment.sample(camera.direction(x as f64 + 0.5, y as f64 + 0.5).as_vec3())
}

/// Point cloud with an environment.
pub struct PointCloud {
    points: Vec<Point>,
    centre: glam::DVec3,
    environment: Environment,
    stamp_px: u32,
    nearest: NearestColors,
    color: Vec<[u8; 3]>,
}

/// Number of points in a task of a thread.
const CHUNK: usize = 1 << 13;

impl PointCloud {
    /// Converts the depth pixels of a cube to points, drawn as squares of `stamp_px` pixels. Those
    /// with less than half coverage are left out: a depth buffer has no partial coverage.
    pub fn new(cube: &CubeLdi, stamp_px: u32) -> Self {
        let mut points = Vec::with_capacity(cube.depth_pixel_count());
        for segment in &cube.segments {
            for (x, y) in (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y)))
            {
                let [px, py] = [segment.x0 + x, segment.y0 + y].map(|c| f64::from(c) + 0.5);
                let ray = segment.face.direction(px, py, cube.face_size_px);
                for pixel in segment
                    .pixel(x, y)
                    .iter()
                    .filter(|pixel| pixel.color_srgb[3] >= 128)
                {
                    let inverse_depth = segment.decode(cube.layout, *pixel).inverse_depth;
                    points.push(Point {
                        position: (ray / inverse_depth).as_vec3(),
                        color: pixel.color_srgb,
                    });
                }
            }
        }
        Self {
            points,
            centre: cube.info.centre,
            environment: cube.environment.clone(),
            stamp_px,
            nearest: NearestColors::default(),
            color: Vec::new(),
        }
    }

    /// Returns the size of points and environment, bytes.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.points[..]) + size_of_val(&self.environment.texels[..])) as u64
    }

    /// Projects all points.
    fn project(&mut self, camera: &Camera) {
        self.nearest.reset(camera);
        let (width, height) = (camera.width() as i32, camera.height() as i32);
        let moved = camera.with_eye(camera.eye() - self.centre);
        let image_from_world: Mat4 = moved.image_from_world().as_mat4();
        let reach = self.stamp_px as i32 / 2;
        self.points.par_chunks(CHUNK).for_each(|points| {
            for point in points {
                let h = image_from_world * point.position.extend(1.0);
                if h.w <= 1e-6 {
                    continue;
                }
                let (x, y) = ((h.x / h.w).floor(), (h.y / h.w).floor());
                let inside = |c: f32, size: i32| c >= -reach as f32 && c < (size + reach) as f32;
                if !inside(x, width) || !inside(y, height) {
                    continue;
                }
                let cell = NearestColors::cell(1.0 / h.w, point.color);
                let span = |c: f32, size: i32| {
                    (c as i32 - reach).max(0)..(c as i32 - reach + self.stamp_px as i32).min(size)
                };
                for row in span(y, height) {
                    for column in span(x, width) {
                        self.nearest.cells[(row * width + column) as usize]
                            .fetch_max(cell, Ordering::Relaxed);
                    }
                }
            }
        });
    }
}

impl Draw for PointCloud {
    fn draw(&mut self, camera: &Camera) {
        self.project(camera);
        self.nearest
            .resolve(camera, &self.environment, &mut self.color);
    }

    fn depth_pixels(&mut self, _: &Camera) -> u64 {
        self.points.len() as u64
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        self.project(camera);
        self.nearest.picture(camera, &self.environment)
    }
}
