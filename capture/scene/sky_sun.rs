//! Extraction of the sun from a picture of the sky. As a separate light, the sun is sampled
//! directly: its shadow edges are located, and its light is not pooled.

use crate::scene::{SkyPicture, Sun};
use glam::Vec3;
use headbox_core::color::luminance;
use std::f32::consts::PI;

/// Angular radius about the brightest texel that belongs to the sun, radians: includes the glare of
/// film and lens.
const RADIUS_RAD: f32 = 0.05;

/// Outer radius of the ring of sky around the sun, as a multiple of [`RADIUS_RAD`].
const RING: f32 = 2.0;

/// Minimum ratio of the sun's luminance to that of the ring.
const CONTRAST: f32 = 30.0;

/// Minimum share of the sun in all light.
const MIN_SHARE: f32 = 0.03;

/// Cap of directions about a sun whose light is removed from the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SunSpot {
    /// Unit vector toward the middle of the cap, world axes.
    direction: Vec3,
    /// Luminance of the surrounding sky; light above it belongs to the sun.
    level: f32,
}

impl SunSpot {
    /// Returns the radiance `texel` of a texel without the sun's share.
    pub(super) fn remove_from(&self, texel: [f32; 3], direction: impl Fn() -> Vec3) -> [f32; 3] {
        let level = luminance(texel);
        let is_sun = level > self.level && direction().dot(self.direction) > RADIUS_RAD.cos();
        if is_sun {
            texel.map(|c| c * (self.level / level))
        } else {
            texel
        }
    }

    /// Returns the spot of a picture whose radiance is multiplied by `factor`.
    pub(super) fn times(self, factor: f32) -> Self {
        Self {
            level: self.level * factor,
            ..self
        }
    }
}

/// A texel of the picture.
struct Texel {
    direction: Vec3,
    radiance: Vec3,
    luminance: f32,
    solid_angle: f32,
}

impl SkyPicture {
    /// Separates the sun from the picture's light, if it has one: a spot far brighter than the sky
    /// around it, with a substantial share of all light.
    pub fn without_sun(self) -> (Self, Option<Sun>) {
        match self.find_sun() {
            Some((spot, sun)) => (self.without_light_of(spot), Some(sun)),
            None => (self, None),
        }
    }

    fn find_sun(&self) -> Option<(SunSpot, Sun)> {
        let about = self.brightest()?;
        let near = self.texels_within(RADIUS_RAD * RING, about);
        let (spot, ring): (Vec<Texel>, Vec<Texel>) = near
            .into_iter()
            .partition(|texel| texel.direction.dot(about) > RADIUS_RAD.cos());
        let mut levels: Vec<f32> = ring.iter().map(|texel| texel.luminance).collect();
        levels.sort_by(f32::total_cmp);
        let level = *levels.get(levels.len() / 2)?;
        let highest = spot.iter().map(|texel| texel.luminance).fold(0.0, f32::max);
        if highest <= CONTRAST * level {
            return None;
        }
        let sun = fit_sun(&spot, level, about);
        let is_strong = luminance(sun.irradiance) >= MIN_SHARE * self.power();
        is_strong.then_some((
            SunSpot {
                direction: about,
                level,
            },
            sun,
        ))
    }

    /// Unit direction of the brightest texel, the first of several.
    fn brightest(&self) -> Option<Vec3> {
        let level = |at: usize| luminance(self.texels()[at]);
        let at = (0..self.texels().len())
            .max_by(|&a, &b| level(a).total_cmp(&level(b)).then(b.cmp(&a)))?
            as u32;
        let [width, _] = self.size();
        Some(self.direction([(at % width) as f32 + 0.5, (at / width) as f32 + 0.5]))
    }

    fn texels_within(&self, angle_rad: f32, about: Vec3) -> Vec<Texel> {
        let [width, height] = self.size();
        let (polar, row_rad) = (about.y.clamp(-1.0, 1.0).acos(), PI / height as f32);
        let rows = (0..height)
            .filter(|&y| ((y as f32 + 0.5) * row_rad - polar).abs() <= angle_rad + row_rad);
        let texel = |(x, y): (u32, u32)| {
            let radiance = self.texel(x, y);
            Texel {
                direction: self.direction([x as f32 + 0.5, y as f32 + 0.5]),
                radiance: radiance.into(),
                luminance: luminance(radiance),
                solid_angle: self.solid_angle(y) as f32,
            }
        };
        let texels = rows.flat_map(|y| (0..width).map(move |x| texel((x, y))));
        texels
            .filter(|texel| texel.direction.dot(about) > angle_rad.cos())
            .collect()
    }
}

/// Fits a sun to the light of a spot above the level of the sky: the same irradiance, centre and
/// mean squared radius.
fn fit_sun(spot: &[Texel], level: f32, about: Vec3) -> Sun {
    let excess = |texel: &Texel| (texel.luminance - level).max(0.0) * texel.solid_angle;
    let (mut toward, mut irradiance, mut power) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for texel in spot.iter().filter(|texel| texel.luminance > level) {
        let excess = excess(texel);
        toward += texel.direction * excess;
        irradiance += texel.radiance * (excess / texel.luminance);
        power += excess;
    }
    let direction = toward.normalize_or(about);
    let spread: f32 = spot
        .iter()
        .map(|texel| excess(texel) * texel.direction.distance_squared(direction))
        .sum();
    // The mean squared distance of a disk's points from its middle is half of its squared radius.
    let radius = (2.0 * spread / power.max(f32::MIN_POSITIVE)).sqrt();
    let angular_radius_rad = radius.clamp(Sun::default().angular_radius_rad, RADIUS_RAD);
    Sun {
        direction,
        irradiance: irradiance.to_array(),
        angular_radius_rad,
    }
}
