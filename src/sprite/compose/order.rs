//! Drawing order of sprites and cube LDIs for an eye.

use super::Layer;
use crate::{SpriteSet, SpriteWithDepth};
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_cube::pack::{CubeLdi, PackedDepthPixel, PackedSegment};

/// Positions of evenly chosen samples of a cube LDI.
pub(super) struct CubePoints {
    /// World metres.
    points: Vec<DVec3>,
}

/// Maximum number of samples of a cube LDI that are tested: enough for a sprite that covers a
/// hundredth of the view.
const POINTS: usize = 4096;

impl CubePoints {
    pub(super) fn new(cube: &CubeLdi) -> Self {
        let every = (cube.depth_pixel_count() + cube.planes.texels.len())
            .div_ceil(POINTS)
            .max(1);
        let mut count = 0;
        let mut points = Vec::with_capacity(POINTS);
        let rows = cube
            .segments
            .iter()
            .flat_map(|segment| (0..segment.height).map(move |y| (segment, y)));
        for (segment, y) in rows {
            for (x, pixel) in row_samples(segment, y) {
                if count % every == 0 {
                    let (x, y) = (
                        f64::from(segment.x0 + x) + 0.5,
                        f64::from(segment.y0 + y) + 0.5,
                    );
                    let direction = segment.face.direction(x, y, cube.face_size_px);
                    let inverse_depth = segment.inverse_depth(pixel.inverse_depth_code());
                    points.push(cube.info.centre + direction / inverse_depth);
                }
                count += 1;
            }
        }
        for (i, point) in plane_texel_centers(cube) {
            if (count + i) % every == 0 {
                points.push(point);
            }
        }
        points.retain(|point| point.is_finite());
        Self { points }
    }

    /// Returns the mean distance of the samples from an eye, metres; 0 without samples.
    fn distance(&self, eye: DVec3) -> f64 {
        self.points
            .iter()
            .map(|point| (*point - eye).length())
            .sum::<f64>()
            / self.points.len().max(1) as f64
    }

    /// Returns true if the sprite hides more samples than hide it, on sight lines from `eye`
    /// through the sprite's rectangle; `None` on a tie, for instance if neither overlaps the other.
    fn is_behind(&self, sprite: &SpriteWithDepth, eye: DVec3) -> Option<bool> {
        let (camera, plane) = (sprite.sprite().camera(), sprite.sprite().plane());
        let (width, height) = (f64::from(camera.width()), f64::from(camera.height()));
        let eye_distance = plane.signed_distance(eye);
        let mut balance = 0i64;
        for point in &self.points {
            // Intersection of the sight line with the plane, as a share of the way to the sample.
            let share = eye_distance / (eye_distance - plane.signed_distance(*point));
            if !share.is_finite() || share <= 0.0 {
                continue;
            }
            let on_plane = eye + (*point - eye) * share;
            let inside = camera
                .project(on_plane)
                .is_some_and(|[x, y, _]| (0.0..=width).contains(&x) && (0.0..=height).contains(&y));
            if inside {
                balance += if share < 1.0 { 1 } else { -1 };
            }
        }
        (balance != 0).then_some(balance > 0)
    }
}

/// Returns index and position (world metres) of the centre of each covered plane-texture texel.
fn plane_texel_centers(cube: &CubeLdi) -> impl Iterator<Item = (usize, DVec3)> {
    cube.planes.tiles.iter().flat_map(move |tile| {
        let face = Face::ALL[usize::from(tile.face) % Face::ALL.len()];
        let plane = cube
            .planes
            .planes
            .get(tile.plane as usize)
            .copied()
            .unwrap_or_default();
        let [q, along_x, along_y] = plane.inverse_depth(face, cube.face_size_px);
        let texels = cube.planes.texels.get(tile.texel_range()).unwrap_or(&[]);
        texels
            .iter()
            .enumerate()
            .filter(|(_, texel)| texel[3] > 127)
            .map(move |(i, _)| {
                let [column, row] = [i % usize::from(tile.width), i / usize::from(tile.width)];
                let x = f64::from(tile.x0) + 0.5 + column as f64;
                let y = f64::from(tile.y0) + 0.5 + row as f64;
                let direction = face.direction(x, y, cube.face_size_px);
                (
                    tile.first_texel as usize + i,
                    cube.info.centre + direction / (q + along_x * x + along_y * y),
                )
            })
    })
}

/// Returns the depth pixels of a row with their columns.
fn row_samples(
    segment: &PackedSegment,
    y: u32,
) -> impl Iterator<Item = (u32, PackedDepthPixel)> + '_ {
    (0..segment.width).flat_map(move |x| segment.pixel(x, y).iter().map(move |&pixel| (x, pixel)))
}

/// Implements [`super::Composition::back_to_front`].
pub(super) fn back_to_front(sprites: &SpriteSet, cubes: &[CubePoints], eye: DVec3) -> Vec<Layer> {
    let mut order: Vec<Layer> = sprites
        .back_to_front(eye)
        .into_iter()
        .map(Layer::Sprite)
        .collect();
    let mut by_nearness: Vec<usize> = (0..cubes.len()).collect();
    by_nearness.sort_by(|&a, &b| {
        cubes[a]
            .distance(eye)
            .total_cmp(&cubes[b].distance(eye))
            .then(b.cmp(&a))
    });
    for cube in by_nearness {
        let behind = |layer: &Layer| match layer {
            Layer::Sprite(index) => cubes[cube].is_behind(sprites.sprites()[*index].sprite(), eye),
            // Nearer cubes have been inserted already.
            Layer::Cube(_) | Layer::Polygons => Some(true),
        };
        let relations: Vec<Option<bool>> = order.iter().map(behind).collect();
        let first_before_it = relations
            .iter()
            .position(|relation| *relation == Some(true));
        let after_last_behind = relations
            .iter()
            .rposition(|relation| *relation == Some(false))
            .map(|last| last + 1);
        order.insert(
            first_before_it.or(after_last_behind).unwrap_or(0),
            Layer::Cube(cube),
        );
    }
    order
}
