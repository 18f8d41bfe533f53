//! From the mesh to pixels (E9): each triangle textured by one camera, by the best ranked of its corners', by up to three
//! blended, or by the mean of all good ones.
//!
//! Triangles tile the frame: no two overlap, so there is no depth test, and with exact integer edge functions no crack. At a pixel, position and
//! inverse depth give its place in any picture by one product with a homography and one with an epipole (Shade's
//! `start + q * depth`), which is perspective-correct by construction.
//!
//! The paper projects textures through whatever stands between. Here each texel knows its depth: a camera that shows something nearer does not see the pixel's
//! point and has no say in it. Where a triangle's corners belong to different surfaces, no skin spans them: each pixel belongs to the near or to
//! the far one, as the picture of the near one's camera says.

use super::delaunay::doubled_area;
use super::fuse::{Grid, SUBPIXELS};
use super::picture::Picture;
use super::{EdgeRule, RealCamera, Texturing};
use crate::capture::Camera;
use crate::frame::Coverage;
use crate::raster::encode_srgb;
use glam::{DMat3, DVec3, Vec3};
use std::ops::Range;
use std::sync::Arc;

/// Linear light of texels, 16 bits.
const PER_FULL: f32 = 1.0 / 65_535.0;

/// A camera shows another surface than a point if what it shows is nearer by more than this share of inverse depth, beyond what
/// a texel of a steep surface spans.
const HIDDEN: f32 = 0.02;

/// A camera that textures a frame.
pub(super) struct TextureCamera {
    picture: Arc<Picture>,
    /// Homogeneous position in the picture, pixels, of what the frame's upper left corner shows at infinity; for a pixel right and
    /// down; and for an inverse depth of 1/m.
    start: Vec3,
    right: Vec3,
    down: Vec3,
    shift: Vec3,
    /// Its focal length over the frame's.
    scale: f32,
    /// Share of inverse depth by which what it shows is nearer than a point that it does not see.
    hidden: f32,
}

impl TextureCamera {
    pub(super) fn new(camera: &RealCamera, picture: Arc<Picture>, frame: &Camera) -> Self {
        let eye_from_world = camera.pose.world_from_eye.transpose();
        let shift = camera.homogeneous(eye_from_world * (frame.eye() - camera.pose.eye));
        Self { shift: shift.as_vec3(), ..Self::turned(camera, picture, frame, eye_from_world * frame.world_from_eye()) }
    }

    /// As if the camera stood where the frame's does, and looked the same way: the picture alone, without depth.
    pub(super) fn pasted(camera: &RealCamera, picture: Arc<Picture>, frame: &Camera) -> Self {
        Self::turned(camera, picture, frame, DMat3::IDENTITY)
    }

    fn turned(camera: &RealCamera, picture: Arc<Picture>, frame: &Camera, turn: DMat3) -> Self {
        let [x, y] = frame.principal_px();
        let focal = frame.focal_px();
        let along = |direction: DVec3| camera.homogeneous(turn * direction).as_vec3();
        Self {
            picture,
            start: along(DVec3::new(-x / focal, y / focal, -1.0)),
            right: along(DVec3::X / focal),
            down: along(DVec3::NEG_Y / focal),
            shift: Vec3::ZERO,
            scale: (camera.lens.focal_px[1] / focal) as f32,
            hidden: 1.0 + HIDDEN + EdgeRule::STEEPEST / camera.lens.focal_px[1] as f32,
        }
    }

    /// Position in the picture, pixels, of what the frame shows at (x, y), pixels, and its inverse depth there; `None` behind the camera.
    #[inline(always)]
    fn locate(&self, x: f32, y: f32, inverse_depth: f32) -> Option<[f32; 3]> {
        let h = self.start + self.right * x + self.down * y + self.shift * inverse_depth;
        let per = 1.0 / h.z;
        (h.z > 0.0).then_some([h.x * per, h.y * per, inverse_depth * per])
    }

    /// The copy of its picture that is as fine as the frame there: texels for a pixel are the focal lengths' ratio over that of depths.
    #[inline]
    fn level_at(&self, x: f32, y: f32, inverse_depth: f32) -> usize {
        let depths = self.start.z + self.right.z * x + self.down.z * y + self.shift.z * inverse_depth;
        self.picture.level_for(if depths > 0.0 { self.scale / depths } else { 1.0 })
    }

    /// Linear colour, up to the largest of a texel, of a place of the frame in its picture, and whether the camera shows something nearer there.
    #[inline(always)]
    fn look(&self, level: usize, [x, y]: [f32; 2], inverse_depth: f32, slack: f32) -> Option<([f32; 3], bool)> {
        let [u, v, inverse] = self.locate(x, y, inverse_depth)?;
        let (color, shown) = self.picture.sample(level, u, v)?;
        Some((color, shown > inverse * self.hidden + slack))
    }

    /// The colour, if the camera sees the surface.
    #[inline(always)]
    fn see(&self, level: usize, at: [f32; 2], inverse_depth: f32, slack: f32) -> Option<[f32; 3]> {
        let (color, is_hidden) = self.look(level, at, inverse_depth, slack)?;
        (!is_hidden).then_some(color)
    }
}

/// Cameras whose mean a pixel shows: the fourth still takes more noise away than it blurs.
const MOST_AVERAGED: u16 = 4;

/// What colours a frame.
pub(super) struct Painter<'a> {
    pub(super) grid: &'a Grid,
    pub(super) triangles: &'a [[u32; 3]],
    /// By rank.
    pub(super) cameras: &'a [TextureCamera],
    pub(super) texturing: Texturing,
    pub(super) edge: &'a EdgeRule,
}

/// Rows of a frame.
pub(super) struct Band<'a> {
    pub(super) width: u32,
    pub(super) rows: Range<u32>,
    pub(super) colors: &'a mut [[u8; 4]],
    pub(super) coverage: &'a mut [Coverage],
}

impl Band<'_> {
    #[inline(always)]
    fn put(&mut self, x: u32, y: u32, color: [f32; 3]) {
        let i = (y - self.rows.start) as usize * self.width as usize + x as usize;
        let [r, g, b] = color.map(|c| encode_srgb(c * PER_FULL));
        self.colors[i] = [r, g, b, 255];
        self.coverage[i] = Coverage::FULL;
    }
}

/// A triangle in the frame.
struct Triangle {
    /// Columns, and rows of the band, that it may show in.
    columns: Range<u32>,
    rows: Range<u32>,
    /// Edge functions opposite each corner at the first of these pixels, for a column, for a row.
    edges: [[i64; 3]; 3],
    /// The sum of the edge functions, as an exact reciprocal would have it.
    per_area: f32,
    /// Of the corners: position, pixels; inverse depth, 1/m; rank of the camera.
    at: [[f32; 2]; 3],
    inverse_depth: [f32; 3],
    owners: [u16; 3],
}

impl Painter<'_> {
    /// Colours what the mesh covers of a band.
    pub(super) fn paint(&self, band: &mut Band) {
        if self.texturing == Texturing::Nearest {
            self.paste(band);
            return;
        }
        for corners in self.triangles {
            let Some(triangle) = self.set_up(*corners, band) else { continue };
            let surface = self.surface(&triangle, *corners);
            let [first, second, third] = triangle.edges;
            for y in triangle.rows.clone() {
                let down = i64::from(y - triangle.rows.start);
                let mut at = [first, second, third].map(|[start, _, row]| start + row * down);
                for x in triangle.columns.clone() {
                    if at[0] | at[1] | at[2] >= 0 {
                        self.pixel(&triangle, &surface, at, [x, y], band);
                    }
                    for (at, edge) in at.iter_mut().zip(&triangle.edges) {
                        *at += edge[1];
                    }
                }
            }
        }
    }

    /// The best camera's picture as it is, for comparison.
    fn paste(&self, band: &mut Band) {
        let Some(camera) = self.cameras.first() else { return };
        let level = camera.picture.level_for(camera.scale);
        for y in band.rows.clone() {
            for x in 0..band.width {
                let Some([u, v, _]) = camera.locate(x as f32 + 0.5, y as f32 + 0.5, 0.0) else { continue };
                if let Some((color, _)) = camera.picture.sample(level, u, v) {
                    band.put(x, y, color);
                }
            }
        }
    }

    #[inline]
    fn set_up(&self, corners: [u32; 3], band: &Band) -> Option<Triangle> {
        let at = corners.map(|node| [self.grid.x[node as usize], self.grid.y[node as usize]]);
        // The pixels whose centres lie within the box.
        let range = |axis: usize, low: u32, high: u32| {
            let [a, b, c] = at.map(|p| p[axis]);
            let half = SUBPIXELS / 2;
            let first = (a.min(b).min(c) + half - 1).div_euclid(SUBPIXELS).max(low as i32);
            let end = (a.max(b).max(c) - half).div_euclid(SUBPIXELS).saturating_add(1).min(high as i32);
            (first < end).then_some(first as u32..end as u32)
        };
        let rows = range(1, band.rows.start, band.rows.end)?;
        let columns = range(0, 0, band.width)?;
        let at = at.map(|p| p.map(i64::from));
        let centre =
            [columns.start, rows.start].map(|pixel| i64::from(pixel) * i64::from(SUBPIXELS) + i64::from(SUBPIXELS / 2));
        let edge = |from: [i64; 2], to: [i64; 2]| {
            let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
            // A centre on an edge belongs to the triangle whose upper or left edge it is.
            let is_theirs = !(dy < 0 || (dy == 0 && dx > 0));
            let value = dx * (centre[1] - from[1]) - dy * (centre[0] - from[0]) - i64::from(is_theirs);
            [value, -dy * i64::from(SUBPIXELS), dx * i64::from(SUBPIXELS)]
        };
        let [a, b, c] = at;
        Some(Triangle {
            columns,
            rows,
            edges: [edge(b, c), edge(c, a), edge(a, b)],
            per_area: 1.0 / doubled_area(at) as f32,
            at: at.map(|p| p.map(|part| part as f32 / SUBPIXELS as f32)),
            inverse_depth: corners.map(|node| self.grid.inverse_depth[node as usize]),
            owners: corners.map(|node| self.grid.owner[node as usize]),
        })
    }

    /// What holds for all pixels of a triangle.
    #[inline]
    fn surface(&self, triangle: &Triangle, corners: [u32; 3]) -> Surface {
        let inverse = triangle.inverse_depth;
        let length = |i: usize, j: usize| {
            let [a, b] = [corners[i], corners[j]].map(|node| node as usize);
            let [dx, dy] = [self.grid.x[a] - self.grid.x[b], self.grid.y[a] - self.grid.y[b]].map(|d| d as f32);
            (dx * dx + dy * dy).sqrt() / SUBPIXELS as f32
        };
        let (near, far) = (inverse[0].max(inverse[1]).max(inverse[2]), inverse[0].min(inverse[1]).min(inverse[2]));
        let parts = |i: usize, j: usize| self.edge.parts(inverse[i], inverse[j], length(i, j));
        let is_cut = near - far > self.edge.least() && (parts(0, 1) || parts(1, 2) || parts(2, 0));
        // Of three corners the one in the middle goes with the nearer of the others.
        let middle = (near + far) * 0.5;
        let [a, b, c] = triangle.owners;
        let best = a.min(b).min(c);
        let node = corners[0] as usize;
        let [x, y] = [self.grid.x[node], self.grid.y[node]].map(|part| part as f32 / SUBPIXELS as f32);
        let level = self.cameras.get(best as usize).map_or(0, |camera| camera.level_at(x, y, inverse[0]));
        Surface { near: inverse.map(|depth| depth > middle), is_cut, is_one: a == b && b == c, level }
    }

    #[inline(always)]
    fn pixel(&self, triangle: &Triangle, surface: &Surface, at: [i64; 3], [column, row]: [u32; 2], band: &mut Band) {
        let mut weights = at.map(|edge| edge as f32 * triangle.per_area);
        let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
        if surface.is_cut {
            weights = self.side(triangle, surface, weights, [x, y]);
        }
        let [a, b, c] = [0, 1, 2].map(|k| weights[k] * triangle.inverse_depth[k]);
        let inverse = (a + b + c) / (weights[0] + weights[1] + weights[2]);
        // Weights on the surface, not in the frame, are those times depth's share.
        let spot = Spot { triangle, weights: [a, b, c], surface, at: [x, y], inverse };
        let painted = match self.texturing {
            Texturing::Single => self.single(surface, [x, y], inverse),
            Texturing::Averaged => {
                let mean = self.averaged(surface, [x, y], inverse);
                mean.or_else(|| self.unseen(triangle, [a, b, c], surface))
            }
            Texturing::Blended if !surface.is_one => self.blended(&spot),
            _ => self.best(&spot),
        };
        if let Some(color) = painted {
            band.put(column, row, color);
        }
    }

    /// The weights of the corners of the surface that shows in a pixel of a triangle across a depth edge; 0 for the others.
    fn side(&self, triangle: &Triangle, surface: &Surface, weights: [f32; 3], at: [f32; 2]) -> [f32; 3] {
        let of_side = |near: bool| [0, 1, 2].map(|k| if surface.near[k] == near { weights[k].max(1e-6) } else { 0.0 });
        let depth = |weights: [f32; 3]| {
            let total: f32 = weights.iter().sum();
            (0..3).map(|k| weights[k] * triangle.inverse_depth[k]).sum::<f32>() / total
        };
        let (near, far) = (of_side(true), of_side(false));
        let (inverse, behind) = (depth(near), depth(far));
        let owner = (0..3).filter(|k| surface.near[*k]).map(|k| triangle.owners[k]).min();
        let camera = owner.and_then(|owner| self.cameras.get(owner as usize));
        let shown = camera.and_then(|camera| {
            let [x, y, there] = camera.locate(at[0], at[1], inverse)?;
            let (_, shown) = camera.picture.sample(0, x, y)?;
            (shown > 0.0).then_some((shown, there))
        });
        let is_near = match shown {
            Some((shown, there)) => shown > there * 0.5 * (1.0 + behind / inverse),
            None => near.iter().sum::<f32>() > far.iter().sum(),
        };
        if is_near { near } else { far }
    }

    /// The colour of the best camera alone, where it sees the surface.
    fn single(&self, surface: &Surface, at: [f32; 2], inverse: f32) -> Option<[f32; 3]> {
        self.cameras.first()?.see(surface.level, at, inverse, self.edge.least())
    }

    /// The mean colour of the best ranked cameras that see the surface, [`MOST_AVERAGED`] at most.
    #[inline(always)]
    fn averaged(&self, surface: &Surface, at: [f32; 2], inverse: f32) -> Option<[f32; 3]> {
        let (mut sum, mut count) = ([0.0; 3], 0u16);
        for camera in self.cameras {
            let Some(color) = camera.see(surface.level, at, inverse, self.edge.least()) else { continue };
            (0..3).for_each(|c| sum[c] += color[c]);
            count += 1;
            if count == MOST_AVERAGED {
                break;
            }
        }
        (count > 0).then(|| sum.map(|c| c / f32::from(count)))
    }

    /// The colour of the best ranked camera of the corners that sees the surface.
    #[inline(always)]
    fn best(&self, spot: &Spot) -> Option<[f32; 3]> {
        let Spot { triangle, weights, surface, at, inverse } = *spot;
        let mut owners = [0, 1, 2].map(|k| if weights[k] > 0.0 { triangle.owners[k] } else { u16::MAX });
        if !surface.is_one {
            owners.sort_unstable();
        }
        for (k, owner) in owners.into_iter().enumerate() {
            if k > 0 && owner == owners[k - 1] {
                continue;
            }
            let Some(camera) = self.cameras.get(owner as usize) else { continue };
            if let Some(color) = camera.see(surface.level, at, inverse, self.edge.least()) {
                return Some(color);
            }
        }
        self.unseen(triangle, weights, surface)
    }

    /// The colours of the corners themselves, by weight: of a surface that its cameras do not see here, as something hides it from them.
    #[cold]
    fn unseen(&self, triangle: &Triangle, weights: [f32; 3], surface: &Surface) -> Option<[f32; 3]> {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for k in (0..3).filter(|k| weights[*k] > 0.0) {
            let Some(camera) = self.cameras.get(triangle.owners[k] as usize) else { continue };
            let looked = camera.look(surface.level, triangle.at[k], triangle.inverse_depth[k], 0.0);
            let Some((color, _)) = looked else { continue };
            (0..3).for_each(|c| sum[c] += color[c] * weights[k]);
            total += weights[k];
        }
        (total > 0.0).then(|| sum.map(|c| c / total))
    }

    /// The colours of all cameras of the corners that see the surface, by the corners' weights.
    fn blended(&self, spot: &Spot) -> Option<[f32; 3]> {
        let Spot { triangle, weights, surface, at, inverse } = *spot;
        let owners = triangle.owners;
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for k in 0..3 {
            // The weights of corners of one camera count together, at the first of them.
            if (0..k).any(|before| owners[before] == owners[k]) {
                continue;
            }
            let weight: f32 = (k..3).filter(|j| owners[*j] == owners[k]).map(|j| weights[j].max(0.0)).sum();
            let Some(camera) = self.cameras.get(owners[k] as usize).filter(|_| weight > 0.0) else { continue };
            let Some(color) = camera.see(surface.level, at, inverse, self.edge.least()) else { continue };
            (0..3).for_each(|c| sum[c] += color[c] * weight);
            total += weight;
        }
        match total > 0.0 {
            true => Some(sum.map(|c| c / total)),
            false => self.best(spot),
        }
    }
}

/// A place on a triangle: the weights of its corners there, where it shows in the frame, pixels, and its inverse depth.
struct Spot<'a> {
    triangle: &'a Triangle,
    weights: [f32; 3],
    surface: &'a Surface,
    at: [f32; 2],
    inverse: f32,
}

/// What holds for all pixels of a triangle.
struct Surface {
    /// Which corners belong to the nearer of two surfaces.
    near: [bool; 3],
    /// Whether there are two.
    is_cut: bool,
    /// Whether one camera owns all corners.
    is_one: bool,
    /// Which copy of the pictures is as fine as the frame.
    level: usize,
}
