//! Sprite with depth behind a portal, if the view there is smooth enough for one (S1, S5; R2).

use super::BackdropQuality;
use crate::house::House;
use crate::portal_opening::Opening;
use glam::{DVec3, Vec3};
use headbox_core::camera::{Camera, fov_deg};
use headbox_core::depth_kind::DepthKind;
use headbox_core::frame::{Coverage, Frame};
use headbox_sprite::{
    DepthImport, DisplacementFormat, PreparedSprite, RenderOptions, SpriteError, SpriteLayer,
    SpriteRenderer, SpriteWithDepth,
};
use headbox_trace::bvh::Ray;
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

/// Displacements of the eye for which disocclusion is measured, metres: horizontal and vertical.
const STEP_M: [f64; 2] = [0.5, 0.1];

/// Largest disoccluded share of the sprite for which the view counts as smooth.
const SMOOTH_SHARE: f64 = 0.03;

/// Largest parallax against the sprite's plane, for the horizontal step, that two passes draw well:
/// root mean square over the focal length (S1: the step times the spread of inverse depth).
const MAX_PARALLAX: f64 = 0.04;

/// Distance behind the portal's plane within which surfaces belong to the door frame and are not
/// tested, metres.
const REVEAL_M: f32 = 0.3;

/// Distance of the sprite's eye from the portal, as a share of half of its longer side: so near
/// that it also covers oblique views of a farther eye.
const EYE_DISTANCE: f64 = 0.75;

/// Number of rays along each side of a pixel.
const RAYS_PER_SIDE: u32 = 2;

/// Depth of the sky, metres: for a horizontal step it moves by a hundredth of a pixel.
const SKY_M: f32 = 1e5;

/// Sprite of the view through an opening.
#[derive(Clone, Debug)]
pub struct PortalSprite {
    prepared: PreparedSprite,
}

impl PartialEq for PortalSprite {
    fn eq(&self, other: &Self) -> bool {
        self.sprite() == other.sprite()
    }
}

/// Pixel of a captured sprite.
struct Pixel {
    color: [u8; 4],
    /// Eye depth, metres; NaN outside the opening.
    depth: f32,
    /// Distance from the portal's plane, metres.
    behind_m: f32,
}

impl PortalSprite {
    /// Prepares a sprite for drawing.
    pub(crate) fn new(sprite: SpriteWithDepth) -> Self {
        Self {
            prepared: PreparedSprite::new(sprite),
        }
    }

    /// The sprite.
    pub fn sprite(&self) -> &SpriteWithDepth {
        self.prepared.sprite()
    }

    /// Captures the view through an opening from straight in front; `None` if it is not smooth, or
    /// too deep for an image on a plane.
    pub(super) fn capture(
        house: &House,
        opening: &Opening,
        quality: &BackdropQuality,
    ) -> Result<Option<Self>, SpriteError> {
        let place = opening.centre + opening.normal * (opening.half.max_element() * EYE_DISTANCE);
        // The same resolution in the middle as a texture.
        let Some(camera) = camera(opening, place, 2 * quality.texture_px) else {
            return Ok(None);
        };
        let row = |y: u32| {
            (0..camera.width())
                .map(move |x| trace_pixel(house, opening, &camera, [x, y]))
                .collect::<Vec<_>>()
        };
        let rows: Vec<Vec<Pixel>> = (0..camera.height()).into_par_iter().map(row).collect();
        let pixels = || rows.iter().flatten();
        let depth: Vec<f32> = pixels().map(|pixel| pixel.depth).collect();
        let tested_depth = |pixel: &Pixel| {
            if pixel.behind_m > REVEAL_M {
                pixel.depth
            } else {
                f32::NAN
            }
        };
        let tested: Vec<f32> = pixels().map(tested_depth).collect();
        if tested.iter().all(|depth| depth.is_nan())
            || disoccluded_share(&camera, &tested) > SMOOTH_SHARE
        {
            return Ok(None);
        }
        let color = RgbaImage::from_fn(camera.width(), camera.height(), |x, y| {
            Rgba(rows[y as usize][x as usize].color)
        });
        let import = DepthImport {
            color,
            camera,
            depth: &depth,
            depth_kind: DepthKind::EyeDepth,
            window_range_m: (0.0, 0.0),
            plane: None,
            format: DisplacementFormat::I16,
        };
        let sprite = import.build()?;
        Ok((parallax(&sprite, &tested) <= MAX_PARALLAX).then(|| Self::new(sprite)))
    }

    /// Returns the approximate size in memory, bytes.
    pub(super) fn bytes(&self) -> u64 {
        12 * self.sample_count()
    }

    /// Returns the number of pixels.
    pub(super) fn sample_count(&self) -> u64 {
        let (width, height) = self.sprite().sprite().color().dimensions();
        u64::from(width) * u64::from(height)
    }
}

/// Renderer of sprites with its buffers.
#[derive(Default)]
pub(super) struct SpriteDrawer {
    renderer: SpriteRenderer,
    drawn: SpriteLayer,
}

impl SpriteDrawer {
    /// Draws a sprite into a frame of the camera's size that consists of holes; pixels that it does
    /// not cover remain holes.
    pub(super) fn draw(&mut self, sprite: &PortalSprite, camera: &Camera, frame: &mut Frame) {
        self.renderer.render(
            &sprite.prepared,
            camera,
            &RenderOptions::default(),
            &mut self.drawn,
        );
        let pixels = frame
            .color
            .iter_mut()
            .zip(&mut frame.coverage)
            .zip(self.drawn.pixels());
        for ((color, coverage), &[r, g, b, alpha]) in pixels {
            // Un-premultiplies the colour: partly covered border pixels become opaque.
            if alpha >= 32 {
                let whole = u32::from(alpha);
                let straight = |c: u8| ((u32::from(c) * 255 + whole / 2) / whole).min(255) as u8;
                (*color, *coverage) =
                    ([straight(r), straight(g), straight(b), 255], Coverage::FULL);
            }
        }
    }
}

/// Returns a camera at `place` that covers the whole opening; the longer side of its image is
/// `texture_px`.
fn camera(opening: &Opening, place: DVec3, texture_px: u32) -> Option<Camera> {
    let up = opening.up;
    let probe = Camera::look_at(place, opening.centre, up, 90.0, [2, 2]).ok()?;
    // The focal length is 1 px, so that positions are tangents.
    let tangent = opening
        .corners
        .iter()
        .try_fold([0.0f64; 2], |[x, y], corner| {
            let [px, py, _] = probe.project(*corner)?;
            Some([x.max((px - 1.0).abs()), y.max((py - 1.0).abs())])
        })?;
    let largest = tangent[0].max(tangent[1]);
    let [width, height] =
        tangent.map(|t| ((t / largest * f64::from(texture_px)).ceil() as u32).max(2));
    let fov_y_deg = fov_deg(2.0 * largest * f64::from(height), f64::from(texture_px));
    Camera::look_at(place, opening.centre, up, fov_y_deg, [width, height]).ok()
}

/// Traces a pixel: mean radiance of the rays that pass the opening, and depth of the ray through
/// its centre.
fn trace_pixel(house: &House, opening: &Opening, camera: &Camera, [x, y]: [u32; 2]) -> Pixel {
    let (mut sum, mut hits, mut nearest) = (Vec3::ZERO, 0u32, f32::NAN);
    for i in 0..RAYS_PER_SIDE * RAYS_PER_SIDE {
        let at =
            |pixel: u32, k: u32| f64::from(pixel) + (f64::from(k) + 0.5) / f64::from(RAYS_PER_SIDE);
        let direction = camera.direction(at(x, i % RAYS_PER_SIDE), at(y, i / RAYS_PER_SIDE));
        let Some((color, depth)) = radiance(house, opening, camera.eye(), direction) else {
            continue;
        };
        sum += color;
        hits += 1;
        nearest = nearest.min(depth);
    }
    if hits == 0 {
        return Pixel {
            color: [0; 4],
            depth: f32::NAN,
            behind_m: 0.0,
        };
    }
    let middle = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let depth = radiance(house, opening, camera.eye(), middle).map_or(nearest, |(_, depth)| depth);
    let [r, g, b] = house.lighting().tone.levels(sum / hits as f32);
    // Directions have eye depth 1: distance along the normal per metre of depth.
    let toward = -opening.normal.dot(middle);
    let behind_m = (f64::from(depth) * toward - opening.distance_in_front(camera.eye())) as f32;
    Pixel {
        color: [r, g, b, 255],
        depth,
        behind_m,
    }
}

/// Returns radiance and eye depth of a ray's hit behind the opening (directions have eye depth 1);
/// `None` if the ray misses the opening.
fn radiance(
    house: &House,
    opening: &Opening,
    place: DVec3,
    direction: DVec3,
) -> Option<(Vec3, f32)> {
    let toward = -opening.normal.dot(direction);
    if toward <= 1e-9 {
        return None;
    }
    let start = opening.distance_in_front(place) / toward;
    let at = place + direction * start;
    if !opening.contains(at) {
        return None;
    }
    let ray = Ray {
        origin: (at - house.tracer().origin()).as_vec3(),
        direction: direction.as_vec3(),
        t_min: 0.0,
        t_max: f32::INFINITY,
    };
    let (radiance, distance) = house.radiance(&ray);
    Some((radiance, distance.map_or(SKY_M, |t| start as f32 + t)))
}

/// Returns the share of the image that the horizontal and vertical step disocclude: gaps between
/// neighbours that move apart by more than a pixel, along rows and columns.
fn disoccluded_share(camera: &Camera, depth: &[f32]) -> f64 {
    let width = camera.width() as usize;
    let inverse = |i: usize| {
        depth
            .get(i)
            .filter(|depth| depth.is_finite())
            .map(|&depth| 1.0 / f64::from(depth))
    };
    let gap = |a: usize, b: usize, step: f64| match (inverse(a), inverse(b)) {
        (Some(a), Some(b)) => ((a - b).abs() * camera.focal_px() * step - 1.0).max(0.0),
        _ => 0.0,
    };
    let horizontal: f64 = (0..depth.len())
        .filter(|i| i % width + 1 < width)
        .map(|i| gap(i, i + 1, STEP_M[0]))
        .sum();
    let vertical: f64 = (0..depth.len().saturating_sub(width))
        .map(|i| gap(i, i + width, STEP_M[1]))
        .sum();
    let known = depth.iter().filter(|depth| depth.is_finite()).count();
    (horizontal + vertical) / known.max(1) as f64
}

/// Returns the root mean square parallax against the sprite's plane for the horizontal step, over
/// the focal length.
fn parallax(sprite: &SpriteWithDepth, depth: &[f32]) -> f64 {
    let (camera, plane) = (sprite.sprite().camera(), sprite.sprite().plane());
    let columns = camera.width() as usize;
    let known = || {
        depth
            .iter()
            .enumerate()
            .filter(|(_, depth)| depth.is_finite())
    };
    let squares = known().map(|(i, &depth)| {
        let on_plane = plane.inverse_depth(
            camera,
            (i % columns) as f64 + 0.5,
            (i / columns) as f64 + 0.5,
        );
        (1.0 / f64::from(depth) - on_plane).powi(2)
    });
    (squares.sum::<f64>() / known().count().max(1) as f64).sqrt() * STEP_M[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_smooth_and_steps_are_not() {
        let camera =
            Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [64, 48]).expect("valid");
        let depth = |of: &dyn Fn(f32, f32) -> f32| -> Vec<f32> {
            (0..64 * 48)
                .map(|i| of((i % 64) as f32, (i / 64) as f32))
                .collect()
        };
        let wall = depth(&|x, _| 1.0 / (0.2 + x * 0.005));
        assert_eq!(disoccluded_share(&camera, &wall), 0.0);
        // A post 2 m away before a wall 8 m away: both of its sides uncover f * 0.5 * (1/2 - 1/8)
        // px of each row, less one.
        let post = depth(&|x, _| if (20.0..30.0).contains(&x) { 2.0 } else { 8.0 });
        let expected = 2.0 * (camera.focal_px() * 0.5 * 0.375 - 1.0) / 64.0;
        assert!((disoccluded_share(&camera, &post) - expected).abs() < 1e-6);
        assert_eq!(disoccluded_share(&camera, &[f32::NAN; 64 * 48]), 0.0);
    }
}
