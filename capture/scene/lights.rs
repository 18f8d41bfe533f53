//! Light sources of a scene other than its emissive triangles.

use crate::scene::SkyPicture;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// The sun: a disk at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector toward the sun, world axes.
    pub direction: Vec3,
    /// Irradiance on a surface facing the sun, linear RGB.
    pub irradiance: [f32; 3],
    /// Angular radius of the disk, radians.
    pub angular_radius_rad: f32,
}

impl Default for Sun {
    /// Sun of a clear day at middle latitudes, about 50 degrees above the horizon.
    fn default() -> Self {
        Self {
            direction: Vec3::new(0.45, 0.75, 0.35).normalize(),
            irradiance: [3.2, 3.0, 2.7],
            angular_radius_rad: 0.00465,
        }
    }
}

/// The sky: linear RGB radiance by direction.
#[derive(Clone, Debug, PartialEq)]
pub enum Sky {
    /// A vertical gradient.
    Gradient(SkyGradient),
    /// An equirectangular image.
    Picture(Arc<SkyPicture>),
}

/// A vertical gradient with a ground colour below the horizon: linear RGB radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyGradient {
    /// Radiance straight up.
    pub zenith: [f32; 3],
    /// Radiance at the horizon.
    pub horizon: [f32; 3],
    /// Radiance below the horizon.
    pub ground: [f32; 3],
}

impl Default for Sky {
    /// Clear sky that matches [`Sun::default`].
    fn default() -> Self {
        Self::Gradient(SkyGradient {
            zenith: [0.25, 0.42, 0.75],
            horizon: [0.75, 0.8, 0.85],
            ground: [0.25, 0.22, 0.2],
        })
    }
}

impl SkyGradient {
    /// Sky of the same radiance in all directions.
    pub fn uniform(radiance: [f32; 3]) -> Self {
        Self {
            zenith: radiance,
            horizon: radiance,
            ground: radiance,
        }
    }

    /// Radiance that arrives from the unit direction `direction` (world axes).
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        let (target, t) = if direction.y >= 0.0 {
            (self.zenith, direction.y.sqrt())
        } else {
            (self.ground, (-direction.y * 8.0).min(1.0))
        };
        [0, 1, 2].map(|c| self.horizon[c] + (target[c] - self.horizon[c]) * t)
    }

    fn times(&self, factor: f32) -> Self {
        let [zenith, horizon, ground] =
            [self.zenith, self.horizon, self.ground].map(|color| color.map(|c| c * factor));
        Self {
            zenith,
            horizon,
            ground,
        }
    }
}

impl Sky {
    /// Radiance that lights surfaces from the unit direction `direction` (world axes): without the
    /// sun of a picture.
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        match self {
            Self::Gradient(gradient) => gradient.radiance(direction),
            Self::Picture(picture) => picture.radiance(direction),
        }
    }

    /// Radiance of the visible background in the unit direction `direction` (world axes): pictures
    /// are interpolated and include their sun.
    pub fn seen(&self, direction: Vec3) -> [f32; 3] {
        match self {
            Self::Gradient(gradient) => gradient.radiance(direction),
            Self::Picture(picture) => picture.seen(direction),
        }
    }

    /// Returns the sky with its radiance multiplied by `factor`.
    pub fn times(&self, factor: f32) -> Self {
        match self {
            Self::Gradient(gradient) => Self::Gradient(gradient.times(factor)),
            Self::Picture(picture) => Self::Picture(Arc::new(picture.times(factor))),
        }
    }
}

/// A lamp without a surface: it lights the scene and is invisible (KHR_lights_punctual).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Radiant intensity, linear RGB; for [`Reach::Distant`] irradiance on a surface facing it.
    pub intensity: [f32; 3],
    /// Type of the lamp, with its position or direction.
    pub reach: Reach,
}

/// Type of a lamp, with its position or direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// Directional light: parallel rays from infinity.
    Distant {
        /// Unit vector toward the lamp, world axes.
        direction: Vec3,
    },
    /// Point light.
    Point {
        /// Position, world metres.
        position: DVec3,
        /// Range, metres; infinite without a limit.
        range_m: f32,
    },
    /// Spotlight: a cone with a soft edge.
    Spot {
        /// Position, world metres.
        position: DVec3,
        /// Range, metres; infinite without a limit.
        range_m: f32,
        /// Unit vector along the cone's axis, away from the lamp, world axes.
        axis: Vec3,
        /// Cosines of the half angles of full intensity and of the cone's outer edge.
        cosines: [f32; 2],
    },
}
