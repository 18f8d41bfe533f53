//! Rasterising the geometry, with baked light: what one would do with triangles and no tracer.
//!
//! Homogeneous rasterisation (Olano and Greer 1997): the inverse of the matrix of a triangle's three vertices (x w, y w, w)
//! gives each vertex's weight over w as a linear function of the pixel; a pixel is inside where none is negative, the
//! functions' sum is the inverse depth, and triangles that reach behind the eye need no clipping. A depth buffer of
//! triangle numbers is shaded once per pixel.

use super::baked::BakedLight;
use super::{Draw, Picture, Shown};
use crate::capture::Camera;
use crate::capture::trace::{Hit, Ray, Tracer};
use glam::{DMat3, DMat4, DVec3};
use image::RgbImage;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// A triangle as a frame sees it.
struct Projected {
    primitive: u32,
    columns: Range<u32>,
    rows: Range<u32>,
    /// From (x, y, 1) to the vertices' weights over w.
    weights: DMat3,
}

/// What a pixel shows: a hit whose `t` is its eye depth.
type Cell = Option<Hit>;

/// Rows that one thread draws at a time.
const BAND_ROWS: usize = 8;
/// Triangles that one thread projects at a time.
const CHUNK: usize = 1 << 12;

/// Draws the scene's triangles into a depth buffer.
pub struct RasterDraw {
    baked: Arc<BakedLight>,
    color: RgbImage,
}

/// The triangles that cover a pixel's centre, in their order in the scene.
fn project(tracer: &Tracer, camera: &Camera) -> Vec<Projected> {
    let (width, height) = (camera.width(), camera.height());
    let matrix: DMat4 = camera.with_eye(camera.eye() - tracer.origin()).image_from_world();
    let triangles = tracer.scene().triangles.len() as u32;
    let project = |primitive: u32| {
        let corners = tracer.triangle(primitive).map(|corner| {
            let h = matrix * corner.as_dvec3().extend(1.0);
            DVec3::new(h.x, h.y, h.w)
        });
        if corners.iter().all(|c| c.z <= 0.0) {
            return None;
        }
        let span = |axis: usize, size: u32| {
            if corners.iter().any(|c| c.z <= 1e-9) {
                return 0..size;
            }
            let at = corners.map(|c| c[axis] / c.z);
            let pixel = |v: f64| (v - 0.5).ceil().clamp(0.0, f64::from(size)) as u32;
            pixel(at[0].min(at[1]).min(at[2]))..pixel(at[0].max(at[1]).max(at[2]).next_up())
        };
        let (columns, rows) = (span(0, width), span(1, height));
        if columns.is_empty() || rows.is_empty() {
            return None;
        }
        let weights = DMat3::from_cols_array_2d(&corners.map(|c| c.to_array())).inverse();
        weights.is_finite().then_some(Projected { primitive, columns, rows, weights })
    };
    let chunks = (0..triangles.div_ceil(CHUNK as u32)).into_par_iter();
    chunks
        .flat_map_iter(|chunk| {
            let first = chunk * CHUNK as u32;
            (first..triangles.min(first + CHUNK as u32)).filter_map(project)
        })
        .collect()
}

/// Draws what of `triangles` shows in the rows from `first` on.
fn draw_band(tracer: &Tracer, triangles: &[Projected], width: usize, first: u32, cells: &mut [Cell]) {
    let rows = first..first + (cells.len() / width.max(1)) as u32;
    for triangle in triangles.iter().filter(|t| t.rows.start < rows.end && t.rows.end > rows.start) {
        for y in triangle.rows.start.max(rows.start)..triangle.rows.end.min(rows.end) {
            let left = f64::from(triangle.columns.start) + 0.5;
            let mut weights = triangle.weights * DVec3::new(left, f64::from(y) + 0.5, 1.0);
            for x in triangle.columns.clone() {
                let inverse_depth = weights.x + weights.y + weights.z;
                let cell = &mut cells[(y - rows.start) as usize * width + x as usize];
                let nearer = cell.is_none_or(|hit| inverse_depth > f64::from(hit.t).recip());
                if weights.min_element() >= 0.0 && inverse_depth > 0.0 && nearer {
                    let (u, v) = ((weights.y / inverse_depth) as f32, (weights.z / inverse_depth) as f32);
                    if tracer.scene().is_solid(triangle.primitive, u, v) {
                        let (t, primitive) = (inverse_depth.recip() as f32, triangle.primitive);
                        *cell = Some(Hit { t, primitive, u, v });
                    }
                }
                weights += triangle.weights.x_axis;
            }
        }
    }
}

/// What each pixel of a frame shows, row-major.
fn rasterise(tracer: &Tracer, camera: &Camera) -> Vec<Cell> {
    let width = camera.width() as usize;
    let triangles = project(tracer, camera);
    let mut cells = vec![None; width * camera.height() as usize];
    cells.par_chunks_mut(width * BAND_ROWS).enumerate().for_each(|(band, cells)| {
        draw_band(tracer, &triangles, width, (band * BAND_ROWS) as u32, cells);
    });
    cells
}

impl RasterDraw {
    /// Draws with this light.
    pub fn new(baked: Arc<BakedLight>) -> Self {
        Self { baked, color: RgbImage::new(0, 0) }
    }

    /// Bakes the light of what a camera shows; rounding may put a pixel in another cell than its ray.
    pub fn bake_view(baked: &mut BakedLight, camera: &Camera) {
        let cells = rasterise(baked.tracer(), camera);
        let hits: Vec<(Ray, Hit)> = cells
            .into_iter()
            .zip(0..)
            .filter_map(|(cell, i)| Some((baked.pixel_ray(camera, i % camera.width(), i / camera.width()), cell?)))
            .collect();
        baked.bake(hits);
    }
}

impl Draw for RasterDraw {
    fn draw(&mut self, camera: &Camera) -> u64 {
        let width = camera.width();
        let cells = rasterise(self.baked.tracer(), camera);
        let color = cells.par_iter().enumerate().flat_map_iter(|(i, cell)| {
            let ray = self.baked.pixel_ray(camera, i as u32 % width, i as u32 / width);
            self.baked.shade(&ray, *cell)
        });
        self.color = RgbImage::from_raw(width, camera.height(), color.collect()).unwrap_or_default();
        0
    }

    fn picture(&mut self, camera: &Camera) -> Picture {
        self.draw(camera);
        let cells = rasterise(self.baked.tracer(), camera);
        let shown = |cell: &Cell| if cell.is_some() { Shown::Surface } else { Shown::Environment };
        Picture { color: self.color.clone(), shown: cells.iter().map(shown).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays and rasteriser round differently where a pixel's centre is within rounding of an edge; a captured scene's edges
    /// meet few of 3,072 centres so closely.
    const DIFFERING_PIXELS: usize = 6;

    #[test]
    fn the_rasteriser_shows_what_rays_hit() {
        for (name, forward) in
            [("bump", DVec3::NEG_Z), ("interior", DVec3::new(1.0, -0.4, 0.3)), ("tree", DVec3::NEG_Z)]
        {
            let scene = Arc::new(crate::scenes::build(name, 0).expect("built in"));
            let centre = scene.headbox.expect("it has one").centre;
            let tracer = Tracer::new(scene, centre);
            // 100 degrees: triangles of the room reach behind the eye.
            let camera = Camera::look_at(centre, centre + forward, DVec3::Y, 100.0, 64, 48).expect("valid");
            let mut differing = 0;
            for (i, cell) in rasterise(&tracer, &camera).into_iter().enumerate() {
                let (x, y) = (i as f64 % 64.0, (i / 64) as f64);
                let direction = camera.direction(x.floor() + 0.5, y + 0.5).as_vec3();
                let ray = Ray { origin: glam::Vec3::ZERO, direction, t_min: 0.0, t_max: f32::INFINITY };
                let hit = tracer.closest(&ray);
                let agree = match (cell, hit) {
                    (Some(a), Some(b)) => (a.t - b.t).abs() <= 1e-4 * b.t,
                    (a, b) => a.is_none() && b.is_none(),
                };
                differing += usize::from(!agree);
            }
            assert!(differing <= DIFFERING_PIXELS, "{name}: {differing} of 3072");
        }
    }
}
