//! The sun that stands in a picture of the sky: found, and taken out of the picture's light, so
//! that it lights as a sun does, with shadows whose edges are sought and never pooled.

use crate::scene::{SkyPicture, Sun};
use glam::Vec3;
use headbox_core::color::luminance;
use std::f32::consts::PI;

/// A sun shines from within this angle about the brightest texel, radians: glare that film and lens
/// spread about it is part of it.
const RADIUS_RAD: f32 = 0.05;

/// The sky beside the sun is what lies in a ring from that angle to so many times of it.
const RING: f32 = 2.0;

/// A sun is at least so many times as bright as the sky beside it.
const CONTRAST: f32 = 30.0;

/// A sun brings at least this share of all light.
const LEAST_SHARE: f32 = 0.03;

/// The cap of directions about a sun that is not in the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SunSpot {
    /// Unit vector toward its middle, world axes.
    direction: Vec3,
    /// Luminance above which light is the sun's.
    level: f32,
}

impl SunSpot {
    /// Radiance for lighting of a texel of radiance `texel` in that direction.
    pub(super) fn without(&self, texel: [f32; 3], direction: impl Fn() -> Vec3) -> [f32; 3] {
        let level = luminance(texel);
        let is_sun = level > self.level && direction().dot(self.direction) > RADIUS_RAD.cos();
        if is_sun {
            texel.map(|c| c * (self.level / level))
        } else {
            texel
        }
    }

    /// The same, where all is so many times as bright.
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
    /// The sun that stands in the picture, if one does, and the picture without its light: a spot
    /// far brighter than the sky beside it that brings a good share of all light.
    pub fn without_sun(self) -> (Self, Option<Sun>) {
        match self.find_sun() {
            Some((spot, sun)) => (self.without(spot), Some(sun)),
            None => (self, None),
        }
    }

    fn find_sun(&self) -> Option<(SunSpot, Sun)> {
        let about = self.brightest()?;
        let near = self.texels_within(RADIUS_RAD * RING, about);
        let (spot, ring): (Vec<Texel>, Vec<Texel>) = near
            .into_iter()
            .partition(|texel| texel.direction.dot(about) > RADIUS_RAD.cos());
        let mut beside: Vec<f32> = ring.iter().map(|texel| texel.luminance).collect();
        beside.sort_by(f32::total_cmp);
        let level = *beside.get(beside.len() / 2)?;
        let highest = spot.iter().map(|texel| texel.luminance).fold(0.0, f32::max);
        if highest <= CONTRAST * level {
            return None;
        }
        let sun = sun_of(&spot, level, about);
        let is_strong = luminance(sun.irradiance) >= LEAST_SHARE * self.power();
        is_strong.then_some((
            SunSpot {
                direction: about,
                level,
            },
            sun,
        ))
    }

    /// Position of the first of the brightest texels.
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

/// The sun that is as bright, as large and in the middle of what a spot has above the level of the
/// sky.
fn sun_of(spot: &[Texel], level: f32, about: Vec3) -> Sun {
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
