//! Path space filtering: light samples split after their first segment, so that nearby samples
//! share the remainder of a path.
//!
//! Light that a path gathers beyond its first bounce hardly changes over a few centimetres of the
//! surface on which it bounces, and a capture sends millions of paths there. Their ends are
//! therefore hashed into cells of space (Binder, Fricke and Keller 2018, "Fast Path Space Filtering
//! by Jittered Spatial Hashing"; Christensen 1999, "Faster Photon Map Global Illumination"), and a
//! few paths per cell represent all.

use super::cells::power_of_two_above;
use super::path::Path;
use super::{LightSample, Lighting, LitPoint};
use crate::bvh::Tracer;
use glam::Vec3;
use headbox_scene::material::floor;

/// Minimum width of a cell as a fraction of its distance from the local origin; the maximum is
/// twice that.
const CELL_SHARE: f32 = 1.0 / 64.0;

/// Minimum length of a path's first segment, in cell widths. Shorter paths are not filtered: the
/// cell would be a large part of the view from their start (contact shadows).
const MIN_SEGMENT_CELLS: f32 = 2.0;

/// Mask of a cell's coordinate in [`Arrival::cell_of_width`]: cells wrap around after 2^18.
const CELL_MASK: u32 = (1 << 18) - 1;

/// Minimum albedo with which a remainder is traced: other samples of the cell may arrive on a
/// brighter part of the surface.
const MIN_ALBEDO: f32 = 0.05;

/// End of the first segment of a light sample's path, on a surface.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Surface point.
    pub(super) point: LitPoint,
    /// Albedo of the surface.
    albedo: Vec3,
    /// Importance weight of the ray: 1 unless its direction was guided.
    pub weight: f32,
    /// Length of the ray, metres.
    pub distance_m: f32,
}

/// First segment of a light sample's path.
#[derive(Clone, Copy, Debug)]
pub struct FirstSegment {
    /// Light gathered before its ray hits a surface.
    pub light: Vec3,
    /// Sum of the [gradients](LitPoint::normal_gradient) of that light.
    pub gradient: Vec3,
    /// End of the segment, if it hits a surface.
    pub arrival: Option<Arrival>,
}

impl Arrival {
    /// Returns the surface point, in the tracer's local frame.
    pub fn position(&self) -> Vec3 {
        self.point.position
    }

    /// Returns the hash key of the arrival's cell, by position and normal. `None` if the segment is
    /// so short that the cell is not a small part of the view from its start.
    pub fn cell(&self) -> Option<u64> {
        let (exponent, width_m) =
            power_of_two_above(self.point.position.abs().max_element() * CELL_SHARE);
        let [x, y, z] = self.grid_coordinates(width_m)?.map(|c| u64::from(c as u8));
        Some(x | y << 8 | z << 16 | u64::from(exponent) << 24 | self.point.quantised_normal() << 32)
    }

    /// Returns the key like [`Self::cell`], for cells that are all `width_m` metres wide.
    pub fn cell_of_width(&self, width_m: f32) -> Option<u64> {
        let [x, y, z] = self
            .grid_coordinates(width_m)?
            .map(|c| u64::from(c as u32 & CELL_MASK));
        Some(x | y << 18 | z << 36 | self.point.quantised_normal() << 54)
    }

    /// Returns the integer coordinates of the arrival's cell in a grid.
    fn grid_coordinates(&self, width_m: f32) -> Option<[i32; 3]> {
        let is_far = self.distance_m >= MIN_SEGMENT_CELLS * width_m;
        is_far.then(|| {
            (self.point.position / width_m)
                .to_array()
                .map(|c| floor(c) as i32)
        })
    }

    /// Returns the sample's contribution from the radiosity per albedo that reaches the point
    /// ([`Lighting::beyond`]).
    pub fn contribution(&self, light: Vec3) -> Vec3 {
        self.albedo * self.weight * light
    }
}

impl Lighting {
    /// Traces the first segment of a sample of [`Self::soft_radiosity`]. The caller adds the
    /// [contribution](Arrival::contribution) of one sample of [`Self::beyond`].
    pub fn first_segment(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
    ) -> FirstSegment {
        let mut path = Path::new(point);
        let distance_m = self.light_vertex(tracer, &mut path, self.vertex(0), sample);
        let arrival = distance_m.map(|distance_m| Arrival {
            point: path.point,
            albedo: path.throughput,
            weight: path.weight,
            distance_m,
        });
        FirstSegment {
            light: path.sum,
            gradient: path.gradient,
            arrival,
        }
    }

    /// Traces the remainder of a sample: returns the radiosity per albedo at its arrival. Light
    /// that has bounced before is that of the arrival's cell, if that is cached
    /// ([`Self::with_cached_bounces`]).
    pub fn beyond(&self, tracer: &Tracer, arrival: &Arrival, sample: &LightSample) -> Vec3 {
        let throughput = arrival.albedo.max(Vec3::splat(MIN_ALBEDO));
        let mut path = Path {
            throughput,
            ..Path::new(&arrival.point)
        };
        let bounced =
            self.follow_to_cell(tracer, &mut path, sample, |point| self.bounced.light(point));
        (path.sum + bounced.map_or(Vec3::ZERO, |(light, factor)| light * factor)) / throughput
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::tests::lit_point;

    fn arrival(position: Vec3, normal: Vec3, distance_m: f32) -> Arrival {
        Arrival {
            point: lit_point(position, normal, 1.0),
            albedo: Vec3::ONE,
            weight: 1.0,
            distance_m,
        }
    }

    #[test]
    fn fixed_width_cells_group_by_position_and_normal() {
        const WIDTH_M: f32 = 0.125;
        let cell = |x: f32, normal: Vec3| {
            arrival(Vec3::new(x, 1.0, -2.0), normal, 3.0).cell_of_width(WIDTH_M)
        };
        assert_eq!(cell(0.01, Vec3::Y), cell(0.12, Vec3::Y));
        assert!(cell(0.01, Vec3::Y).is_some());
        let others = [
            cell(-0.01, Vec3::Y),
            cell(0.13, Vec3::Y),
            cell(0.01, Vec3::NEG_Y),
            cell(0.01, Vec3::X),
        ];
        assert!(
            others
                .iter()
                .all(|other| other.is_some() && *other != cell(0.01, Vec3::Y)),
            "{others:?}"
        );
        // Distant cells do not wrap around, as those of `cell` would (8 bits): 16 km are 2^17
        // cells.
        assert_ne!(cell(0.01, Vec3::Y), cell(32.01, Vec3::Y));
        assert_ne!(cell(0.01, Vec3::Y), cell(16_000.01, Vec3::Y));
        assert_eq!(
            arrival(Vec3::ONE, Vec3::Y, 0.2).cell_of_width(WIDTH_M),
            None,
            "segment shorter than two cells"
        );
    }
}
