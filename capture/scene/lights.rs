//! Light sources of a scene beside its emissive triangles.

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
    /// A clear day at middle latitudes, some 50 degrees above the horizon.
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
    /// A simple one.
    Gradient(SkyGradient),
    /// Any other.
    Picture(Arc<SkyPicture>),
}

/// A vertical gradient with the ground's colour below the horizon. Linear RGB radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyGradient {
    /// Straight up.
    pub zenith: [f32; 3],
    /// At the horizon.
    pub horizon: [f32; 3],
    /// Below the horizon.
    pub ground: [f32; 3],
}

impl Default for Sky {
    /// The clear sky that goes with [`Sun::default`].
    fn default() -> Self {
        Self::Gradient(SkyGradient {
            zenith: [0.25, 0.42, 0.75],
            horizon: [0.75, 0.8, 0.85],
            ground: [0.25, 0.22, 0.2],
        })
    }
}

impl SkyGradient {
    /// The same radiance in all directions.
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
        let scaled = |color: [f32; 3]| color.map(|c| c * factor);
        Self {
            zenith: scaled(self.zenith),
            horizon: scaled(self.horizon),
            ground: scaled(self.ground),
        }
    }
}

impl Sky {
    /// Radiance with which the sky lights from the unit direction `direction` (world axes).
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        match self {
            Self::Gradient(gradient) => gradient.radiance(direction),
            Self::Picture(picture) => picture.radiance(direction),
        }
    }

    /// Radiance that an eye sees in the unit direction `direction` (world axes): pictures are
    /// smooth, and their sun stands in them.
    pub fn seen(&self, direction: Vec3) -> [f32; 3] {
        match self {
            Self::Gradient(gradient) => gradient.radiance(direction),
            Self::Picture(picture) => picture.seen(direction),
        }
    }

    /// The same sky, so many times as bright.
    pub fn times(&self, factor: f32) -> Self {
        match self {
            Self::Gradient(gradient) => Self::Gradient(gradient.times(factor)),
            Self::Picture(picture) => Self::Picture(Arc::new(picture.times(factor))),
        }
    }
}

/// A lamp without a surface: it lights, and is not seen (KHR_lights_punctual).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Linear RGB: radiant intensity; of a lamp at infinity, irradiance on a surface facing it.
    pub intensity: [f32; 3],
    /// Position or direction.
    pub reach: Reach,
}

/// Position or direction of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// From infinitely far, along parallel lines.
    Distant {
        /// Unit vector toward the lamp, world axes.
        direction: Vec3,
    },
    /// All around a place.
    Point {
        /// World metres.
        position: DVec3,
        /// Range, metres; infinite without a limit.
        range_m: f32,
    },
    /// In a cone, whose rim is soft.
    Spot {
        /// World metres.
        position: DVec3,
        /// Range, metres; infinite without a limit.
        range_m: f32,
        /// Unit vector along the cone's axis, away from the lamp, world axes.
        axis: Vec3,
        /// Cosines of the half angle within which it shines in full, and of that beyond which it
        /// does not shine.
        cosines: [f32; 2],
    },
}
