//! Path guiding: ray directions sampled from the learned distribution of incident light.
//!
//! A room is lit through its windows, and few cosine-weighted rays hit one. Surface points are
//! therefore hashed into cells by position and normal, and each cell learns a density over the unit
//! square from which cosine-weighted directions are warped: high where bright light arrived. Guided
//! rays are weighted by its reciprocal, so that no mean changes (Jensen 1995, "Importance Driven
//! Path Tracing using the Photon Map"; Mueller et al. 2017, "Practical Path Guiding"), and the
//! density is proportional to the root mean square of the light, which minimises the variance of
//! one ray (Rath et al. 2020, "Variance-Aware Path Guiding").

use super::reflectors::{AIMED_FRACTION, Reflectors};
use super::square::SquareDensity;
use crate::bvh::{Hit, Tracer};
use crate::light::cells::CellGrid;
use crate::light::{LightSample, Lighting, LitPoint};
use crate::sampler::{cosine_direction, square_from_disk};
use glam::{Quat, Vec3};
use rustc_hash::FxHashMap;
use std::f32::consts::PI;

/// Incident light distributions, by cells of position and normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Guide {
    pub(super) cells: FxHashMap<u64, SquareDensity>,
    pub(super) grid: CellGrid,
}

impl Guide {
    /// Returns the density at a point, if its cell is guided.
    fn density(&self, point: &LitPoint) -> Option<&SquareDensity> {
        if self.cells.is_empty() {
            None
        } else {
            self.cells.get(&self.grid.key(point))
        }
    }
}

/// Distribution of the rays that leave a point: some aimed at reflectors, the others
/// cosine-weighted about its shading normal, or guided.
pub(crate) struct Directions<'a> {
    /// Rotation from +Z to the shading normal.
    turn: Quat,
    guide: Option<&'a SquareDensity>,
    reflectors: Option<Reflectors<'a>>,
}

/// Direction of a ray before it is traced.
#[derive(Clone, Copy)]
pub(crate) struct Aim {
    /// Unit direction.
    pub(crate) direction: Vec3,
    /// Reflector at which the ray is aimed; it counts only if it hits that triangle.
    target: Option<u32>,
    /// Density of the rays that are not aimed, over the cosine-weighted one.
    guided: f32,
}

impl Aim {
    /// Returns true if the ray is aimed at a reflector.
    pub(crate) fn is_aimed(&self) -> bool {
        self.target.is_some()
    }
}

impl Directions<'_> {
    /// Samples the direction of a ray by decision `dimension`.
    pub(crate) fn sample(&self, tracer: &Tracer, sample: &LightSample, dimension: u32) -> Aim {
        let pair = sample.pair(dimension);
        let aimed = self.reflectors.and_then(|reflectors| {
            let number = sample.single(dimension) / AIMED_FRACTION;
            (number < 1.0).then(|| reflectors.aim(tracer, number, pair))?
        });
        let Some((direction, target)) = aimed else {
            return self.sample_unaimed(pair);
        };
        Aim {
            direction,
            target: Some(target),
            guided: self.guided_density(direction),
        }
    }

    /// Maps two numbers in [0, 1) to a direction that is not aimed at a reflector.
    pub(super) fn sample_unaimed(&self, pair: [f32; 2]) -> Aim {
        let (pair, guided) = self.guide.map_or((pair, 1.0), |guide| {
            let warped = guide.warp(pair);
            (warped, guide.density(warped))
        });
        Aim {
            direction: self.turn * Vec3::from_array(cosine_direction(pair[0], pair[1])),
            target: None,
            guided,
        }
    }

    /// Returns the importance weight of a ray with its hit; `None` if it does not count. `cos` > 0
    /// is the cosine of its angle with the shading normal.
    pub(crate) fn weight(
        &self,
        tracer: &Tracer,
        aim: &Aim,
        cos: f32,
        hit: Option<&Hit>,
    ) -> Option<f32> {
        let Some(reflectors) = &self.reflectors else {
            return Some(1.0 / aim.guided);
        };
        if aim.target.is_some() && aim.target != hit.map(|hit| hit.primitive) {
            return None;
        }
        let aimed = hit.map_or(0.0, |hit| {
            reflectors.density(tracer, aim.direction, (hit.primitive, hit.t))
        });
        let aimed = aimed * PI / cos;
        Some(1.0 / ((1.0 - AIMED_FRACTION) * aim.guided + AIMED_FRACTION * aimed))
    }

    /// Returns the probability density of a direction, per steradian, in which a ray hits the
    /// triangle of a number at a distance in metres, or nothing; `cos` > 0 is the cosine of its
    /// angle with the shading normal.
    pub(crate) fn density(
        &self,
        tracer: &Tracer,
        direction: Vec3,
        cos: f32,
        hit: Option<(u32, f32)>,
    ) -> f32 {
        let guided = self.guided_density(direction) * cos / PI;
        self.reflectors.map_or(guided, |reflectors| {
            let aimed = hit.map_or(0.0, |hit| reflectors.density(tracer, direction, hit));
            (1.0 - AIMED_FRACTION) * guided + AIMED_FRACTION * aimed
        })
    }

    /// Returns the density of the rays that are not aimed, over the cosine-weighted one.
    fn guided_density(&self, direction: Vec3) -> f32 {
        self.guide.map_or(1.0, |guide| {
            let local = self.turn.inverse() * direction;
            guide.density(square_from_disk([local.x, local.y]))
        })
    }
}

impl Lighting {
    /// Returns the distribution of rays that leave a point.
    pub(crate) fn directions(&self, point: &LitPoint) -> Directions<'_> {
        Directions {
            guide: self.guide.density(point),
            ..self.unguided_directions(point)
        }
    }

    /// Returns the distribution of rays that leave a point without a guide.
    pub(crate) fn unguided_directions(&self, point: &LitPoint) -> Directions<'_> {
        Directions {
            turn: Quat::from_rotation_arc(Vec3::Z, point.shading_normal),
            guide: None,
            reflectors: self.reflectors(point),
        }
    }
}
