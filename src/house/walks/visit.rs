//! Cells that a frame draws as geometry, and portals at which backdrops begin.

use super::settings::WalkSettings;
use crate::backdrop::{Backdrop, BackdropKind, PortalSide};
use crate::house::House;
use crate::portal_culling;
use crate::portal_culling::{CellView, VisibleCells};
use crate::store::{Key, Store};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_raster::GroupWindow;
use std::ops::Range;
use std::sync::Arc;

/// Portal behind which a backdrop is drawn.
pub(crate) struct BackdropPortal {
    pub(crate) at: PortalSide,
    pub(crate) backdrop: Arc<Backdrop>,
    /// Columns and rows of the frame that it can cover.
    pub(crate) window: [Range<u32>; 2],
}

/// Cells and portals of a frame.
pub(crate) struct Visit {
    /// Cells that are drawn as geometry.
    pub(crate) groups: Vec<GroupWindow>,
    /// Portals where backdrops begin.
    pub(super) boundaries: Vec<BackdropPortal>,
    /// Portals that were passed because their backdrop is missing.
    pub(crate) missing: Vec<PortalSide>,
    /// False if portal culling stopped at a limit.
    pub(crate) is_complete: bool,
}

/// Visits the cells that are visible from the eye's cell; without one, all cells are drawn as
/// geometry.
pub(crate) fn visit(
    house: &House,
    store: &Store,
    camera: &Camera,
    settings: &WalkSettings,
    cell: Option<u32>,
) -> Visit {
    let mut boundaries: Vec<BackdropPortal> = Vec::new();
    let mut missing = Vec::new();
    let Some(cell) = cell else {
        let whole = |group| GroupWindow {
            group,
            window: None,
        };
        return Visit {
            groups: (0..house.mesh().group_count() as u32).map(whole).collect(),
            boundaries,
            missing,
            is_complete: true,
        };
    };
    let near = settings.near.distance_m(camera);
    let VisibleCells { views, is_complete } = portal_culling::visible_cells(
        house.plan(),
        camera,
        cell,
        &settings.limits,
        |portal, view| {
            let Some(kind) = settings.backdrops else {
                return true;
            };
            let Some(at) = side_toward(house, portal, view.cell) else {
                return true;
            };
            let opening = at.opening(house);
            if opening.is_none_or(|opening| opening.distance(camera.eye()) < near) {
                return true;
            }
            let window = view.window.rectangle(camera);
            if let Some(known) = boundaries.iter_mut().find(|boundary| boundary.at == at) {
                known.window = union(&known.window, &window);
                return false;
            }
            let Some(backdrop) = store.get((at, kind)) else {
                missing.push(at);
                return true;
            };
            boundaries.push(BackdropPortal {
                at,
                backdrop,
                window,
            });
            false
        },
    );
    Visit {
        groups: group_windows(&views, camera),
        boundaries,
        missing,
        is_complete,
    }
}

/// Returns the side of a portal that looks into a cell.
fn side_toward(house: &House, portal: u32, cell: u32) -> Option<PortalSide> {
    let cells = house.plan().portals.get(portal as usize)?.cells;
    Some(PortalSide {
        portal,
        side: u8::from(cells[0] == cell),
    })
}

/// Returns each visited cell once, with the bounding rectangle of its windows.
fn group_windows(views: &[CellView], camera: &Camera) -> Vec<GroupWindow> {
    let mut groups: Vec<GroupWindow> = Vec::new();
    for view in views {
        let window = view.window.rectangle(camera);
        match groups.iter_mut().find(|group| group.group == view.cell) {
            Some(group) => group.window = group.window.as_ref().map(|known| union(known, &window)),
            None => groups.push(GroupWindow {
                group: view.cell,
                window: Some(window),
            }),
        }
    }
    groups
}

/// Returns the smallest rectangle that contains two others.
pub(super) fn union(a: &[Range<u32>; 2], b: &[Range<u32>; 2]) -> [Range<u32>; 2] {
    [0, 1].map(|i| a[i].start.min(b[i].start)..a[i].end.max(b[i].end))
}

/// Returns the backdrops that an eye is likely to need, most likely first: those of its own cell by
/// distance, then those of the adjacent cells.
pub fn likely_backdrops(house: &House, eye: DVec3, kind: BackdropKind) -> Vec<Key> {
    let Some(cell) = house.find_cell(eye) else {
        return Vec::new();
    };
    let sides = |cell: u32| {
        let portals = house.plan().portals_from(cell);
        let mut sides: Vec<(f64, PortalSide, u32)> = portals
            .filter_map(|(portal, behind)| {
                let at = side_toward(house, portal as u32, behind)?;
                Some((at.opening(house)?.distance(eye), at, behind))
            })
            .collect();
        sides.sort_by(|a, b| a.0.total_cmp(&b.0));
        sides
    };
    let mut wanted: Vec<Key> = Vec::new();
    let own = sides(cell);
    let next = own.iter().flat_map(|(_, _, behind)| sides(*behind));
    for (_, at, _) in own.iter().cloned().chain(next) {
        if !wanted.contains(&(at, kind)) {
            wanted.push((at, kind));
        }
    }
    wanted
}
