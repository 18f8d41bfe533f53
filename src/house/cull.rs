//! Portal culling: visible cells, with the window of the frame through which each is seen; portals
//! are clipped by portals (R1).
//!
//! From the eye's cell, each portal's polygon is clipped by the *window* through which its cell is
//! seen; what is left is the window of the cell behind, and so on. All of this happens on
//! directions from the eye: a window is a convex cone with the eye as its apex, bounded by planes
//! through the eye, so that nothing is divided, and a polygon that reaches behind the eye needs no
//! special care. (Windows on the image plane would have to be clipped in front of the eye first.)
//!
//! * The frame is the first window: a cone of four planes.
//! * A portal that the eye all but touches has no cone that can be trusted: its plane's normal
//!   decides only up to rounding. Such a portal passes the window on unclipped, which can show too
//!   much, never too little.
//! * A portal shows only from the side of the cell it is entered from.
//! * Cycles: a cell is entered again only through a part of the frame; each step clips. As cones
//!   only shrink, and a line of sight crosses each portal's plane once, no portal can occur twice
//!   on a path; the path's portals are skipped, which bounds the recursion by the number of
//!   portals. [`Limits`] bound it further, toward showing more.

use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_model::PortalModel;

/// A convex cone of directions from the eye: those d with `plane . d >= 0` for all of its planes;
/// with its edges, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Directions of the edges, world axes, any length, counter-clockwise seen from the eye.
    edges: Vec<DVec3>,
}

impl Window {
    /// Returns the window of a camera.
    pub fn of_camera(camera: &Camera) -> Self {
        let (w, h) = (f64::from(camera.width()), f64::from(camera.height()));
        Self {
            edges: [[0.0, h], [w, h], [w, 0.0], [0.0, 0.0]]
                .map(|[x, y]| camera.direction(x, y))
                .to_vec(),
        }
    }

    /// The half spaces whose intersection it is: inward normals, unit length.
    fn planes(&self) -> impl Iterator<Item = DVec3> + '_ {
        let next = self.edges.iter().cycle().skip(1);
        self.edges
            .iter()
            .zip(next)
            .filter_map(|(a, b)| b.cross(*a).try_normalize())
    }

    /// Returns true if it contains a direction, or misses it by at most `slack` (a sine).
    pub fn contains(&self, direction: DVec3, slack: f64) -> bool {
        let direction = direction.normalize_or_zero();
        self.planes().all(|plane| plane.dot(direction) >= -slack)
    }

    /// The part of a convex polygon of directions, counter-clockwise seen from the eye, inside the
    /// window; `None` if there is none (or it has no area).
    fn clip(&self, polygon: &[DVec3]) -> Option<Self> {
        let mut edges = polygon.to_vec();
        for plane in self.planes() {
            let mut kept = Vec::with_capacity(edges.len() + 1);
            for (i, &here) in edges.iter().enumerate() {
                let there = edges[(i + 1) % edges.len()];
                // Grown by a hair: rounding shall never close a window.
                let [a, b] = [here, there].map(|d| plane.dot(d) + SLACK * d.length());
                if a >= 0.0 {
                    kept.push(here);
                }
                if (a >= 0.0) != (b >= 0.0) {
                    kept.push(here + (there - here) * (a / (a - b)));
                }
            }
            edges = kept;
        }
        (edges.len() >= 3).then_some(Self { edges })
    }

    /// The smallest rectangle of pixels, columns and rows, that holds every pixel whose centre the
    /// window can contain.
    pub fn rectangle(&self, camera: &Camera) -> [std::ops::Range<u32>; 2] {
        let size = [camera.width(), camera.height()];
        let points: Option<Vec<[f64; 3]>> = self
            .edges
            .iter()
            .map(|d| camera.project(camera.eye() + *d))
            .collect();
        // An edge beside or behind the eye: it bounds nothing.
        let Some(points) =
            points.filter(|points| points.iter().all(|p| p[0].is_finite() && p[1].is_finite()))
        else {
            return size.map(|pixels| 0..pixels);
        };
        [0, 1].map(|axis| {
            let of_axis = || points.iter().map(move |p| p[axis]);
            let first = of_axis().fold(f64::INFINITY, f64::min).floor() - 1.0;
            let last = of_axis().fold(f64::NEG_INFINITY, f64::max).ceil() + 1.0;
            let clamp = |v: f64| v.clamp(0.0, f64::from(size[axis])) as u32;
            clamp(first)..clamp(last)
        })
    }
}

/// Windows are wider than they are by this sine: some thousandths of a pixel.
const SLACK: f64 = 1e-5;

/// Limits of the recursion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Portals on one line of sight. Beyond, nothing is shown: a house of 19 cells has no line of
    /// sight through more.
    pub depth: usize,
    /// Views in all. Beyond, portals are no longer followed.
    pub views: usize,
    /// A portal nearer to the eye than this, metres, is passed unclipped.
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

/// A cell as it shows through one sequence of portals.
#[derive(Clone, Debug, PartialEq)]
pub struct CellView {
    /// The cell.
    pub cell: u32,
    /// The portals on the way, from the eye on; none for the eye's own cell.
    pub portals: Vec<u32>,
    /// Remaining part of the frame.
    pub window: Window,
}

/// Effect of a portal on a window.
enum PortalVisibility {
    /// It shows nothing.
    Closed,
    /// It is too near for its outline to be trusted.
    Touching,
    /// Directions of its corners, counter-clockwise seen from the eye.
    Outline(Vec<DVec3>),
}

/// The cells that show from `eye_cell`, the eye's own first, then in the order of a depth-first
/// search, portals by index. `open` says whether a portal may be passed out of a cell: a
/// walkthrough stops where an image takes over.
pub fn visible_cells(
    model: &PortalModel,
    camera: &Camera,
    eye_cell: u32,
    limits: &Limits,
    mut open: impl FnMut(u32, &CellView) -> bool,
) -> Vec<CellView> {
    let first = CellView {
        cell: eye_cell,
        portals: Vec::new(),
        window: Window::of_camera(camera),
    };
    let mut views = Vec::new();
    let mut stack = vec![first];
    while let Some(view) = stack.pop() {
        if views.len() >= limits.views {
            break;
        }
        if view.portals.len() < limits.depth {
            let mut behind = Vec::new();
            for (portal, cell) in model.portals_of(view.cell) {
                let number = portal as u32;
                if view.portals.contains(&number) {
                    continue;
                }
                let window = match passage(model, camera.eye(), portal, view.cell, limits) {
                    PortalVisibility::Closed => None,
                    PortalVisibility::Touching => Some(view.window.clone()),
                    PortalVisibility::Outline(outline) => view.window.clip(&outline),
                };
                let Some(window) = window else { continue };
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
        }
        views.push(view);
    }
    views
}

/// Tests how a portal of `cell` is seen from a point in the cell.
fn passage(
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
    // Newell's normal, which points back to the cell: its length is twice the area.
    let next = outline.iter().cycle().skip(1);
    let normal = outline
        .iter()
        .zip(next)
        .map(|(a, b)| a.cross(*b))
        .sum::<DVec3>();
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

/// Distance of the origin from a convex polygon, counter-clockwise seen from where its unit normal
/// points, in its plane.
fn distance_to_outline(outline: &[DVec3], normal: DVec3) -> f64 {
    let next = outline.iter().cycle().skip(1);
    let outside = outline.iter().zip(next).filter_map(|(a, b)| {
        let outward = (*b - *a).cross(normal).try_normalize()?;
        Some(-outward.dot(*a))
    });
    outside.fold(0.0, f64::max)
}
