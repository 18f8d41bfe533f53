//! Doors and windows of a home: the triangles that belong to them.

use super::leaves::closing_groups;
use super::plan::home::{Home, Opening};
use super::sweethome::UNIT_M;
use crate::PortalModel;
use crate::load::ModelOptions;
use crate::load::assign::Portion;
use glam::{DVec2, DVec3};
use headbox_scene::load::Group;
use std::collections::BTreeSet;

/// Groups of the export that belong to each door or window.
pub(super) struct DoorGroups {
    /// Opening of each group.
    pub(super) opening: Vec<Option<usize>>,
    /// True for each group that closes its opening.
    pub(super) closes: Vec<bool>,
}

impl DoorGroups {
    /// Finds the openings of groups. The names of the groups of one piece have the same prefix,
    /// `door_7_`; the piece is the nearest opening.
    pub(super) fn find(model: &PortalModel, home: &Home, groups: &[Group]) -> Self {
        /// Greatest distance of a door from its opening in the plan, metres.
        const NEAR: f64 = 0.5;
        let mut doors = Self {
            opening: vec![None; groups.len()],
            closes: vec![false; groups.len()],
        };
        let keys: Vec<Option<&str>> = groups.iter().map(|group| door_key(&group.name)).collect();
        let mut sorted: Vec<usize> = (0..groups.len())
            .filter(|&group| keys[group].is_some())
            .collect();
        sorted.sort_by_key(|&group| (keys[group], group));
        for members in sorted.chunk_by(|&a, &b| keys[a] == keys[b]) {
            let boxes = members.iter().map(|&group| bounds(model, &groups[group]));
            let [low, high] = boxes
                .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
                .unwrap_or_default();
            let middle = (low + high) / 2.0;
            let distance = |opening: &Opening| {
                let from = DVec2::new(middle.x, middle.z) - opening.centre * UNIT_M;
                let half = DVec2::new(opening.width, opening.depth) * (UNIT_M / 2.0);
                let beyond =
                    DVec2::new(from.dot(opening.along), from.dot(opening.across())).abs() - half;
                let height =
                    (middle.y - (opening.heights[0] + opening.heights[1]) / 2.0 * UNIT_M).abs();
                beyond.max(DVec2::ZERO).length() + height
            };
            let nearest = home
                .openings
                .iter()
                .map(distance)
                .enumerate()
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((opening, _)) = nearest.filter(|&(_, distance)| distance < NEAR) else {
                continue;
            };
            let member_groups: Vec<&Group> = members.iter().map(|&group| &groups[group]).collect();
            let closing = closing_groups(
                &model.scene,
                &model.portals[opening],
                home.openings[opening].wall_thickness * UNIT_M,
                &member_groups,
            );
            for (&group, closes) in members.iter().zip(closing) {
                doors.opening[group] = Some(opening);
                doors.closes[group] = closes;
            }
        }
        doors
    }
}

/// Returns the common prefix of the groups of a door or window from the name of one.
fn door_key(name: &str) -> Option<&str> {
    piece_key(name, "door_")
}

/// Returns `piece_12` of `piece_12_Chair_leg_4`.
fn piece_key<'a>(name: &'a str, prefix: &str) -> Option<&'a str> {
    let digits = name
        .strip_prefix(prefix)?
        .bytes()
        .take_while(u8::is_ascii_digit)
        .count();
    (digits > 0).then(|| &name[..prefix.len() + digits])
}

/// Returns the assignment of each group to cells.
pub(super) fn assign_groups(
    model: &PortalModel,
    groups: &[Group],
    doors: &DoorGroups,
    options: &ModelOptions,
    notes: &mut Vec<String>,
) -> Vec<Portion> {
    let mut left_out = 0;
    let portions = groups.iter().enumerate().map(|(index, group)| {
        match (doors.opening[index], doors.closes[index]) {
            (Some(_), true) if !options.keep_doors => {
                left_out += 1;
                Portion::LeftOut
            }
            (Some(opening), _) => Portion::BySide(opening),
            (None, _) => match piece_key(&group.name, "piece_").or_else(|| door_key(&group.name)) {
                Some(key) => Portion::Whole(key.to_owned()),
                None => Portion::Facing,
            },
        }
    });
    let portions = portions.collect();
    if left_out > 0 {
        notes.push(format!(
            "{left_out} groups that close {} doors and windows left out",
            model.portals.len().min(closed_openings(doors))
        ));
    }
    portions
}

/// Returns the number of openings that some group closes.
fn closed_openings(doors: &DoorGroups) -> usize {
    let groups = doors.opening.iter().zip(&doors.closes);
    groups
        .filter_map(|(&opening, &closes)| opening.filter(|_| closes))
        .collect::<BTreeSet<usize>>()
        .len()
}

/// Returns the bounding box of a group.
pub(super) fn bounds(model: &PortalModel, group: &Group) -> [DVec3; 2] {
    let corners = group
        .triangles
        .clone()
        .flat_map(|triangle| model.scene.corners(triangle));
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
        [low.min(p), high.max(p)]
    })
}
