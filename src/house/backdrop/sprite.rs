//! A sprite with depth behind a portal, where what lies behind is smooth enough for one (S1, S5;
//! R2).

use super::BackdropQuality;
use crate::house::House;
use crate::opening::Opening;
use glam::{DVec3, Vec3};
use headbox_core::camera::{Camera, fov_deg};
use headbox_core::color::srgb8_from_linear;
use headbox_core::depth_kind::DepthKind;
use headbox_core::frame::{Coverage, Frame};
use headbox_sprite::{
    DepthImport, DisplacementFormat, PreparedSprite, RenderOptions, SpriteError, SpriteLayer,
    SpriteRenderer, SpriteWithDepth,
};
use headbox_trace::bvh::Ray;
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

/// Displacements of the eye for which disocclusion is measured, metres: a step to the side, and a
/// nod.
const STEP_M: [f64; 2] = [0.5, 0.1];

/// Largest disoccluded share of the sprite for which the view counts as smooth.
const SMOOTH_SHARE: f64 = 0.03;

/// Largest parallax against the sprite's plane, for a step to the side, that two passes draw well:
/// root mean square over the focal length (S1: the step times the spread of inverse depth).
const MOST_PARALLAX: f64 = 0.04;

/// Depth behind the portal's plane up to which surfaces are its own frame and are ignored, metres.
const REVEAL_M: f32 = 0.3;

/// Distance of the sprite's eye from the portal over half of its longer side: so near, it sees what
/// an eye farther away sees from the side, too.
const PLACE: f64 = 0.75;

/// Rays a side of each pixel.
const RAYS_A_SIDE: u32 = 2;

/// Depth of the sky, metres: at a step to the side it moves by a hundredth of a pixel.
const SKY_M: f32 = 1e5;

/// A sprite of what is seen through an opening from one place.
#[derive(Clone, Debug)]
pub struct PortalSprite {
    prepared: PreparedSprite,
}

impl PartialEq for PortalSprite {
    fn eq(&self, other: &Self) -> bool {
        self.sprite() == other.sprite()
    }
}

/// Surface seen by a ray of a pixel.
struct Pixel {
    color: [u8; 4],
    /// Eye depth, metres; NaN outside of the opening.
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

    /// Captures what shows through an opening from straight in front; `None` if it is not smooth,
    /// or so deep that a picture on a plane is a poor stand-in.
    pub(super) fn capture(
        house: &House,
        opening: &Opening,
        quality: &BackdropQuality,
    ) -> Result<Option<Self>, SpriteError> {
        let place = opening.centre + opening.normal * (opening.half.max_element() * PLACE);
        // As fine in the middle as a texture is.
        let Some(camera) = camera(opening, place, 2 * quality.texture_px) else {
            return Ok(None);
        };
        let row = |y: u32| {
            (0..camera.width())
                .map(move |x| pixel(house, opening, &camera, [x, y]))
                .collect::<Vec<_>>()
        };
        let rows: Vec<Vec<Pixel>> = (0..camera.height()).into_par_iter().map(row).collect();
        let depth: Vec<f32> = rows.iter().flatten().map(|pixel| pixel.depth).collect();
        let beyond = |pixel: &Pixel| {
            if pixel.behind_m > REVEAL_M {
                pixel.depth
            } else {
                f32::NAN
            }
        };
        let judged: Vec<f32> = rows.iter().flatten().map(beyond).collect();
        if judged.iter().all(|depth| depth.is_nan())
            || disoccluded_share(&camera, &judged) > SMOOTH_SHARE
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
        Ok((parallax(&sprite, &judged) <= MOST_PARALLAX).then(|| Self::new(sprite)))
    }

    /// Bytes in memory, near enough.
    pub(super) fn bytes(&self) -> u64 {
        12 * self.sample_count()
    }

    /// Pixels.
    pub(super) fn sample_count(&self) -> u64 {
        let (width, height) = self.sprite().sprite().color().dimensions();
        u64::from(width) * u64::from(height)
    }
}

/// The buffers that drawing sprites needs.
#[derive(Default)]
pub(super) struct SpriteDrawer {
    renderer: SpriteRenderer,
    drawn: SpriteLayer,
}

impl SpriteDrawer {
    /// Draws a sprite on a frame of the camera's size, which is all holes; pixels that it leaves
    /// open stay holes.
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
            // Premultiplied; what a border's pixel lacks is more of the same.
            if alpha >= 32 {
                let whole = u32::from(alpha);
                let straight = |c: u8| ((u32::from(c) * 255 + whole / 2) / whole).min(255) as u8;
                (*color, *coverage) =
                    ([straight(r), straight(g), straight(b), 255], Coverage::FULL);
            }
        }
    }
}

/// A camera at a place that sees the whole opening, which is `texture_px` pixels wide or high or
/// fewer in it.
fn camera(opening: &Opening, place: DVec3, texture_px: u32) -> Option<Camera> {
    let up = opening.up;
    let probe = Camera::look_at(place, opening.centre, up, 90.0, [2, 2]).ok()?;
    // With this focal length of 1 px, positions are tangents.
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

/// The mean of a pixel's rays that pass the opening, and the depth along its middle.
fn pixel(house: &House, opening: &Opening, camera: &Camera, [x, y]: [u32; 2]) -> Pixel {
    let (mut sum, mut hits, mut nearest) = (Vec3::ZERO, 0u32, f32::NAN);
    for i in 0..RAYS_A_SIDE * RAYS_A_SIDE {
        let at =
            |pixel: u32, k: u32| f64::from(pixel) + (f64::from(k) + 0.5) / f64::from(RAYS_A_SIDE);
        let direction = camera.direction(at(x, i % RAYS_A_SIDE), at(y, i / RAYS_A_SIDE));
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
    let [r, g, b] = (sum / hits as f32).to_array().map(srgb8_from_linear);
    // Directions have an eye depth of 1: so many metres of depth make this way along the normal.
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
    let lighting = house.lighting();
    Some(match house.tracer().closest(&ray) {
        Some(hit) => (house.surface(&ray, &hit).0, start as f32 + hit.t),
        None => {
            let light = Vec3::from(lighting.miss_radiance(ray.direction.normalize_or_zero()))
                * lighting.exposure;
            (light, SKY_M)
        }
    })
}

/// The share of the picture that a step to the side and a nod uncover: gaps between neighbours that
/// move apart by more than a pixel, counted along rows and columns.
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
    let along = (0..depth.len())
        .filter(|i| i % width + 1 < width)
        .map(|i| gap(i, i + 1, STEP_M[0]))
        .sum::<f64>();
    let across = (0..depth.len().saturating_sub(width))
        .map(|i| gap(i, i + width, STEP_M[1]))
        .sum::<f64>();
    let known = depth.iter().filter(|depth| depth.is_finite()).count();
    (along + across) / known.max(1) as f64
}

/// Root mean square parallax against the sprite's plane for a step to the side, over the focal
/// length.
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
