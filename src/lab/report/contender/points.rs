//! The depth pixels of a cube LDI as a cloud of points with a depth buffer: what one would write in
//! an afternoon. Every point is projected, in any order, and the nearest one of each pixel
//! overwrites the others.

use super::{Draw, JudgedFrame, PixelOrigin};
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
    /// From the centre, world axes, metres.
    position: Vec3,
    /// sRGB.
    color: [u8; 4],
}

/// A depth buffer that keeps the nearest colour of each pixel.
///
/// A cell is an inverse depth (positive f32, whose bits order as numbers do), then 24 bits of
/// colour. The largest wins whatever the order of arrival, so that threads need no other agreement.
#[derive(Default)]
pub(super) struct NearestColors {
    size: [u32; 2],
    cells: Vec<AtomicU64>,
}

impl NearestColors {
    /// Nothing yet, at the size of the camera's image.
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

    /// A point that shows in one pixel, if (x, y) lies in the image; by one thread alone.
    #[inline(always)]
    pub(super) fn put(&mut self, x_px: f32, y_px: f32, inverse_depth: f32, color: [u8; 4]) {
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

    /// The colours, with the environment behind them. `camera` as in [`Self::reset`].
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
                        let direction = camera.direction(x as f64 + 0.5, y as f64 + 0.5).as_vec3();
                        environment.sample(direction).unwrap_or([0; 3])
                    } else {
                        let [r, g, b, ..] = cell.to_le_bytes();
                        [r, g, b]
                    };
                }
            });
    }

    /// The finished picture.
    pub(super) fn picture(&self, camera: &Camera, environment: &Environment) -> JudgedFrame {
        let mut color = Vec::new();
        self.resolve(camera, environment, &mut color);
        let [width, height] = self.size;
        let known = |index: usize| {
            let (x, y) = (index as u32 % width, index as u32 / width);
            environment
                .sample(
                    camera
                        .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
                        .as_vec3(),
                )
                .is_some()
        };
        let shown =
            self.cells
                .iter()
                .enumerate()
                .map(|(index, cell)| match cell.load(Ordering::Relaxed) {
                    0 if known(index) => PixelOrigin::Environment,
                    0 => PixelOrigin::Nothing,
                    _ => PixelOrigin::Surface,
                });
        let shown = shown.collect();
        JudgedFrame {
            shown,
            color: RgbImage::from_fn(width, height, |x, y| {
                image::Rgb(color[(y * width + x) as usize])
            }),
        }
    }
}

/// Points, and what is behind them.
pub struct PointCloud {
    points: Vec<Point>,
    centre: glam::DVec3,
    environment: Environment,
    stamp_px: u32,
    nearest: NearestColors,
    color: Vec<[u8; 3]>,
}

/// Points drawn by one thread at a time.
const CHUNK: usize = 1 << 13;

impl PointCloud {
    /// The depth pixels of a cube, each to be drawn as a square of `stamp_px` pixels; those that
    /// hide less than half of their pixel are left out, as there is nothing half-hidden in a depth
    /// buffer.
    pub fn new(cube: &CubeLdi, stamp_px: u32) -> Self {
        let mut points = Vec::with_capacity(cube.depth_pixel_count());
        for segment in &cube.segments {
            for (x, y) in (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y)))
            {
                let at = [segment.x0 + x, segment.y0 + y].map(|c| f64::from(c) + 0.5);
                let ray = segment.face.direction(at[0], at[1], cube.face_size_px);
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
        let (environment, centre) = (cube.environment.clone(), cube.info.centre);
        Self {
            points,
            centre,
            environment,
            stamp_px,
            nearest: NearestColors::default(),
            color: Vec::new(),
        }
    }

    /// Bytes of points and environment.
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

    fn picture(&mut self, camera: &Camera) -> JudgedFrame {
        self.project(camera);
        self.nearest.picture(camera, &self.environment)
    }
}
