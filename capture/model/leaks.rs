//! Leaks: rays that pass from one cell into another without crossing a portal.

use super::box_tree::{BoxTree, crosses};
use super::polygon::Polygon;
use super::{CellIndex, Finding, PortalModel, distance_to_outline};
use glam::{DVec2, DVec3};
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::sampler::{random4, unit_float};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Distance before a hit at which the ray's cell is looked up, metres: a wall's face may lie this
/// far off the border of its cell's space.
const BEFORE_HIT_M: f64 = 0.03;

/// Margin of portals for the search, metres: hand-drawn homes have gaps of a few millimetres
/// between an opening and the wall around it.
const EDGE_M: f64 = 0.005;

/// Minimum distance of ray origins from the border of their cell's space, metres: the space may
/// reach to the middle of walls, and rays from inside a wall are meaningless. A narrower cell sends
/// no rays.
const FROM_BORDER_M: f64 = 0.25;

/// Maximum number of attempts to find the origin of a ray.
const ATTEMPTS: u32 = 64;

/// A ray that ended in a cell to which its portals do not lead.
struct Stray {
    from: u32,
    into: u32,
    at: DVec3,
}

/// Search structures over what rays meet.
struct Search<'a> {
    tracer: &'a Tracer,
    cells: CellIndex<'a>,
    /// Polygon of each portal; none of one that is not planar and convex.
    polygons: Vec<Option<Polygon<'a>>>,
    /// Tree over the polygons, each grown by [`EDGE_M`].
    portals: BoxTree,
}

impl PortalModel {
    /// Traces `rays_per_cell` rays from seeded points in each cell (except the outside) in seeded
    /// directions, follows them through the portals that they cross, and reports those that end in
    /// another cell: one finding for each pair of cells. `tracer` is over this model's scene. The
    /// result does not depend on the number of threads.
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
        // Portals to missing cells are ignored.
        let exists = |&cell: &u32| (cell as usize) < self.cells.len();
        let polygons: Vec<Option<Polygon>> = self
            .portals
            .iter()
            .map(|portal| {
                let polygon = Polygon::new(&portal.polygon).ok();
                polygon.filter(|_| portal.cells.iter().all(exists))
            })
            .collect();
        let boxes = polygons.iter().enumerate().filter_map(|(index, polygon)| {
            let polygon = polygon.as_ref()?;
            Some((index, polygon.grown_bounds(EDGE_M)))
        });
        let search = Search {
            tracer,
            cells: self.cell_index(),
            portals: BoxTree::new(boxes.collect()),
            polygons,
        };
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
                let (origin, direction) = self.ray_from(&search.cells, cell, ray, seed)?;
                self.follow(&search, cell, origin, direction)
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

    /// Samples a point well inside a cell and a unit direction, both uniform; `None` if no attempt
    /// finds a point.
    fn ray_from(
        &self,
        cells: &CellIndex,
        cell: u32,
        ray: u32,
        seed: u64,
    ) -> Option<(DVec3, DVec3)> {
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
            (clear && cells.cell_at(p) == Some(cell)).then_some(p)
        })?;
        let [a, b, ..] = random4([key, cell, ray, ATTEMPTS]).map(|r| f64::from(unit_float(r)));
        let (y, azimuth) = (2.0 * a - 1.0, b * std::f64::consts::TAU);
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let direction = DVec3::new(azimuth.cos() * radius, y, azimuth.sin() * radius);
        Some((point, direction))
    }

    /// Follows a ray from a cell through portals to its hit. Returns the ray if it ends in another
    /// cell than its portals lead to.
    fn follow(&self, search: &Search, cell: u32, origin: DVec3, direction: DVec3) -> Option<Stray> {
        let tracer = search.tracer;
        let local = Ray::new((origin - tracer.origin()).as_vec3(), direction.as_vec3());
        let hit = tracer.closest(&local);
        let reach = hit.map_or(f64::INFINITY, |hit| f64::from(hit.t));
        let near = search
            .portals
            .items(|bounds| crosses(bounds, origin, direction));
        let mut crossings: Vec<(f64, usize)> = near
            .filter_map(|index| {
                let polygon = search.polygons[index].as_ref()?;
                Some((polygon.hit(origin, direction, EDGE_M)?, index))
            })
            // A surface in a portal's plane closes it.
            .filter(|&(t, _)| t + EDGE_M < reach)
            .collect();
        crossings.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
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
            // The ray leaves to the sky, which is outside.
            let into = self.outside.filter(|&outside| outside != current)?;
            return Some(Stray {
                from: current,
                into,
                at: origin,
            });
        };
        // The tested position is not in front of the last portal that the ray crossed.
        let at = origin + direction * (reach - BEFORE_HIT_M).max((last_crossing + reach) / 2.0);
        let reached = search.cells.cell_at(at)?;
        let own = &self.cells[current as usize].triangles;
        (reached != current && !own.contains(&hit.primitive)).then_some(Stray {
            from: current,
            into: reached,
            at,
        })
    }
}
