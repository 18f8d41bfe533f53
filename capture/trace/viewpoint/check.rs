//! Warnings about a requested headbox, with a better one.

use super::place::{
    EYE_HEIGHT_M, TRIES, find_floor, seeded_place, suggest_half_size, suggest_headbox,
};
use super::{Surroundings, cast, look_around, spread_direction};
use crate::bvh::Tracer;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, figure, triple};
use headbox_core::headbox::Headbox;
use rayon::prelude::*;

/// Fraction of visible back faces from which a place is inside a solid.
const SOLID_BACKS: f64 = 0.99;
/// Fraction of visible back faces from which a narrow place is inside a wall.
const WALL_BACKS: f64 = 0.5;
/// Median distance of a place inside a wall, relative to that of the suggested place.
const WALL_MEDIAN_SHARE: f64 = 0.25;
/// Median distance below which any place is inside something, relative to that of the suggested
/// place.
const CRAMPED_MEDIAN_SHARE: f64 = 0.05;
/// Fraction of directions with surfaces below which a place shows nothing.
const MIN_VISIBLE: f64 = 0.01;
/// Half-size relative to the one that fits, below which a headbox is too small: a tenth of the
/// distance to the nearest surface.
const SMALL_SHARE: f64 = 0.2;

/// Half-size that fits, relative to that at the suggested place, below which a place is cramped:
/// between the panes of a window, or just outside a wall.
const CRAMPED_SHARE: f64 = 0.1;

/// Flaw of a requested headbox.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadboxFlaw {
    /// The centre is inside a wall or a solid.
    InsideSolid,
    /// The scene is hardly visible from the centre.
    NothingVisible,
    /// Surfaces reach into the box.
    SurfacesInside,
    /// The box is much smaller than the free space around its centre.
    TooSmall,
    /// The space around the centre is much narrower than usual in the scene.
    Cramped,
}

/// Flaw of a requested headbox, and a better headbox.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadboxWarning {
    /// The flaw.
    pub flaw: HeadboxFlaw,
    /// The requested headbox, world metres.
    pub requested: Headbox,
    /// The better headbox: at another place, or of another half-size.
    pub better: Headbox,
}

/// Checks a requested headbox; returns its gravest flaw.
pub fn check_headbox(tracer: &Tracer, headbox: &Headbox) -> Option<HeadboxWarning> {
    let around = look_around(tracer, headbox.centre);
    let fitting_m = suggest_half_size(tracer, headbox.centre);
    let reference = suggest_headbox(tracer).centre;
    let usual = look_around(tracer, reference);
    let has_surfaces = has_surfaces_inside(tracer, headbox);
    let flaw = if around.enclosed < MIN_VISIBLE {
        HeadboxFlaw::NothingVisible
    } else if is_inside_solid(&around, &usual) {
        HeadboxFlaw::InsideSolid
    } else if has_surfaces {
        HeadboxFlaw::SurfacesInside
    } else if headbox.half_size_m < SMALL_SHARE * fitting_m {
        HeadboxFlaw::TooSmall
    } else if fitting_m < CRAMPED_SHARE * suggest_half_size(tracer, reference) {
        HeadboxFlaw::Cramped
    } else {
        return None;
    };
    let better = match flaw {
        HeadboxFlaw::TooSmall => Headbox {
            half_size_m: fitting_m,
            ..*headbox
        },
        HeadboxFlaw::SurfacesInside if fitting_m < headbox.half_size_m => Headbox {
            half_size_m: fitting_m,
            ..*headbox
        },
        _ => {
            let clearance_m = if flaw == HeadboxFlaw::Cramped {
                usual.clearance_m / 2.0
            } else {
                (2.0 * headbox.half_size_m).min(usual.clearance_m)
            };
            let nearest = nearest_place(tracer, headbox.centre, &usual, clearance_m);
            Headbox {
                centre: nearest.unwrap_or(reference),
                ..*headbox
            }
        }
    };
    Some(HeadboxWarning {
        flaw,
        requested: *headbox,
        better,
    })
}

/// Returns true if a place is inside a wall or a solid, compared with the suggested place of the
/// scene.
fn is_inside_solid(around: &Surroundings, usual: &Surroundings) -> bool {
    let narrow = |share: f64| around.median_m < share * usual.median_m;
    around.backs >= SOLID_BACKS.max(usual.backs)
        || (around.backs > WALL_BACKS && narrow(WALL_MEDIAN_SHARE))
        || narrow(CRAMPED_MEDIAN_SHARE)
}

/// Returns true if a surface is inside the box, visible from its centre.
fn has_surfaces_inside(tracer: &Tracer, headbox: &Headbox) -> bool {
    (0..super::DIRECTIONS).any(|i| {
        let direction = spread_direction(i);
        let reach = headbox.half_size_m / f64::from(direction.abs().max_element());
        cast(tracer, headbox.centre, direction).is_some_and(|hit| f64::from(hit.t) < reach)
    })
}

/// Returns the place nearest to `wanted` that is as free and as enclosed as usual, of seeded places
/// in the scene and around `wanted`: where a person can stand, at the height of the eyes; else
/// anywhere.
fn nearest_place(
    tracer: &Tracer,
    wanted: DVec3,
    usual: &Surroundings,
    clearance_m: f64,
) -> Option<DVec3> {
    let [low, high] = tracer.scene().bounds();
    let reach = usual.median_m.min((high - low).length());
    let is_good = |place: &DVec3| {
        let around = look_around(tracer, *place);
        around.clearance_m >= clearance_m
            && around.backs < WALL_BACKS.max(usual.backs)
            && around.enclosed >= 0.5 * usual.enclosed
            && !is_inside_solid(&around, usual)
    };
    let seeded = |i: u32| {
        if i.is_multiple_of(2) {
            seeded_place(i, low, high)
        } else {
            seeded_place(i, wanted - reach, wanted + reach)
        }
    };
    let standing = |place: DVec3| Some(find_floor(tracer, place)? + DVec3::Y * EYE_HEIGHT_M);
    let nearest = |candidate: &(dyn Fn(DVec3) -> Option<DVec3> + Sync)| {
        (0..2 * TRIES)
            .into_par_iter()
            .filter_map(|i| Some((i, candidate(seeded(i))?)))
            .filter(|(_, place)| is_good(place))
            .min_by(|(i, a), (j, b)| {
                let order = a.distance(wanted).total_cmp(&b.distance(wanted));
                order.then(i.cmp(j))
            })
            .map(|(_, place)| place)
    };
    nearest(&standing).or_else(|| nearest(&Some))
}

impl HeadboxWarning {
    /// Formats the warning as one line, with an option to paste in the file's axes and unit.
    pub fn sentence(&self, frame: &FileFrame) -> String {
        let flaw = match self.flaw {
            HeadboxFlaw::InsideSolid => "the centre of the headbox is inside a wall or a solid",
            HeadboxFlaw::NothingVisible => {
                "the scene is hardly visible from the centre of the headbox"
            }
            HeadboxFlaw::SurfacesInside => {
                "surfaces reach into the headbox and hide what is behind them"
            }
            HeadboxFlaw::TooSmall => {
                "the headbox is much smaller than the free space around its centre"
            }
            HeadboxFlaw::Cramped => {
                "there is hardly any free space around the centre of the headbox"
            }
        };
        if self.better.centre == self.requested.centre {
            let half_size = figure(self.better.half_size_m / frame.unit_m);
            format!("{flaw}; one that fits: --half-size {half_size}")
        } else {
            let centre = triple(frame.file_from_world(self.better.centre));
            format!("{flaw}; the nearest good place: --center {centre}")
        }
    }
}
