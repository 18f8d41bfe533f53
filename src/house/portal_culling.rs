//! Portal culling: visible cells, each with the window of the frame through which it is visible;
//! portals are clipped by portals (R1).
//!
//! Starting from the eye's cell, each portal's polygon is clipped by the *window* through which its
//! cell is visible; the result is the window of the cell behind, and so on. All clipping is on
//! directions from the eye: a window is a convex cone with the eye as its apex, bounded by planes
//! through the eye. There is no division, and a polygon that extends behind the eye is no special
//! case. (Windows on the image plane would need near-plane clipping first.)
//!
//! * The frame is the first window: a cone of four planes.
//! * A portal very close to the eye has no accurate cone, since rounding dominates the side test
//!   of its plane. Such a portal passes the window on unclipped, which is conservative.
//! * A portal is visible only from the side of the cell it is entered from.
//! * Cycles: a cell is entered again only through a part of the frame; each step clips. As cones
//!   only shrink, and a line of sight crosses each portal's plane once, no portal can occur twice
//!   on a path; the path's portals are skipped, which bounds the recursion by the number of
//!   portals. [`Limits`] bound it further.

use crate::portal_opening::polygon_edges;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_model::PortalModel;

/// A convex cone of directions from the eye: those d with `plane . d >= 0` for all of its planes.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Directions of the edges, world axes, any length, counter-clockwise seen from the eye.
    edges: Vec<DVec3>,
}

impl Window {
    /// Returns the window of a camera.
    pub fn from_camera(camera: &Camera) -> Self {
        let (w, h) = (f64::from(camera.width()), f64::from(camera.height()));
        Self {
            edges: [[0.0, h], [w, h], [w, 0.0], [0.0, 0.0]]
                .map(|[x, y]| camera.direction(x, y))
                .to_vec(),
        }
    }

    /// Returns the bounding planes: inward unit normals.
    fn planes(&self) -> impl Iterator<Item = DVec3> + '_ {
        polygon_edges(&self.edges).filter_map(|(a, b)| b.cross(a).try_normalize())
    }

    /// Returns true if the window contains a direction, or misses it by at most `slack` (a sine).
    pub fn contains(&self, direction: DVec3, slack: f64) -> bool {
        let direction = direction.normalize_or_zero();
        self.planes().all(|plane| plane.dot(direction) >= -slack)
    }

    /// Clips a convex polygon of directions, counter-clockwise seen from the eye, to the window;
    /// `None` if no area is left.
    fn clip(&self, polygon: &[DVec3]) -> Option<Self> {
        let mut edges = polygon.to_vec();
        for plane in self.planes() {
            let mut clipped = Vec::with_capacity(edges.len() + 1);
            for (here, there) in polygon_edges(&edges) {
                // The window is enlarged slightly, so that rounding never closes it.
                let [a, b] = [here, there].map(|d| plane.dot(d) + SLACK * d.length());
                if a >= 0.0 {
                    clipped.push(here);
                }
                if (a >= 0.0) != (b >= 0.0) {
                    clipped.push(here + (there - here) * (a / (a - b)));
                }
            }
            edges = clipped;
        }
        (edges.len() >= 3).then_some(Self { edges })
    }

    /// Returns a rectangle of pixels, columns and rows, that contains every pixel whose centre is
    /// in the window.
    pub fn rectangle(&self, camera: &Camera) -> [std::ops::Range<u32>; 2] {
        let size = [camera.width(), camera.height()];
        let points: Option<Vec<[f64; 3]>> = self
            .edges
            .iter()
            .map(|d| camera.project(camera.eye() + *d))
            .collect();
        // An edge beside or behind the eye does not bound the rectangle.
        let Some(points) =
            points.filter(|points| points.iter().all(|p| p[0].is_finite() && p[1].is_finite()))
        else {
            return size.map(|pixels| 0..pixels);
        };
        [0, 1].map(|axis| {
            let positions = || points.iter().map(move |p| p[axis]);
            let first = positions().fold(f64::INFINITY, f64::min).floor() - 1.0;
            let last = positions().fold(f64::NEG_INFINITY, f64::max).ceil() + 1.0;
            let clamp = |v: f64| v.clamp(0.0, f64::from(size[axis])) as u32;
            clamp(first)..clamp(last)
        })
    }
}

/// Enlargement of windows (a sine): some thousandths of a pixel.
const SLACK: f64 = 1e-5;

/// Limits of the recursion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Maximum number of portals on a line of sight. Cells behind more are not visible: a house of
    /// 19 cells has no line of sight through more.
    pub depth: usize,
    /// Maximum number of views. Then portals are no longer followed.
    pub views: usize,
    /// Distance below which a portal is passed unclipped, metres.
    pub touching_m: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            depth: 32,
            views: 4096,
            touching_m: 1e-3,
        }
    }
}

/// A cell seen through a sequence of portals.
#[derive(Clone, Debug, PartialEq)]
pub struct CellView {
    /// The cell.
    pub cell: u32,
    /// Portals from the eye to the cell; none for the eye's own cell.
    pub portals: Vec<u32>,
    /// Part of the frame in which the cell is visible.
    pub window: Window,
}

/// Cells that are visible from an eye.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleCells {
    /// The eye's own cell first, then in depth-first order, portals by index.
    pub views: Vec<CellView>,
    /// False if a limit was reached, so that cells may be missing.
    pub is_complete: bool,
}

/// Visibility of a portal from the eye.
enum PortalVisibility {
    /// Seen from behind, or without area.
    Closed,
    /// Too near for an accurate outline.
    Touching,
    /// Visible: directions of its corners, counter-clockwise seen from the eye.
    Outline(Vec<DVec3>),
}

/// Returns the cells that are visible from `eye_cell`. `open` returns true if a portal may be
/// passed out of a cell: a walk stops where a backdrop begins.
pub fn visible_cells(
    model: &PortalModel,
    camera: &Camera,
    eye_cell: u32,
    limits: &Limits,
    mut open: impl FnMut(u32, &CellView) -> bool,
) -> VisibleCells {
    let first = CellView {
        cell: eye_cell,
        portals: Vec::new(),
        window: Window::from_camera(camera),
    };
    let mut views = Vec::new();
    let mut is_complete = true;
    let mut stack = vec![first];
    while let Some(view) = stack.pop() {
        if views.len() >= limits.views {
            is_complete = false;
            break;
        }
        let mut behind = Vec::new();
        for (portal, cell) in model.portals_from(view.cell) {
            let number = portal as u32;
            if view.portals.contains(&number) {
                continue;
            }
            let window = match visibility(model, camera.eye(), portal, view.cell, limits) {
                PortalVisibility::Closed => None,
                PortalVisibility::Touching => Some(view.window.clone()),
                PortalVisibility::Outline(outline) => view.window.clip(&outline),
            };
            let Some(window) = window else { continue };
            if view.portals.len() >= limits.depth {
                is_complete = false;
                break;
            }
            let next = CellView {
                cell,
                portals: [view.portals.as_slice(), &[number]].concat(),
                window,
            };
            if open(number, &next) {
                behind.push(next);
            }
        }
        stack.extend(behind.into_iter().rev());
        views.push(view);
    }
    VisibleCells { views, is_complete }
}

/// Determines the visibility of a portal of `cell` from an eye in the cell.
fn visibility(
    model: &PortalModel,
    eye: DVec3,
    portal: usize,
    cell: u32,
    limits: &Limits,
) -> PortalVisibility {
    let portal = &model.portals[portal];
    let mut outline: Vec<DVec3> = portal.polygon.iter().map(|corner| *corner - eye).collect();
    if portal.cells[0] != cell {
        outline.reverse();
    }
    // Newell's normal, towards the cell; its length is twice the area.
    let normal: DVec3 = polygon_edges(&outline).map(|(a, b)| a.cross(b)).sum();
    let (Some(normal), Some(corner)) = (normal.try_normalize(), outline.first()) else {
        return PortalVisibility::Closed;
    };
    let in_front = -normal.dot(*corner);
    if in_front.abs() <= limits.touching_m
        && distance_to_outline(&outline, normal) <= limits.touching_m
    {
        return PortalVisibility::Touching;
    }
    if in_front <= 0.0 {
        PortalVisibility::Closed
    } else {
        PortalVisibility::Outline(outline)
    }
}

/// Returns the distance of the origin's projection from a convex polygon, in the polygon's plane.
/// The polygon is counter-clockwise about its unit normal.
fn distance_to_outline(outline: &[DVec3], normal: DVec3) -> f64 {
    let outside = polygon_edges(outline).filter_map(|(a, b)| {
        let outward = (b - a).cross(normal).try_normalize()?;
        Some(-outward.dot(a))
    });
    outside.fold(0.0, f64::max)
}
