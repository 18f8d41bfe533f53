//! Irradiance cache of light that has bounced, for full light in captures.
//!
//! A capture traces direct light and the first bounce. All further bounces together are a fraction
//! of that light and vary slowly, so that they are looked up where the first ray of a path arrives:
//! in cells of position and normal, much coarser than the light of the capture, which is the
//! integral over hundreds of them (Ward, Rubinstein and Clear 1988, "A Ray Tracing Solution for
//! Diffuse Interreflection", and Christensen 1999, "Faster Photon Map Global Illumination", cache
//! likewise what only diffuse rays see). From each cell a fixed number of paths is traced to the
//! next cells. The light of all bounces is then the solution of a linear system, as in radiosity
//! (Goral et al. 1984), whose form factors are those paths. A path that arrives where no cell is
//! continues, so that nothing is lost.

use super::cells::{CellGrid, CellPoint, by_cell};
use super::path::Path;
use super::{LightSample, Lighting, LitPoint};
use crate::bvh::{Ray, Tracer};
use crate::sampler::random4;
use glam::Vec3;
use headbox_core::bounces::Bounces;
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::f32::consts::TAU;

/// Minimum width of a cell as a fraction of its distance from the local origin.
const CELL_SHARE: f32 = 1.0 / 16.0;

/// Minimum number of points of a cell.
const MIN_CELL_POINTS: usize = 2;

/// Number of paths from a cell.
const CELL_PATHS: u32 = 64;

/// Number of rays from the local origin, and of bounces of each: their hits are the points of the
/// cells.
const RAYS: u32 = 4096;
const RAY_BOUNCES: u32 = 4;

/// Maximum number of bounces between cells, and the relative change of the light at which fewer are
/// enough.
const MAX_ITERATIONS: u32 = 256;
const CONVERGED: f32 = 1e-4;

/// Radiosity per albedo from light that has bounced, by cells of position and normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct BouncedLight {
    cells: FxHashMap<u64, Vec3>,
    grid: CellGrid,
}

/// Paths from a cell to others.
struct CellPaths {
    /// Mean light that the paths gather, without that which has bounced before it leaves the cells
    /// at which they end.
    gathered: Vec3,
    /// Number of the cell at the end of each path, and the factor of its light.
    ends: Vec<(u32, Vec3)>,
}

impl BouncedLight {
    /// Returns the light at a point, if its cell is cached.
    pub(super) fn light(&self, point: &LitPoint) -> Option<Vec3> {
        if self.cells.is_empty() {
            None
        } else {
            self.cells.get(&self.grid.key(point)).copied()
        }
    }
}

impl Lighting {
    /// Caches the light of the second and all further bounces where light that is visible from the
    /// tracer's origin has bounced once, if the number of bounces is not limited.
    pub fn with_cached_bounces(mut self, tracer: &Tracer) -> Self {
        let visible = |index: u32| {
            let [u, v] = LightSample {
                stream: 0xb01d,
                index,
            }
            .pair(0);
            let z = 1.0 - 2.0 * u;
            let (sin, cos) = (v * TAU).sin_cos();
            let radius = (1.0 - z * z).max(0.0).sqrt();
            let ray = Ray::new(Vec3::ZERO, Vec3::new(radius * cos, radius * sin, z));
            let hit = tracer.closest(&ray)?;
            Some((index, LitPoint::from_hit(tracer, &ray, &hit).0))
        };
        if self.bounces == Bounces::Full {
            let points: Vec<(u32, LitPoint)> =
                (0..RAYS).into_par_iter().filter_map(visible).collect();
            let arrivals = self.arrivals(tracer, &points);
            self.cache_bounces(tracer, &arrivals, CELL_SHARE);
        }
        self
    }

    /// Caches like [`Self::with_cached_bounces`] where light that reaches `points` has bounced
    /// once, in cells of a share of their distance (see [`Self::cache_bounces`]).
    pub fn cache_bounces_toward(&mut self, tracer: &Tracer, points: &[LitPoint], cell_share: f32) {
        if self.bounces == Bounces::Full {
            let numbered: Vec<(u32, LitPoint)> = (0..).zip(points.iter().copied()).collect();
            let arrivals = self.arrivals(tracer, &numbered);
            self.cache_bounces(tracer, &arrivals, cell_share);
        }
    }

    /// Returns points at which light arrives that has bounced once before it reaches the given
    /// points, which are numbered for their random directions.
    fn arrivals(&self, tracer: &Tracer, points: &[(u32, LitPoint)]) -> Vec<LitPoint> {
        let arrivals = |&(number, ref point): &(u32, LitPoint)| {
            let arrival = move |bounce: u32| {
                let sample = LightSample {
                    stream: 0xb01e,
                    index: number * RAY_BOUNCES + bounce,
                };
                Some(self.first_segment(tracer, point, &sample).arrival?.point)
            };
            (0..RAY_BOUNCES).filter_map(arrival).collect::<Vec<_>>()
        };
        points.par_iter().flat_map_iter(arrivals).collect()
    }

    /// Caches bounced light in the cells of given points, if the number of bounces is not limited.
    /// A cell is at least `cell_share` of its distance from the local origin wide, and half of that
    /// share of the points' median distance.
    pub fn cache_bounces(&mut self, tracer: &Tracer, points: &[LitPoint], cell_share: f32) {
        self.bounced = BouncedLight::default();
        if self.bounces != Bounces::Full {
            return;
        }
        let grid = CellGrid::new(points, cell_share);
        let sorted = by_cell(&grid, points);
        let cells: Vec<&[CellPoint]> = sorted
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|points| points.len() >= MIN_CELL_POINTS)
            .collect();
        let numbers: FxHashMap<u64, u32> = (0..)
            .zip(&cells)
            .map(|(number, points)| (points[0].0, number))
            .collect();
        let number = |point: &LitPoint| numbers.get(&grid.key(point)).copied();
        let paths: Vec<CellPaths> = cells
            .par_iter()
            .map(|points| self.trace_cell(tracer, points, &number))
            .collect();
        let light = solve(&paths);
        self.bounced = BouncedLight {
            cells: cells.iter().map(|points| points[0].0).zip(light).collect(),
            grid,
        };
    }

    /// Traces the paths from one cell.
    fn trace_cell(
        &self,
        tracer: &Tracer,
        points: &[CellPoint],
        number: &(impl Fn(&LitPoint) -> Option<u32> + Sync),
    ) -> CellPaths {
        let cell = points[0].0;
        let [stream, ..] = random4([cell as u32, (cell >> 32) as u32, 0xb01f, 0]);
        let mut paths = CellPaths {
            gathered: Vec3::ZERO,
            ends: Vec::new(),
        };
        for index in 0..CELL_PATHS {
            let (.., point) = &points[index as usize % points.len()];
            let sample = LightSample { stream, index };
            let mut path = Path::new(point);
            // Bounced light comes from everywhere, unlike the light for which directions are
            // guided.
            let directions = self.unguided_directions(point);
            let next = self.trace_next_ray(tracer, &mut path, self.vertex(0), &sample, &directions);
            if next.is_none() {
                continue;
            }
            path.sum = Vec3::ZERO; // light along the first ray has not bounced
            let end = self.follow_to_cell(tracer, &mut path, &sample, number);
            paths
                .ends
                .extend(end.map(|(number, factor)| (number, factor / CELL_PATHS as f32)));
            paths.gathered += path.sum / CELL_PATHS as f32;
        }
        paths
    }
}

/// Returns the light of all bounces of each cell: the solution x = gathered + ends * x, by Jacobi
/// iteration.
fn solve(paths: &[CellPaths]) -> Vec<Vec3> {
    let mut light: Vec<Vec3> = paths.iter().map(|paths| paths.gathered).collect();
    for _ in 0..MAX_ITERATIONS {
        let next = |paths: &CellPaths| {
            let arriving = |&(number, factor): &(u32, Vec3)| light[number as usize] * factor;
            paths.gathered + paths.ends.iter().map(arriving).sum::<Vec3>()
        };
        let next: Vec<Vec3> = paths.par_iter().map(next).collect();
        let change: f32 = light
            .iter()
            .zip(&next)
            .map(|(old, new)| (*new - *old).length())
            .sum();
        let sum: f32 = next.iter().map(|light| light.length()).sum();
        light = next;
        if change <= CONVERGED * sum {
            break;
        }
    }
    light
}
