//! Conversion of sprites with depth to a cube LDI about their common eye, for exports of cubes.

use super::ExportError;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes as primitives;
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_sprite::{SpriteSet, SpriteWithDepth};
use rayon::prelude::*;

/// Half of the headbox's edge over the distance of the nearest surface: sprites only know surfaces
/// from about one side.
const HEADBOX_SHARE: f64 = 0.15;
/// Maximum size of a face, px.
const MAX_FACE_PX: u32 = 2048;
/// Eyes nearer than this share of half the headbox's edge count as one.
const SAME_EYE: f64 = 1e-5;

/// Chooses half of the edge of a headbox for sprites, metres.
///
/// # Errors
/// [`ExportError::Empty`] if there is no surface before the eye.
pub(super) fn half_size_m(set: &SpriteSet) -> Result<f64, ExportError> {
    let depths = set
        .sprites()
        .iter()
        .flat_map(|sprite| SpriteSampler::new(sprite.sprite()).inverse_depths);
    match depths.fold(0.0, f64::max) {
        highest if highest > 0.0 => Ok(HEADBOX_SHARE / highest),
        _ => Err(ExportError::Empty),
    }
}

/// Converts sprites to a cube LDI.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Eyes`] if sprites were taken from several places,
/// [`ExportError::Pack`].
pub fn cube(set: &SpriteSet) -> Result<CubeLdi, ExportError> {
    let views: Vec<SpriteSampler> = set
        .sprites()
        .iter()
        .map(|sprite| SpriteSampler::new(sprite.sprite()))
        .collect();
    let first = views.first().ok_or(ExportError::Empty)?;
    let half_size_m = half_size_m(set)?;
    let centre = first.camera.eye();
    if views
        .iter()
        .any(|view| (view.camera.eye() - centre).length() > SAME_EYE * half_size_m)
    {
        return Err(ExportError::Eyes);
    }
    // A pixel at a face's centre is as wide as a pixel of the sharpest image.
    let focal_px = views
        .iter()
        .map(|view| view.camera.focal_px())
        .fold(1.0, f64::max);
    let face_px = ((2.0 * focal_px).ceil() as u32).clamp(16, MAX_FACE_PX);
    let faces: Vec<LayeredDepthImage> = Face::ALL
        .into_par_iter()
        .map(|face| sample_face(&views, face, face_px))
        .collect();
    let info = CaptureInfo {
        scene: set.info.source.clone(),
        centre,
        half_size_m,
        frame: set.info.frame,
        exposure: 1.0,
        tone: set.info.light.tone,
        light: set.info.light.clone(),
        ahead: Some(first.camera.forward()),
        ..CaptureInfo::default()
    };
    let ldi = CubeSamples {
        info,
        faces,
        environment: set.environment.clone(),
    };
    Ok(primitives::pack(
        ldi,
        SplatIndexLayout::Normal,
        Split::Auto,
        DEFAULT_ERROR_PX,
    )?)
}

/// Sprite, and inverse eye depth at its displacements, 1/m; 0 where it is transparent.
struct SpriteSampler<'a> {
    sprite: &'a SpriteWithDepth,
    camera: &'a Camera,
    inverse_depths: Vec<f64>,
}

impl<'a> SpriteSampler<'a> {
    fn new(sprite: &'a SpriteWithDepth) -> Self {
        let (columns, rows) = sprite.displacement().size();
        let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        let inverse_depths = cells
            .map(|(x, y)| sprite.eye_depth(x, y).map_or(0.0, |depth| 1.0 / depth))
            .collect();
        Self {
            sprite,
            camera: sprite.sprite().camera(),
            inverse_depths,
        }
    }

    /// Samples the sprite in a direction from the eye.
    fn sample(&self, face: Face, direction: DVec3) -> Option<DepthPixel> {
        let [x, y, _] = self.camera.project(self.camera.eye() + direction)?;
        let color_srgb = self.color(x, y)?;
        let (columns, rows) = self.sprite.displacement().size();
        let column = (x * f64::from(columns) / f64::from(self.camera.width())) as u32;
        let row = (y * f64::from(rows) / f64::from(self.camera.height())) as u32;
        let q = self.inverse_depth(column, row)?;
        let point = self.camera.direction(x, y) / q;
        let eye_depth = point.dot(face.normal());
        let normal = EncodedNormal::new(
            self.normal(column, row, q, self.camera.direction(x, y))
                .as_vec3(),
        );
        (eye_depth > 0.0).then(|| DepthPixel {
            inverse_depth: (1.0 / eye_depth) as f32,
            normal,
            color_srgb,
        })
    }

    /// Interpolates the colour bilinearly, straight alpha.
    fn color(&self, x: f64, y: f64) -> Option<[u8; 4]> {
        let picture = self.sprite.sprite().color();
        let (width, height) = picture.dimensions();
        if !(0.0..f64::from(width)).contains(&x) || !(0.0..f64::from(height)).contains(&y) {
            return None;
        }
        let [(left, u), (top, v)] = [x - 0.5, y - 0.5].map(|c| (c.floor(), c - c.floor()));
        let mut sum = [0.0; 4];
        for (dx, dy, weight) in [
            (0.0, 0.0, (1.0 - u) * (1.0 - v)),
            (1.0, 0.0, u * (1.0 - v)),
            (0.0, 1.0, (1.0 - u) * v),
            (1.0, 1.0, u * v),
        ] {
            let clamp = |c: f64, side: u32| c.clamp(0.0, f64::from(side - 1)) as u32;
            let [r, g, b, a] = picture
                .get_pixel(clamp(left + dx, width), clamp(top + dy, height))
                .0
                .map(f64::from);
            [r * a, g * a, b * a, a]
                .into_iter()
                .zip(&mut sum)
                .for_each(|(c, sum)| *sum += weight * c);
        }
        let [r, g, b, alpha] = sum;
        (alpha >= 0.5).then(|| [r / alpha, g / alpha, b / alpha, alpha].map(|c| c.round() as u8))
    }

    fn inverse_depth(&self, column: u32, row: u32) -> Option<f64> {
        let (columns, rows) = self.sprite.displacement().size();
        let at = row as usize * columns as usize + column as usize;
        self.inverse_depths
            .get(at)
            .copied()
            .filter(|q| *q > 0.0 && column < columns && row < rows)
    }

    /// Estimates the normal of the surface at a displacement, toward the eye: where inverse depth
    /// changes by `a` and `b` a pixel to the right and below, the plane is (a f, -b f, ...) in the
    /// camera's axes, and `n . ray` is proportional to inverse depth.
    fn normal(&self, column: u32, row: u32, q: f64, ray: DVec3) -> DVec3 {
        // At a depth edge, the side that changes less belongs to the same surface.
        let change = |before: Option<f64>, after: Option<f64>| {
            let steps = [
                before.map(|before| q - before),
                after.map(|after| after - q),
            ];
            steps
                .into_iter()
                .flatten()
                .min_by(|a, b| a.abs().total_cmp(&b.abs()))
                .unwrap_or(0.0)
        };
        let at = |dx: i64, dy: i64| {
            let offset = |c: u32, d: i64| u32::try_from(i64::from(c) + d).ok();
            self.inverse_depth(offset(column, dx)?, offset(row, dy)?)
        };
        let (columns, rows) = self.sprite.displacement().size();
        let per_radian = [
            f64::from(columns) / f64::from(self.camera.width()),
            f64::from(rows) / f64::from(self.camera.height()),
        ]
        .map(|cells_a_px| cells_a_px * self.camera.focal_px());
        let a = change(at(-1, 0), at(1, 0)) * per_radian[0];
        let b = -change(at(0, -1), at(0, 1)) * per_radian[1];
        let axes = self.camera.world_from_eye();
        let in_eye = axes.transpose() * ray;
        -(axes * DVec3::new(a, b, a * in_eye.x + b * in_eye.y - q)).normalize_or(-ray)
    }
}

fn sample_face(views: &[SpriteSampler], face: Face, face_px: u32) -> LayeredDepthImage {
    let mut image = LayeredDepthImage::empty(face, face_px);
    for at in 0..face_px * face_px {
        let direction = face.direction(
            f64::from(at % face_px) + 0.5,
            f64::from(at / face_px) + 0.5,
            face_px,
        );
        let first = image.samples.len();
        image
            .samples
            .extend(views.iter().filter_map(|view| view.sample(face, direction)));
        image.samples[first..].sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
        image.offsets[at as usize + 1] = image.samples.len() as u32;
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_cube::render::Renderer;
    use headbox_sprite::{
        Displacement, RenderOptions, Sprite, SpriteLayer, SpritePlane, SpriteRenderer,
    };
    use image::RgbaImage;

    /// A slanted wall with a pattern, behind a smaller board that faces the eye.
    fn set() -> SpriteSet {
        let camera = Camera::look_at(
            DVec3::new(1.0, 2.0, 3.0),
            DVec3::new(1.2, 2.0, -1.0),
            DVec3::Y,
            60.0,
            [160, 120],
        );
        let camera = camera.unwrap();
        let sprite = |plane: SpritePlane, color: &dyn Fn(u32, u32) -> [u8; 4]| {
            let color = RgbaImage::from_fn(160, 120, |x, y| image::Rgba(color(x, y)));
            SpriteWithDepth::new(
                Sprite::new(color, camera, plane).unwrap(),
                Displacement::zero(160, 120),
            )
            .unwrap()
        };
        let wall = SpritePlane::through(
            DVec3::new(1.0, 2.0, -2.0),
            DVec3::new(0.4, 0.1, 1.0).normalize(),
        );
        let board = SpritePlane::parallel_to_image(&camera, 3.0);
        SpriteSet::new(vec![
            sprite(wall, &|x, y| [(x * 3 / 2) as u8, (y * 2) as u8, 90, 255]),
            sprite(board, &|x, y| {
                [
                    200,
                    180,
                    40,
                    if (60..100).contains(&x) && (40..80).contains(&y) {
                        255
                    } else {
                        0
                    },
                ]
            }),
        ])
    }

    #[test]
    fn cube_matches_sprites() {
        let set = set();
        let cube = cube(&set).unwrap();
        assert!(!cube.planes.tiles.is_empty());
        let camera = set.sprites()[0].sprite().sprite().camera();
        let aside = camera.world_from_eye().x_axis * cube.info.half_size_m * 0.8;
        for eye in [camera.eye(), camera.eye() + aside] {
            let camera = Camera::look_at(
                eye,
                eye + camera.forward() + aside * 0.1,
                DVec3::Y,
                45.0,
                [120, 90],
            )
            .unwrap();
            let mut expected = SpriteLayer::default();
            set.render(
                &mut SpriteRenderer::default(),
                &camera,
                &RenderOptions::default(),
                &mut expected,
            );
            let expected = expected.to_rgb([0; 3]);
            let mut renderer = Renderer::new();
            let found = renderer
                .render(&cube, &camera, &Default::default())
                .to_rgb()
                .unwrap();
            let (mut off, mut count) = (0, 0);
            for (x, y, pixel) in found.enumerate_pixels() {
                let most = (0..3)
                    .map(|i| pixel.0[i].abs_diff(expected.get_pixel(x, y).0[i]))
                    .max()
                    .unwrap_or(0);
                // The pattern changes by 2 levels a pixel; rims of the board are elsewhere by less
                // than one.
                off += u32::from(most > 6);
                count += 1;
            }
            assert!(off * 20 < count, "{off} of {count}");
        }
    }

    #[test]
    fn several_eyes_and_none_are_refused() {
        assert!(matches!(
            cube(&SpriteSet::new(Vec::new())),
            Err(ExportError::Empty)
        ));
        let (mut here, mut there) = (set(), set());
        let sprite = there.sprites()[0].sprite().sprite();
        let camera = sprite.camera().with_eye(DVec3::new(1.5, 2.0, 3.0));
        let moved = Sprite::new(sprite.color().clone(), camera, *sprite.plane()).unwrap();
        there = SpriteSet::new(vec![
            SpriteWithDepth::new(moved, Displacement::zero(160, 120)).unwrap(),
        ]);
        here.append(there);
        assert!(matches!(cube(&here), Err(ExportError::Eyes)));
    }
}
