//! Routes through a room around its walls and furniture, at eye height.

use glam::{DVec2, DVec3};
use headbox_trace::bvh::{Ray, Tracer};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Clearances to either side of a route, metres; the first that admits a route is used.
const CLEARANCES_M: [f64; 2] = [0.2, 0.02];
/// Spacing of the grid on which a route is searched, metres.
const SPACING_M: f64 = 0.25;
/// Largest number of grid points; for larger rooms the spacing grows.
const MAX_POINTS: f64 = 4096.0;

/// Returns the corners of a short route between two points, without the points themselves: none if
/// the straight line is free, or if there is no route. `low`, `high`: bounds of the room in x and
/// z, world metres.
pub(super) fn corners(
    tracer: &Tracer,
    [from, to]: [DVec3; 2],
    [low, high]: [DVec2; 2],
) -> Vec<DVec3> {
    if is_free(tracer, [from, to], CLEARANCES_M[0]) {
        return Vec::new();
    }
    let route = CLEARANCES_M.iter().find_map(|clearance_m| {
        let grid = Grid::new(tracer, [from, to], [low, high], *clearance_m);
        Some(grid.straightened(&grid.shortest()?))
    });
    route.unwrap_or_default()
}

/// Returns true if no surface is within `clearance_m` to either side of a line.
fn is_free(tracer: &Tracer, [from, to]: [DVec3; 2], clearance_m: f64) -> bool {
    let is_open = |from: DVec3, to: DVec3| {
        let ray = Ray {
            origin: (from - tracer.origin()).as_vec3(),
            direction: (to - from).as_vec3(),
            t_min: 0.0,
            t_max: 1.0,
        };
        tracer.closest(&ray).is_none()
    };
    let aside = (to - from).cross(DVec3::Y).normalize_or_zero() * clearance_m;
    is_open(from, to)
        && [aside, -aside].into_iter().all(|aside| {
            is_open(from, from + aside)
                && is_open(from + aside, to + aside)
                && is_open(to + aside, to)
        })
}

/// Points of a room at eye height: the start, the end, and a grid.
struct Grid<'a> {
    tracer: &'a Tracer,
    clearance_m: f64,
    points: Vec<DVec3>,
    /// Number of grid points in a row.
    across: usize,
    spacing_m: f64,
}

const START: usize = 0;
const END: usize = 1;
/// First grid point.
const FIRST: usize = 2;

impl<'a> Grid<'a> {
    fn new(
        tracer: &'a Tracer,
        [from, to]: [DVec3; 2],
        [low, high]: [DVec2; 2],
        clearance_m: f64,
    ) -> Self {
        let size = (high - low).max(DVec2::splat(SPACING_M));
        let spacing_m = SPACING_M.max((size.x * size.y / MAX_POINTS).sqrt());
        let counts = (size / spacing_m).ceil();
        let [across, down] = [counts.x as usize, counts.y as usize];
        let mut points = vec![from, to];
        for (row, column) in (0..down).flat_map(|row| (0..across).map(move |column| (row, column)))
        {
            let at = low + (DVec2::new(column as f64, row as f64) + 0.5) * spacing_m;
            points.push(DVec3::new(at.x, from.y, at.y));
        }
        Self {
            tracer,
            clearance_m,
            points,
            across,
            spacing_m,
        }
    }

    fn is_free(&self, a: usize, b: usize) -> bool {
        is_free(
            self.tracer,
            [self.points[a], self.points[b]],
            self.clearance_m,
        )
    }

    /// Returns the points that may be reached from a point in one step.
    fn steps(&self, from: usize) -> Vec<usize> {
        let reach = self.spacing_m * 1.5;
        let near =
            |&to: &usize| to != from && (self.points[to] - self.points[from]).length() < reach;
        if from < FIRST {
            return (FIRST..self.points.len()).filter(near).collect();
        }
        let (row, column) = ((from - FIRST) / self.across, (from - FIRST) % self.across);
        let rows = row.saturating_sub(1)..row + 2;
        let columns = column.saturating_sub(1)..(column + 2).min(self.across);
        let grid = rows.flat_map(|row| columns.clone().map(move |column| (row, column)));
        let grid = grid.map(|(row, column)| FIRST + row * self.across + column);
        let grid = grid.filter(|to| *to < self.points.len());
        std::iter::once(END).chain(grid).filter(near).collect()
    }

    /// Returns the points of the shortest route from the start to the end, by Dijkstra's algorithm.
    fn shortest(&self) -> Option<Vec<usize>> {
        let micrometres =
            |a: usize, b: usize| ((self.points[a] - self.points[b]).length() * 1e6) as u64;
        let mut before: Vec<Option<(u64, usize)>> = vec![None; self.points.len()];
        let mut is_done = vec![false; self.points.len()];
        before[START] = Some((0, START));
        let mut queue = BinaryHeap::from([Reverse((0, START))]);
        while let Some(Reverse((length, at))) = queue.pop() {
            if std::mem::replace(&mut is_done[at], true) {
                continue;
            }
            if at == END {
                break;
            }
            for next in self.steps(at) {
                let length = length + micrometres(at, next);
                let is_shorter = before[next].is_none_or(|(known, _)| length < known);
                if is_shorter && self.is_free(at, next) {
                    before[next] = Some((length, at));
                    queue.push(Reverse((length, next)));
                }
            }
        }
        let mut route = vec![END];
        while route[route.len() - 1] != START {
            route.push(before[route[route.len() - 1]]?.1);
        }
        route.reverse();
        Some(route)
    }

    /// Returns the corners of a route, without its ends, after cutting every corner that can be cut.
    fn straightened(&self, route: &[usize]) -> Vec<DVec3> {
        let mut corners = Vec::new();
        let mut at = 0;
        while at + 1 < route.len() {
            let next = (at + 2..route.len())
                .rev()
                .find(|next| self.is_free(route[at], route[*next]))
                .unwrap_or(at + 1);
            corners.push(self.points[route[next]]);
            at = next;
        }
        corners.pop();
        corners
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Triangle};
    use std::sync::Arc;

    /// Walls 3 m high over lines from (x, z) to (x, z).
    fn walls(lines: &[[[f64; 2]; 2]]) -> Tracer {
        let mut scene = Scene {
            materials: vec![Material::default()],
            ..Scene::default()
        };
        for [[x0, z0], [x1, z1]] in lines {
            let first = scene.positions.len() as u32;
            scene.positions.extend([
                dvec3(*x0, 0.0, *z0),
                dvec3(*x1, 0.0, *z1),
                dvec3(*x1, 3.0, *z1),
                dvec3(*x0, 3.0, *z0),
            ]);
            for vertices in [[0, 1, 2], [0, 2, 3]] {
                scene.triangles.push(Triangle {
                    vertices: vertices.map(|v: u32| first + v),
                    material: 0,
                });
            }
        }
        Tracer::new(Arc::new(scene), DVec3::ZERO)
    }

    const ENDS: [DVec3; 2] = [dvec3(-1.0, 1.6, 0.1), dvec3(1.0, 1.6, 0.1)];
    const ROOM: [DVec2; 2] = [DVec2::splat(-3.0), DVec2::splat(3.0)];

    fn route(tracer: &Tracer) -> Vec<DVec3> {
        let corners = corners(tracer, ENDS, ROOM);
        [&ENDS[..1], &corners, &ENDS[1..]].concat()
    }

    #[test]
    fn routes_lead_around_walls() {
        // Around the nearer end of a wall, and through a gap of half a metre.
        for lines in [
            vec![[[0.0, -2.5], [0.0, 1.5]]],
            vec![[[0.0, -3.0], [0.0, 1.0]], [[0.0, 1.5], [0.0, 3.0]]],
        ] {
            let tracer = walls(&lines);
            let route = route(&tracer);
            for leg in route.windows(2) {
                assert!(is_free(&tracer, [leg[0], leg[1]], 0.02), "{route:?}");
            }
            let length: f64 = route.windows(2).map(|leg| (leg[1] - leg[0]).length()).sum();
            assert!(length > 2.5 && length < 4.5, "{length} m");
        }
    }

    #[test]
    fn routes_are_straight_without_obstacle_or_gap() {
        for lines in [
            vec![[[2.0, -3.0], [2.0, 3.0]]],
            vec![[[0.0, -4.0], [0.0, 4.0]]],
        ] {
            assert_eq!(route(&walls(&lines)), ENDS);
        }
    }
}
