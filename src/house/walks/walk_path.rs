//! Seeded camera path through every room, like the papers' path of 520 poses (R-N4).

use super::route;
use crate::house::House;
use crate::portal_opening::{Opening, polygon_edges};
use glam::{DVec2, DVec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_model::{Portal, PortalModel};
use headbox_trace::sampler::random4;
use headbox_trace::viewpoint::suggest_view;

/// Number of poses of the papers' path.
pub const PAPER_POSES: usize = 520;

/// Parameters of a walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkPath {
    /// Number of poses.
    pub poses: usize,
    /// Frame size, px.
    pub size: [u32; 2],
    /// Vertical field of view, degrees.
    pub fov_y_deg: f64,
    /// Height of the eye above the floor, metres.
    pub eye_height_m: f64,
    /// Seed of the starting point, of the order of rooms, and of the head's rotation.
    pub seed: u32,
}

impl Default for WalkPath {
    fn default() -> Self {
        Self {
            poses: PAPER_POSES,
            size: [640, 512],
            fov_y_deg: 60.0,
            eye_height_m: 1.6,
            seed: 0,
        }
    }
}

/// Distance in front of and behind a portal within which the path is perpendicular to it, metres.
const APPROACH_M: f64 = 0.45;
/// Look-ahead distance along the path, metres.
const AHEAD_M: f64 = 1.2;
/// Largest height of a door's lower edge above the floor, metres; higher portals are windows.
const SILL_M: f64 = 0.3;
/// Smallest height of a door, metres.
const DOOR_HEIGHT_M: f64 = 1.5;
/// Smallest width of a door, metres.
const DOOR_WIDTH_M: f64 = 0.3;

impl WalkPath {
    /// Returns the cameras, equally spaced along a walk that enters every cell which doors connect
    /// to the first (the outside only if there is no other way). Empty if the model has no cell
    /// except an outside.
    ///
    /// # Errors
    /// [`CameraError`] if the size or the field of view is invalid.
    pub fn cameras(&self, house: &House) -> Result<Vec<Camera>, CameraError> {
        let line = self.line(house);
        let Some(first) = line.first() else {
            return Ok(Vec::new());
        };
        let mut lengths = vec![0.0];
        for pair in line.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + (pair[1] - pair[0]).length());
        }
        let total = lengths[lengths.len() - 1];
        let at = |s: f64| {
            let s = s.clamp(0.0, total);
            let i = lengths
                .partition_point(|&l| l <= s)
                .clamp(1, line.len().max(2) - 1);
            match (line.get(i - 1), line.get(i)) {
                (Some(a), Some(b)) => {
                    let span = (lengths[i] - lengths[i - 1]).max(1e-9);
                    *a + (*b - *a) * ((s - lengths[i - 1]) / span).clamp(0.0, 1.0)
                }
                _ => *first,
            }
        };
        let pose = |k: usize| {
            let s = total * k as f64 / self.poses.max(2).saturating_sub(1) as f64;
            let eye = at(s);
            // The mean of several points ahead turns the head smoothly where the path reverses.
            let ahead = (1..=6)
                .map(|j| at(s + AHEAD_M * f64::from(j) / 3.0))
                .sum::<DVec3>()
                / 6.0
                - eye;
            let ahead = if ahead.length() > 0.05 {
                ahead
            } else {
                at(s + 0.01) - at(s - AHEAD_M)
            };
            let phase = s * 0.35 + f64::from(self.seed);
            let turn = DVec2::from_angle(0.5 * phase.sin());
            let flat = turn.rotate(DVec2::new(ahead.x, ahead.z));
            let flat = if flat.length() > 1e-6 {
                flat.normalize()
            } else {
                DVec2::X
            };
            let look = eye + DVec3::new(flat.x, 0.12 * (phase * 1.7).sin() - 0.05, flat.y);
            Camera::look_at(eye, look, DVec3::Y, self.fov_y_deg, self.size)
        };
        (0..self.poses).map(pose).collect()
    }

    /// Returns the length of the walk, metres.
    pub fn length_m(&self, house: &House) -> f64 {
        let line = self.line(house);
        line.windows(2)
            .map(|pair| (pair[1] - pair[0]).length())
            .sum()
    }

    /// Returns the first camera of a walk, if there is room to stand.
    ///
    /// # Errors
    /// Same as for [`Self::cameras`].
    pub fn first(house: &House) -> Result<Option<Camera>, CameraError> {
        let walk = Self {
            poses: 1,
            ..Self::default()
        };
        Ok(walk.cameras(house)?.first().copied())
    }

    /// Returns the default view of a house: from the start of a walk, or from the middle of the
    /// model if there is no room to stand, toward what there is to see.
    ///
    /// # Errors
    /// Same as for [`Self::cameras`].
    pub fn first_view(house: &House) -> Result<Camera, CameraError> {
        let walk = Self::default();
        let eye = Self::first(house)?.map_or(house.tracer().origin(), |camera| camera.eye());
        let ahead = eye + suggest_view(house.tracer(), eye);
        Camera::look_at(eye, ahead, DVec3::Y, walk.fov_y_deg, walk.size)
    }

    /// Returns the names of the rooms that the walk does not enter: no door connects them to its
    /// start, or they have no room to stand.
    pub fn unvisited<'a>(&self, house: &'a House) -> Vec<&'a str> {
        let plan = house.plan();
        let (_, visited) = self.stops(house);
        let cells = (0_u32..)
            .zip(&plan.cells)
            .filter(|(cell, _)| plan.outside != Some(*cell));
        cells
            .filter(|(cell, _)| !visited[*cell as usize])
            .map(|(_, cell)| cell.name.as_str())
            .collect()
    }

    /// Returns the corners of the walk, world metres. Where it can, it goes around walls, and around
    /// furniture that reaches up to the eyes.
    fn line(&self, house: &House) -> Vec<DVec3> {
        around_obstacles(house, &self.stops(house).0)
    }

    /// Returns the stops of the walk, and for each cell true if the walk enters it. The walk is a
    /// depth-first tour of the rooms and back, from the start that reaches the most rooms.
    fn stops(&self, house: &House) -> (Vec<Stop>, Vec<bool>) {
        let count = house.plan().cells.len();
        let rooms: Vec<u32> = (0..count as u32)
            .filter(|&cell| self.standing_point(house, cell).is_some())
            .collect();
        let begin = self.random(0) as usize % rooms.len().max(1);
        let mut best = (Vec::new(), vec![false; count]);
        let entered = |visited: &[bool]| visited.iter().filter(|v| **v).count();
        let mut seen = vec![false; count];
        for &start in rooms[begin..].iter().chain(&rooms[..begin]) {
            // A walk from a cell that an earlier walk entered would enter the same cells.
            if seen[start as usize] {
                continue;
            }
            let mut walk = (Vec::new(), vec![false; count]);
            self.tour(house, start, &mut walk.1, &mut walk.0);
            for (seen, entered) in seen.iter_mut().zip(&walk.1) {
                *seen |= entered;
            }
            if entered(&walk.1) > entered(&best.1) {
                best = walk;
            }
        }
        best
    }

    /// Returns a random number of a stream.
    fn random(&self, stream: u32) -> u32 {
        random4([self.seed, stream, 0x7a1c, 0])[0]
    }

    /// Appends a depth-first tour of the unvisited rooms from `start` and back to `stops`.
    fn tour(&self, house: &House, start: u32, visited: &mut [bool], stops: &mut Vec<Stop>) {
        let plan = house.plan();
        let stop = |point| Stop {
            point,
            cell: Some(start),
        };
        visited[start as usize] = true;
        stops.extend(self.standing_point(house, start).map(stop));
        let mut doors: Vec<(usize, u32)> = plan
            .portals_from(start)
            .filter(|&(_, next)| plan.outside != Some(next))
            .collect();
        doors.sort_by_key(|&(portal, _)| self.random(portal as u32 + 1));
        for (portal, next) in doors {
            if visited[next as usize] || self.standing_point(house, next).is_none() {
                continue;
            }
            let Some([here, middle, there]) = self.passage(plan, portal, start) else {
                continue;
            };
            let in_door = Stop {
                point: middle,
                cell: None,
            };
            let beyond = Stop {
                point: there,
                cell: Some(next),
            };
            stops.extend([stop(here), in_door, beyond]);
            self.tour(house, next, visited, stops);
            stops.extend([beyond, in_door, stop(here)]);
            stops.extend(self.standing_point(house, start).map(stop));
        }
    }

    /// Returns a point of a cell at eye height: the mean of its largest prism's corners or, if that
    /// is outside or in a wall or furniture, the first midpoint of two corners that is not, or that
    /// is inside at all. `None` for the outside.
    fn standing_point(&self, house: &House, number: u32) -> Option<DVec3> {
        let cell = house.plan().cells.get(number as usize)?;
        let area = |outline: &[DVec2]| {
            let twice: f64 = polygon_edges(outline).map(|(a, b)| a.perp_dot(b)).sum();
            twice.abs()
        };
        let prism = cell
            .space
            .iter()
            .max_by(|a, b| area(&a.outline).total_cmp(&area(&b.outline)))?;
        let y = prism.floor_y + self.eye_height_m;
        let lift = |p: DVec2| DVec3::new(p.x, y.min(prism.ceiling_y - 0.1), p.y);
        let corners = &prism.outline;
        let middle = corners.iter().sum::<DVec2>() / corners.len().max(1) as f64;
        let between = corners
            .iter()
            .flat_map(|a| corners.iter().map(move |b| (*a + *b) / 2.0));
        let mut inside = std::iter::once(middle)
            .chain(between)
            .map(lift)
            .filter(|p| prism.contains(*p));
        let first = inside.next()?;
        let is_free = |p: &DVec3| house.find_cell(*p) == Some(number);
        let free = std::iter::once(first).chain(inside).find(is_free);
        Some(free.unwrap_or(first))
    }

    /// Returns the points in front of, in and behind a door, from a cell; `None` for a window.
    fn passage(&self, plan: &PortalModel, portal: usize, from: u32) -> Option<[DVec3; 3]> {
        let (opening, floor) = door(plan, plan.portals.get(portal)?, from)?;
        let top = opening.centre.y + opening.half.y - 0.1;
        let middle = DVec3::new(
            opening.centre.x,
            (floor + self.eye_height_m).min(top),
            opening.centre.z,
        );
        Some([
            middle + opening.normal * APPROACH_M,
            middle,
            middle - opening.normal * APPROACH_M,
        ])
    }
}

/// A point of a walk.
#[derive(Clone, Copy)]
struct Stop {
    point: DVec3,
    /// Cell that contains the point; `None` in a door.
    cell: Option<u32>,
}

/// Returns the points of a walk along some stops, around what stands between two of one cell.
fn around_obstacles(house: &House, stops: &[Stop]) -> Vec<DVec3> {
    let mut line: Vec<DVec3> = stops.first().map(|stop| stop.point).into_iter().collect();
    for pair in stops.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        if from.cell == to.cell
            && let Some(bounds) = to.cell.and_then(|cell| floor_bounds(house, cell))
        {
            let ends = [from.point, to.point];
            line.extend(route::corners(house.tracer(), ends, bounds));
        }
        line.push(to.point);
    }
    line
}

/// Returns the bounds of a cell in x and z, world metres.
fn floor_bounds(house: &House, cell: u32) -> Option<[DVec2; 2]> {
    let space = &house.plan().cells.get(cell as usize)?.space;
    let mut corners = space.iter().flat_map(|prism| prism.outline.iter().copied());
    let first = corners.next()?;
    let widen = |[low, high]: [DVec2; 2], corner: DVec2| [low.min(corner), high.max(corner)];
    Some(corners.fold([first; 2], widen))
}

/// Returns the opening of a door as seen from one of its cells, and the height of that cell's
/// floor; `None` for a window.
pub fn door(plan: &PortalModel, portal: &Portal, from: u32) -> Option<(Opening, f64)> {
    let opening = Opening::new(portal, usize::from(portal.cells[0] != from))?;
    let floor = plan
        .cells
        .get(from as usize)?
        .space
        .iter()
        .map(|p| p.floor_y)
        .fold(f64::INFINITY, f64::min);
    let sill = opening.centre.y - opening.half.y;
    let too_small = 2.0 * opening.half.y < DOOR_HEIGHT_M || 2.0 * opening.half.x < DOOR_WIDTH_M;
    (sill <= floor + SILL_M && !too_small).then_some((opening, floor))
}
