//! Leaks: rays from cell to cell past all portals.

use super::polygon::Polygon;
use super::{Finding, Portal, PortalModel, distance_to_outline};
use glam::{DVec2, DVec3};
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::sampler::{random4, unit_float};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Distance before a hit at which the ray's cell is looked up, metres: a wall's face may lie this
/// far off the border of its cell's space.
const BEFORE_HIT_M: f64 = 0.03;

/// Portals are grown by this much for the rays of the search, metres: drawn homes leave a few
/// millimetres between an opening and the wall around it.
const EDGE_M: f64 = 0.005;

/// Rays start at least this far from the border of their cell's space, metres: the space of a cell
/// may reach to the middle of its walls, and what is seen from inside a wall says nothing. A cell
/// too narrow for that sends no rays.
const FROM_BORDER_M: f64 = 0.25;

/// Attempts to find a point in a cell, for each that is wanted.
const ATTEMPTS: u32 = 64;

/// A ray that was found in another cell than its portals led it to.
struct Stray {
    from: u32,
    into: u32,
    at: DVec3,
}

impl PortalModel {
    /// Sends `rays_per_cell` rays from seeded points in each cell (but the outside) in seeded
    /// directions, follows them through the portals they cross, and reports those that end in
    /// another cell: one finding for each pair of cells. `tracer` is over this model's scene. The
    /// same on any number of threads.
    pub fn leaks(&self, tracer: &Tracer, rays_per_cell: u32, seed: u64) -> Vec<Finding> {
        let name = |cell: u32| self.cells[cell as usize].name.clone();
        let of = rays_per_cell as usize
            * (0..self.cells.len() as u32)
                .filter(|&cell| !self.is_outside(cell))
                .count();
        let finding = |((from, into), (rays, at))| Finding::Leak {
            from: name(from),
            into: name(into),
            rays,
            of,
            at,
        };
        self.stray_pairs(tracer, rays_per_cell, seed)
            .into_iter()
            .map(finding)
            .collect()
    }

    /// Counts the rays that pass from one cell to another past all portals, with the position of
    /// one of them.
    pub(super) fn stray_pairs(
        &self,
        tracer: &Tracer,
        rays_per_cell: u32,
        seed: u64,
    ) -> BTreeMap<(u32, u32), (usize, DVec3)> {
        // Portals to cells that do not exist lead nowhere.
        let is_sound = |p: &Portal| {
            p.cells
                .iter()
                .all(|&cell| (cell as usize) < self.cells.len())
        };
        let polygons: Vec<Option<Polygon>> = self
            .portals
            .iter()
            .map(|p| {
                if is_sound(p) {
                    Polygon::new(&p.polygon).ok()
                } else {
                    None
                }
            })
            .collect();
        let cells: Vec<u32> = (0..self.cells.len() as u32)
            .filter(|&cell| !self.is_outside(cell))
            .collect();
        let rays: Vec<(u32, u32)> = cells
            .into_iter()
            .flat_map(|cell| (0..rays_per_cell).map(move |ray| (cell, ray)))
            .collect();
        let strays: Vec<Option<Stray>> = rays
            .par_iter()
            .map(|&(cell, ray)| {
                let (origin, direction) = self.ray_from(cell, ray, seed)?;
                self.follow(tracer, &polygons, cell, origin, direction)
            })
            .collect();
        let mut pairs: BTreeMap<(u32, u32), (usize, DVec3)> = BTreeMap::new();
        for stray in strays.into_iter().flatten() {
            pairs
                .entry((stray.from, stray.into))
                .or_insert((0, stray.at))
                .0 += 1;
        }
        pairs
    }

    /// A point well inside a cell and a unit direction, uniform both; none if no attempt found a
    /// point.
    fn ray_from(&self, cell: u32, ray: u32, seed: u64) -> Option<(DVec3, DVec3)> {
        let space = &self.cells[cell as usize].space;
        let key = (seed ^ (seed >> 32)) as u32;
        let point = (0..ATTEMPTS).find_map(|attempt| {
            let random = random4([key, cell, ray, attempt]).map(|r| f64::from(unit_float(r)));
            let prism = space.get((random[3] * space.len() as f64) as usize)?;
            let low = prism.outline.iter().copied().reduce(|a, b| a.min(b))?;
            let high = prism.outline.iter().copied().reduce(|a, b| a.max(b))?;
            let y = prism.floor_y + (prism.ceiling_y - prism.floor_y) * (0.05 + 0.9 * random[1]);
            let p = DVec3::new(
                low.x + (high.x - low.x) * random[0],
                y,
                low.y + (high.y - low.y) * random[2],
            );
            let clear = distance_to_outline(&prism.outline, DVec2::new(p.x, p.z)) >= FROM_BORDER_M;
            (clear && self.cell_at(p) == Some(cell)).then_some(p)
        })?;
        let [a, b, ..] = random4([key, cell, ray, ATTEMPTS]).map(|r| f64::from(unit_float(r)));
        let (up, around) = (2.0 * a - 1.0, b * std::f64::consts::TAU);
        let aside = (1.0 - up * up).max(0.0).sqrt();
        Some((
            point,
            DVec3::new(around.cos() * aside, up, around.sin() * aside),
        ))
    }

    /// Follows a ray from a cell to what it hits.
    fn follow(
        &self,
        tracer: &Tracer,
        polygons: &[Option<Polygon>],
        cell: u32,
        origin: DVec3,
        direction: DVec3,
    ) -> Option<Stray> {
        let local = Ray {
            origin: (origin - tracer.origin()).as_vec3(),
            direction: direction.as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        let hit = tracer.closest(&local);
        let reach = hit.map_or(f64::INFINITY, |hit| f64::from(hit.t));
        let mut crossings: Vec<(f64, usize)> = polygons
            .iter()
            .enumerate()
            .filter_map(|(index, polygon)| {
                Some((polygon.as_ref()?.hit(origin, direction, EDGE_M)?, index))
            })
            // A surface in a portal's plane closes it.
            .filter(|&(t, _)| t + EDGE_M < reach)
            .collect();
        crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut current = cell;
        let last_crossing = crossings.last().map_or(0.0, |&(t, _)| t);
        for (_, portal) in crossings {
            match self.portals[portal].cells {
                [a, b] if a == current => current = b,
                [a, b] if b == current => current = a,
                _ => {}
            }
        }
        let Some(hit) = hit else {
            // Into the sky: that is outside. A model without an outside has nothing there to be
            // missed.
            let into = self.outside.filter(|&outside| outside != current)?;
            return Some(Stray {
                from: current,
                into,
                at: origin,
            });
        };
        // Not back through the portal that it came through last.
        let at = origin + direction * (reach - BEFORE_HIT_M).max((last_crossing + reach) / 2.0);
        let found = self.cell_at(at)?;
        let owner = (0_u32..)
            .zip(&self.cells)
            .find(|(_, it)| it.triangles.contains(&hit.primitive))
            .map(|(cell, _)| cell);
        (found != current && owner != Some(current)).then_some(Stray {
            from: current,
            into: found,
            at,
        })
    }
}
