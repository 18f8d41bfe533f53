//! Portals (hard case 7; C17).

use super::Case;
use super::bed::{Dice, differing, largest, look};
use glam::{DQuat, DVec3};
use headbox_core::camera::Camera;
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
                looks(seed, 91, |dice, portal| {
                    let eye = portal.middle
                        + portal.normal * dice.between(0.3, 2.0)
                        + portal.along * dice.between(-0.5, 0.5);
                    let corner =
                        portal.corners[dice.below(portal.corners.len() as u32) as usize] - eye;
                    let side = if dice.below(2) == 0 { -1.0 } else { 1.0 };
                    // The view's vertical borders stand half of the horizontal field away from its
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
                looks(seed, 92, |dice, portal| {
                    let off = [1e-9, 1e-6, 1e-3, 0.02][dice.below(4) as usize]
                        * if dice.below(2) == 0 { -1.0 } else { 1.0 };
                    let beside = dice.between(-0.25, 0.25);
                    let eye = portal.middle + portal.normal * off + portal.along * beside;
                    (
                        eye,
                        portal.along * -beside.signum() + portal.normal * dice.between(-0.2, 0.2),
                    )
                })
            },
        },
    ]
}

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const FOV_Y_DEG: f64 = 60.0;

/// The bare house.
static HOUSE: LazyLock<Option<House>> =
    LazyLock::new(|| House::new(headbox_scenes::house(0, 5_000)).ok());

/// A portal to look at.
struct PortalOpening<'a> {
    corners: &'a [DVec3],
    middle: DVec3,
    /// Unit, horizontal in a door or window.
    normal: DVec3,
    /// Unit, horizontal, in the portal's plane.
    along: DVec3,
}

/// Looks at portals by chance until some eyes stood in cells: the largest number of pixels that
/// culling changes.
fn looks(
    seed: u64,
    stream: u64,
    aim: impl Fn(&mut Dice, &PortalOpening) -> (DVec3, DVec3),
) -> Option<f64> {
    const LOOKS: usize = 6;
    const MOST_TRIES: usize = 200;
    let mut dice = Dice::new(seed, stream);
    let house = HOUSE.as_ref()?;
    let portals = &house.plan().portals;
    let mut found = Vec::new();
    for _ in 0..MOST_TRIES {
        let corners = &portals[dice.below(portals.len() as u32) as usize].polygon;
        let normal = (corners[1] - corners[0])
            .cross(corners[2] - corners[0])
            .normalize_or_zero();
        let opening = PortalOpening {
            corners,
            middle: corners.iter().sum::<DVec3>() / corners.len() as f64,
            normal,
            along: DVec3::Y.cross(normal).normalize_or_zero(),
        };
        let (eye, forward) = aim(&mut dice, &opening);
        // Eyes in walls see all cells anyway.
        if house.cell_of_eye(eye).is_some() && forward.length() > 0.1 {
            found.push(changed_by_culling(
                house,
                &look(eye, forward, FOV_Y_DEG, [WIDTH, HEIGHT]).ok()?,
            ));
        }
        if found.len() == LOOKS {
            return largest(found);
        }
    }
    None
}

/// Pixels in which a frame of what shows through portals differs from one of all cells.
fn changed_by_culling(house: &House, camera: &Camera) -> Option<f64> {
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
        hole_color_srgb: settings.warp.hole_color_srgb,
    };
    let mut rasterizer = Rasterizer::new();
    let (whole, _) = rasterizer.draw(house.mesh(), camera, &view, house.sky());
    Some(differing(culled, &whole.frame, 0) as f64)
}
