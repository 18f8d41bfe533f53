//! Light samples cut in two after their first ray, so that what lies beyond can be shared between samples that arrive close
//! together.
//!
//! Light that a path finds beyond its first bounce hardly changes over a few centimetres of the surface on which it bounces, and a
//! capture sends millions of paths there. So their ends are filed by cells of space (Binder, Fricke and Keller 2018, "Fast Path
//! Space Filtering by Jittered Spatial Hashing"; Christensen 1999, "Faster Photon Map Global Illumination"), and a few paths a cell
//! stand for all.

use super::{LightSample, Lighting, LitPoint, Path};
use crate::trace::Tracer;
use glam::Vec3;

/// Cells are at least this share of their distance from the local origin wide, and at most twice of it.
const CELL_SHARE: f32 = 1.0 / 64.0;

/// A path that came closer than this many cells' widths takes no part: it would see its own corner through a cell.
const FARTHEST_CELLS: f32 = 2.0;

/// Paths are followed with at least this albedo: where a surface is black, what it would reflect elsewhere is still wanted.
const LEAST_ALBEDO: f32 = 0.05;

/// Where the first ray of a light sample met a surface.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// The place.
    point: LitPoint,
    /// Its albedo.
    pub albedo: Vec3,
    /// Length of the ray, metres.
    pub distance_m: f32,
}

impl Arrival {
    /// The cell in which this arrival lies: arrivals in one cell lie close together, and their surfaces are turned alike. `None` if
    /// the ray was so short that the cell is no small part of what its start sees.
    pub fn cell(&self) -> Option<u64> {
        let exponent = (self.point.position.abs().max_element() * CELL_SHARE).max(1e-30).log2().ceil();
        let width = exponent.exp2();
        if self.distance_m < FARTHEST_CELLS * width {
            return None;
        }
        let bits = |value: f32| u64::from(value as i32 as u8);
        let [x, y, z] = (self.point.position / width).floor().to_array().map(bits);
        let [nx, ny, nz] = (self.point.normal * 2.0).round().to_array().map(bits).map(|bits| bits & 7);
        Some(x | y << 8 | z << 16 | bits(exponent) << 24 | nx << 32 | ny << 35 | nz << 38)
    }
}

impl Lighting {
    /// The beginning of a sample of [`Self::soft_radiosity`]: what it finds before its first ray meets a surface, and where that
    /// is, if it goes on from there. Albedo times one sample of [`Self::beyond`] is still to be added.
    pub fn before(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> (Vec3, Option<Arrival>) {
        let mut path = Path { point: *point, throughput: Vec3::ONE, sum: Vec3::ZERO };
        let on = self.vertex(tracer, &mut path, 0, sample);
        (path.sum, on.map(|distance_m| Arrival { point: path.point, albedo: path.throughput, distance_m }))
    }

    /// The rest of a sample: radiosity per albedo where its first ray arrived.
    pub fn beyond(&self, tracer: &Tracer, arrival: &Arrival, sample: &LightSample) -> Vec3 {
        let throughput = arrival.albedo.max(Vec3::splat(LEAST_ALBEDO));
        let mut path = Path { point: arrival.point, throughput, sum: Vec3::ZERO };
        self.follow(tracer, &mut path, 1, sample);
        path.sum / throughput
    }
}
