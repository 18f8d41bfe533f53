//! Cases of portals (hard case 7; C17).

use super::Case;
use super::fixtures::{case_rng, differing_pixels, largest, look_along};
use glam::{DQuat, DVec3};
use headbox_core::camera::Camera;
use headbox_core::random::Rng;
use headbox_house::house::House;
use headbox_house::settings::WalkSettings;
use headbox_house::store::Store;
use headbox_house::walk::Walker;
use headbox_raster::{GroupWindow, RasterView, Rasterizer};
use std::sync::LazyLock;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "portals at the border of the view",
            what: "Walks through a house of 52 doors and windows: pixels in which frames of what shows through portals differ from frames of all cells, a corner of a portal exactly on the frame's left or right border.",
            unit: "px",
            bound: 2.0,
            reason: "A portal that shows in one pixel must not be culled, and windows are wider than they are by some thousandths of a pixel; but the rasteriser snaps corners to 1/256 px, and a pixel whose middle is as near as that to the edge of an opening may show what lies behind the wall.",
            measure: |seed| {
                largest_culling_change(seed, 91, |rng, portal| {
                    let eye = portal.middle
                        + portal.normal * rng.between(0.3, 2.0)
                        + portal.along * rng.between(-0.5, 0.5);
                    let corner =
                        portal.corners[rng.below(portal.corners.len() as u64) as usize] - eye;
                    let side = if rng.below(2) == 0 { -1.0 } else { 1.0 };
                    // The left and right borders are half of the horizontal field of view from the
                    // middle.
                    let flat = corner.with_y(0.0).normalize_or_zero();
                    let aspect = f64::from(WIDTH) / f64::from(HEIGHT);
                    let half_field = (aspect * (FOV_Y_DEG / 2.0).to_radians().tan()).atan();
                    (eye, DQuat::from_rotation_y(side * half_field) * flat)
                })
            },
        },
        Case {
            name: "portals seen edge-on",
            what: "The same from eyes in the opening, within 1e-9, 1e-6, 1e-3 and 0.02 m of a portal's plane on either side, looking along it.",
            unit: "px",
            bound: 2.0,
            reason: "A portal too near for its outline to be trusted is passed unclipped; seen at a slant it is clipped in f64. The same pixel.",
            measure: |seed| {
                largest_culling_change(seed, 92, |rng, portal| {
                    let off = [1e-9, 1e-6, 1e-3, 0.02][rng.below(4) as usize]
                        * if rng.below(2) == 0 { -1.0 } else { 1.0 };
                    let beside = rng.between(-0.25, 0.25);
                    let eye = portal.middle + portal.normal * off + portal.along * beside;
                    (
                        eye,
                        portal.along * -beside.signum() + portal.normal * rng.between(-0.2, 0.2),
                    )
                })
            },
        },
    ]
}

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const FOV_Y_DEG: f64 = 60.0;

/// The built-in house with little furniture.
static HOUSE: LazyLock<Option<House>> =
    LazyLock::new(|| House::new(headbox_scenes::house(0, 5_000)).ok());

/// Geometry of a portal.
struct PortalOpening<'a> {
    corners: &'a [DVec3],
    middle: DVec3,
    /// Unit normal, horizontal for a door or window.
    normal: DVec3,
    /// Horizontal unit vector in the portal's plane.
    along: DVec3,
}

/// Renders views of random portals from eyes in cells; returns the largest number of pixels that
/// culling changes. `aim` chooses eye and direction.
fn largest_culling_change(
    seed: u64,
    stream: u64,
    aim: impl Fn(&mut Rng, &PortalOpening) -> (DVec3, DVec3),
) -> Option<f64> {
    const VIEWS: usize = 6;
    const MOST_TRIES: usize = 200;
    let mut rng = case_rng(seed, stream);
    let house = HOUSE.as_ref()?;
    let portals = &house.plan().portals;
    let mut changes = Vec::new();
    for _ in 0..MOST_TRIES {
        let corners = &portals[rng.below(portals.len() as u64) as usize].polygon;
        let normal = (corners[1] - corners[0])
            .cross(corners[2] - corners[0])
            .normalize_or_zero();
        let opening = PortalOpening {
            corners,
            middle: corners.iter().sum::<DVec3>() / corners.len() as f64,
            normal,
            along: DVec3::Y.cross(normal).normalize_or_zero(),
        };
        let (eye, forward) = aim(&mut rng, &opening);
        // From an eye in a wall, nothing is culled.
        if house.find_cell(eye).is_some() && forward.length() > 0.1 {
            let camera = look_along(eye, forward, FOV_Y_DEG, [WIDTH, HEIGHT]).ok()?;
            changes.push(Some(changed_by_culling(house, &camera)));
        }
        if changes.len() == VIEWS {
            return largest(changes);
        }
    }
    None
}

/// Counts the pixels in which a frame with portal culling differs from one of all cells.
fn changed_by_culling(house: &House, camera: &Camera) -> f64 {
    let settings = WalkSettings::default();
    let mut walker = Walker::new();
    let (culled, _) = walker.frame(house, &Store::new(0), camera, &settings);
    let all: Vec<GroupWindow> = (0..house.mesh().group_count() as u32)
        .map(|group| GroupWindow {
            group,
            window: None,
        })
        .collect();
    let view = RasterView {
        groups: &all,
        markers: &[],
        exposure: house.lighting().exposure,
        tone: house.lighting().tone,
        hole_color_srgb: settings.warp.hole_color_srgb,
    };
    let mut rasterizer = Rasterizer::new();
    let (whole, _) = rasterizer.draw(house.mesh(), camera, &view, house.sky());
    differing_pixels(culled, &whole.frame) as f64
}
