//! Rasterisation of the mesh (E9): for each pixel its triangle, inverse depth, and the weights of
//! the cameras that may colour it.
//!
//! Triangles tile the frame without overlap, so there is no depth test, and exact integer edge
//! functions leave no cracks. Triangles are only a few pixels large, so the output is laid out for
//! `texture`, which colours [`LANES`] adjacent pixels at a time, whatever their triangles.
//!
//! Where a triangle's corners belong to different surfaces, no surface spans them: each pixel
//! belongs to the near or to the far one, as the image of the near one's camera decides.

use super::fuse::Grid;
use super::texture_camera::TextureCamera;
use crate::view_geometry::EdgeRule;
use headbox_core::image::triangle_scan::{EdgeFunction, SUBPIXELS, pixels_between};
use rayon::prelude::*;
use std::ops::Range;

/// Number of adjacent pixels of a row that are coloured together.
pub(crate) const LANES: usize = 16;

/// Rows of a band: few enough that its buffers stay in a core's cache.
pub(crate) const BAND_ROWS: u32 = 16;

/// Bits of an owner's rank.
pub(crate) const OWNER_BITS: u32 = 10;

/// Maximum number of cameras of a frame.
pub(crate) const MOST_CAMERAS: usize = (1 << OWNER_BITS) - 1;

/// Owners of a pixel that no triangle covers.
pub(crate) const UNCOVERED: u32 = u32::MAX;

/// Group of [`LANES`] adjacent pixels of a row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pixels {
    /// Inverse depths, 1/m.
    pub(crate) inverse_depth: [f32; LANES],
    /// Ranks of the cameras of the triangle's corners, [`OWNER_BITS`] each, the first lowest; or
    /// [`UNCOVERED`].
    pub(crate) owners: [u32; LANES],
    /// Weights of the corners in any unit, if the owners differ; 0 for corners of the hidden
    /// surface.
    pub(crate) weights: [[f32; LANES]; 3],
    /// Numbers of the triangles.
    pub(crate) triangles: [u32; LANES],
}

/// Rasterised rows of a band.
#[derive(Clone, Debug, Default)]
pub(crate) struct BandBuffers {
    /// Groups of pixels, row by row; each row is padded to whole groups.
    pub(crate) pixels: Vec<Pixels>,
    /// Groups per row.
    pub(crate) per_row: usize,
}

impl BandBuffers {
    /// Resizes the buffers and marks all pixels as uncovered.
    fn reset(&mut self, width: u32, rows: u32) {
        const NOTHING: Pixels = Pixels {
            inverse_depth: [0.0; LANES],
            owners: [UNCOVERED; LANES],
            weights: [[0.0; LANES]; 3],
            triangles: [0; LANES],
        };
        self.per_row = (width as usize).div_ceil(LANES);
        for pixels in &mut self.pixels {
            pixels.owners = NOTHING.owners;
        }
        self.pixels.resize(self.per_row * rows as usize, NOTHING);
    }

    /// Assigns all pixels to the best camera, infinitely far away.
    pub(super) fn assign_all(&mut self, width: u32, rows: u32) {
        self.reset(width, rows);
        for pixels in &mut self.pixels {
            pixels.owners = [0; LANES];
            pixels.inverse_depth = [0.0; LANES];
        }
    }
}

/// Triangles sorted by band.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bins {
    /// First band of each triangle, and the one after its last.
    bands: Vec<[u16; 2]>,
    /// Start of each band's triangles in `numbers`, and the end of all.
    starts: Vec<u32>,
    numbers: Vec<u32>,
}

impl Bins {
    /// Removes all triangles.
    pub(super) fn clear(&mut self) {
        self.starts.clear();
    }

    /// Sorts triangles with samples at all corners by bands of a frame of `height` rows; returns
    /// the number of those inside the frame.
    pub(super) fn sort(&mut self, grid: &Grid, triangles: &[[u32; 3]], height: u32) -> u64 {
        const NOWHERE: [u16; 2] = [0; 2];
        let count = height.div_ceil(BAND_ROWS) as i32;
        let band_of = |y: i32| y.div_euclid(BAND_ROWS as i32 * SUBPIXELS);
        let bands = |corners: &[u32; 3]| {
            if !grid.has_samples(corners) {
                return NOWHERE;
            }
            let [a, b, c] = corners.map(|node| grid.y[node as usize]);
            let (first, last) = (band_of(a.min(b).min(c)), band_of(a.max(b).max(c)));
            // A frame's side is below 2^16.
            [
                first.clamp(0, count) as u16,
                (last + 1).clamp(0, count) as u16,
            ]
        };
        triangles
            .par_iter()
            .map(bands)
            .collect_into_vec(&mut self.bands);
        self.starts.clear();
        self.starts.resize(count as usize + 2, 0);
        let mut shown = 0;
        // Counts are stored one place further on, so that filling moves each start to its final
        // place.
        for &[first, end] in &self.bands {
            shown += u64::from(first < end);
            (first..end).for_each(|band| self.starts[usize::from(band) + 2] += 1);
        }
        for band in 2..self.starts.len() {
            self.starts[band] += self.starts[band - 1];
        }
        self.numbers.clear();
        self.numbers
            .resize(self.starts.last().map_or(0, |sum| *sum as usize), 0);
        for (&[first, end], number) in self.bands.iter().zip(0..) {
            for band in first..end {
                let next = &mut self.starts[usize::from(band) + 1];
                self.numbers[*next as usize] = number;
                *next += 1;
            }
        }
        shown
    }

    /// Returns the numbers of a band's triangles, in ascending order.
    fn triangles(&self, band: u32) -> &[u32] {
        let bounds = self
            .starts
            .get(band as usize..)
            .and_then(<[u32]>::first_chunk::<2>);
        bounds
            .and_then(|[from, to]| self.numbers.get(*from as usize..*to as usize))
            .unwrap_or_default()
    }
}

/// Rasteriser of a frame's mesh.
pub(crate) struct Scanner<'a> {
    pub(crate) grid: &'a Grid,
    pub(crate) triangles: &'a [[u32; 3]],
    pub(crate) bins: &'a Bins,
    /// Cameras by rank.
    pub(crate) cameras: &'a [TextureCamera],
    pub(crate) edge: &'a EdgeRule,
}

/// Visible point of a triangle in a pixel.
pub(super) struct SurfacePoint {
    /// Weights of the corners on the visible surface; 0 for those of the other surface.
    pub(super) weights: [f32; 3],
    /// Inverse depth, 1/m.
    pub(super) inverse_depth: f32,
}

/// Triangle set up for rasterisation.
pub(super) struct Triangle {
    /// Columns and rows of its bounding box in the band.
    columns: Range<u32>,
    rows: Range<u32>,
    /// Edge function opposite each corner: value at the first of these pixels, step per column,
    /// step per row.
    edges: [[i64; 3]; 3],
    /// Inverse depths of the corners over the sum of the edge functions, which is the same at all
    /// pixels.
    inverse_per_area: [f32; 3],
    /// Corners: position in the frame, pixels; inverse depth, 1/m; rank of the camera.
    pub(super) at: [[f32; 2]; 3],
    pub(super) inverse_depth: [f32; 3],
    pub(super) owners: [u16; 3],
    /// Mask of the corners on the nearer of two surfaces, if there are two.
    cut: Option<[bool; 3]>,
}

impl Triangle {
    /// Perspective weights of the corners by edge functions: screen-space weights times inverse
    /// depths, so that they add up to the inverse depth of the pixel.
    #[inline(always)]
    fn weights(&self, edges: [i64; 3]) -> [f32; 3] {
        [0, 1, 2].map(|k| edges[k] as f32 * self.inverse_per_area[k])
    }

    /// Computes the edge functions at the first pixel of a row.
    #[inline]
    fn edges_in(&self, row: u32) -> [i64; 3] {
        let down = i64::from(row - self.rows.start);
        self.edges.map(|[start, _, row]| start + row * down)
    }
}

impl Scanner<'_> {
    /// Rasterises the rows of a band of a frame of `width` columns.
    pub(crate) fn rasterise(&self, band: u32, width: u32, rows: &Range<u32>, to: &mut BandBuffers) {
        to.reset(width, rows.len() as u32);
        for &number in self.bins.triangles(band) {
            let Some(triangle) = self.set_up(number, width, rows) else {
                continue;
            };
            let [a, b, c] = triangle.owners;
            let owners =
                u32::from(a) | u32::from(b) << OWNER_BITS | u32::from(c) << (2 * OWNER_BITS);
            let is_plain = triangle.cut.is_none() && a == b && b == c;
            let per_column = sum(triangle.weights(triangle.edges.map(|[_, column, _]| column)));
            for y in triangle.rows.clone() {
                let row = (y - rows.start) as usize * to.per_row;
                let Some(pixels) = to.pixels.get_mut(row..row + to.per_row) else {
                    continue;
                };
                let mut edges = triangle.edges_in(y);
                let first = sum(triangle.weights(edges));
                let mut was_inside = false;
                for (x, step) in triangle.columns.clone().zip(0u16..) {
                    if edges[0] | edges[1] | edges[2] >= 0 {
                        was_inside = true;
                        let (pixels, lane) = (&mut pixels[x as usize / LANES], x as usize % LANES);
                        pixels.owners[lane] = owners;
                        pixels.triangles[lane] = number;
                        pixels.inverse_depth[lane] = if is_plain {
                            first + per_column * f32::from(step)
                        } else {
                            let point = self.visible_point(&triangle, edges, [x, y]);
                            (0..3).for_each(|k| pixels.weights[k][lane] = point.weights[k]);
                            point.inverse_depth
                        };
                    } else if was_inside {
                        break;
                    }
                    for (at, [_, column, _]) in edges.iter_mut().zip(&triangle.edges) {
                        *at += column;
                    }
                }
            }
        }
    }

    /// Recomputes the visible point of the triangle in a pixel.
    pub(super) fn point_at(
        &self,
        number: u32,
        [x, y]: [u32; 2],
    ) -> Option<(Triangle, SurfacePoint)> {
        let triangle = self.set_up(number, x + 1, &(y..y + 1))?;
        let across = i64::from(x - triangle.columns.start);
        let mut edges = triangle.edges_in(y);
        (0..3).for_each(|k| edges[k] += triangle.edges[k][1] * across);
        let point = self.visible_point(&triangle, edges, [x, y]);
        Some((triangle, point))
    }

    #[inline]
    fn set_up(&self, number: u32, width: u32, rows: &Range<u32>) -> Option<Triangle> {
        let corners = self
            .triangles
            .get(number as usize)?
            .map(|node| node as usize);
        let at = corners.map(|node| [self.grid.x[node], self.grid.y[node]]);
        let range = |axis: usize, clip: &Range<u32>| {
            let [a, b, c] = at.map(|p| p[axis]);
            let pixels = pixels_between(a.min(b).min(c), a.max(b).max(c), clip);
            (!pixels.is_empty()).then_some(pixels)
        };
        let rows = range(1, rows)?;
        let columns = range(0, &(0..width))?;
        let inverse_depth = corners.map(|node| self.grid.inverse_depth[node]);
        let cut = self.nearer_corners(at, inverse_depth);
        let edge = |from: [i32; 2], to: [i32; 2]| {
            let edge = EdgeFunction::new(from, to, [columns.start, rows.start]);
            // Top-left rule: a pixel centre on an edge belongs to the triangle of which it is a top
            // or left edge.
            let is_upper_or_left =
                edge.per_column > 0 || (edge.per_column == 0 && edge.per_row > 0);
            let [per_column, per_row] =
                [edge.per_column, edge.per_row].map(|step| step * i64::from(SUBPIXELS));
            [
                edge.value - i64::from(!is_upper_or_left),
                per_column,
                per_row,
            ]
        };
        let [a, b, c] = at;
        let edges = [edge(b, c), edge(c, a), edge(a, b)];
        let per_area = 1.0 / edges.iter().map(|[start, ..]| start).sum::<i64>() as f32;
        Some(Triangle {
            columns,
            rows,
            edges,
            inverse_per_area: inverse_depth.map(|inverse| inverse * per_area),
            at: at.map(|p| p.map(|part| part as f32 / SUBPIXELS as f32)),
            inverse_depth,
            owners: corners.map(|node| self.grid.owner[node]),
            cut,
        })
    }

    /// Returns a mask of the corners on the nearer of two surfaces; `None` if there is one surface.
    #[inline]
    fn nearer_corners(&self, at: [[i32; 2]; 3], inverse: [f32; 3]) -> Option<[bool; 3]> {
        let near = inverse[0].max(inverse[1]).max(inverse[2]);
        let far = inverse[0].min(inverse[1]).min(inverse[2]);
        if near - far <= self.edge.noise_floor {
            return None;
        }
        let is_edge = |i: usize, j: usize| {
            let [dx, dy] = [0, 1].map(|axis| (at[i][axis] - at[j][axis]) as f32);
            self.edge.is_edge(
                inverse[i],
                inverse[j],
                (dx * dx + dy * dy).sqrt() / SUBPIXELS as f32,
            )
        };
        // The corner of middle depth joins the nearer of the other two.
        let middle = (near + far) * 0.5;
        (is_edge(0, 1) || is_edge(1, 2) || is_edge(2, 0))
            .then(|| inverse.map(|depth| depth > middle))
    }

    /// Finds the visible point of a triangle in a pixel from the edge functions there.
    #[inline]
    fn visible_point(&self, triangle: &Triangle, edges: [i64; 3], pixel: [u32; 2]) -> SurfacePoint {
        let weights = triangle.weights(edges);
        match triangle.cut {
            Some(near) => {
                self.visible_side(triangle, near, weights, pixel.map(|at| at as f32 + 0.5))
            }
            None => SurfacePoint {
                weights,
                inverse_depth: sum(weights),
            },
        }
    }

    /// Finds the visible point of a triangle across a depth edge, by the depth that the near
    /// surface's camera sees there.
    fn visible_side(
        &self,
        triangle: &Triangle,
        is_near: [bool; 3],
        weights: [f32; 3],
        [x, y]: [f32; 2],
    ) -> SurfacePoint {
        let on_side = |near: bool| {
            let in_frame = [0, 1, 2].map(|k| {
                if is_near[k] == near {
                    (weights[k] / triangle.inverse_depth[k]).max(1e-6)
                } else {
                    0.0
                }
            });
            let weights = [0, 1, 2].map(|k| in_frame[k] * triangle.inverse_depth[k]);
            (
                SurfacePoint {
                    weights,
                    inverse_depth: sum(weights) / sum(in_frame),
                },
                sum(in_frame),
            )
        };
        let ((near, near_share), (far, far_share)) = (on_side(true), on_side(false));
        let owner = (0..3)
            .filter(|k| is_near[*k])
            .map(|k| triangle.owners[k])
            .min();
        let camera = owner.and_then(|owner| self.cameras.get(owner as usize));
        let shows_near =
            match camera.and_then(|camera| camera.depths_at([x, y], near.inverse_depth)) {
                Some([shown, there]) => {
                    shown > there * 0.5 * (1.0 + far.inverse_depth / near.inverse_depth)
                }
                None => near_share > far_share,
            };
        if shows_near { near } else { far }
    }
}

#[inline(always)]
fn sum([a, b, c]: [f32; 3]) -> f32 {
    a + b + c
}
