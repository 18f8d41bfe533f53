//! Walls of a home: straight and round, joined at their ends.

use super::finish::{Finish, finish};
use super::home::Level;
use super::xml::number;
use glam::DVec2;
use roxmltree::Node;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// A wall, upright on its level.
#[derive(Clone, Debug)]
pub(crate) struct Wall {
    /// Ends of its middle line in plan.
    pub(crate) start: DVec2,
    pub(crate) end: DVec2,
    pub(crate) thickness: f64,
    /// Height of the floor that it stands on.
    pub(crate) bottom: f64,
    /// Height of its lower edge: a wall of an upper storey reaches through the floor.
    pub(crate) lower_edge: f64,
    /// Heights above its bottom, at its start and end.
    pub(crate) heights: [f64; 2],
    /// Finishes of its left and right side, seen from start to end in a plan with y downward.
    pub(crate) finishes: [Finish; 2],
    /// Finish of its upper face, if it has its own.
    pub(crate) top_finish: Option<Finish>,
    /// Extension beyond its start and end, into joined walls; `None` for a free end.
    pub(crate) extension: [Option<f64>; 2],
    /// True for a piece of an arc wall.
    pub(crate) is_arc: bool,
}

/// Maximum angle between the straight pieces of an arc wall, radians.
const ARC_STEP: f64 = PI / 18.0;

pub(crate) fn wall(
    node: Node,
    level: Level,
    wall_height: f64,
    by_id: &HashMap<&str, Node>,
) -> Option<Wall> {
    let thickness = number(node, "thickness").filter(|&thickness| thickness > 0.0)?;
    let height = number(node, "height").unwrap_or(wall_height);
    let into = |joined: &str| extension(node, *by_id.get(node.attribute(joined)?)?, wall_height);
    let top_finish = finish(node, "topColor", None);
    Some(Wall {
        start: DVec2::new(number(node, "xStart")?, number(node, "yStart")?),
        end: DVec2::new(number(node, "xEnd")?, number(node, "yEnd")?),
        thickness,
        bottom: level.elevation,
        lower_edge: level.elevation - level.floor_thickness,
        heights: [height, number(node, "heightAtEnd").unwrap_or(height)],
        finishes: ["left", "right"].map(|side| {
            finish(
                node,
                &format!("{side}SideColor"),
                Some(&format!("{side}SideTexture")),
            )
        }),
        top_finish: Some(top_finish).filter(Finish::is_specified),
        extension: ["wallAtStart", "wallAtEnd"].map(into),
        is_arc: false,
    })
}

/// Returns the extension of a wall into one that it is joined to: half its thickness, or, if the
/// other continues it, as far as their outer faces meet. `None` if the end of the wall remains
/// visible there.
fn extension(node: Node, joined: Node, wall_height: f64) -> Option<f64> {
    let other = number(joined, "thickness")?;
    let Some(sine) = continuation(node, joined) else {
        return Some(other / 2.0);
    };
    let heights = |wall: Node| {
        let height = number(wall, "height").unwrap_or(wall_height);
        [height, number(wall, "heightAtEnd").unwrap_or(height)]
    };
    let [low, high] = heights(joined);
    let is_covered = heights(node).iter().all(|&height| height <= low.min(high));
    let thickness = number(node, "thickness")?;
    // The tangent of half a small angle is half its sine.
    (is_covered && thickness <= other).then_some(thickness / 2.0 * sine / 2.0)
}

/// Returns the sine of the angle between two straight walls if one nearly continues the other from
/// a common end.
fn continuation(wall: Node, other: Node) -> Option<f64> {
    const MAX_SINE: f64 = 0.1;
    let ends = |wall: Node| {
        let point = |[x, y]: [&str; 2]| Some(DVec2::new(number(wall, x)?, number(wall, y)?));
        let is_straight = number(wall, "arcExtent").is_none_or(|extent| extent == 0.0);
        let ends = [point(["xStart", "yStart"])?, point(["xEnd", "yEnd"])?];
        is_straight.then_some(ends)
    };
    let [[a, b], [c, d]] = [ends(wall)?, ends(other)?];
    // From the far end of each wall to the common one and on.
    let distance = |[_, p, q, _]: &[DVec2; 4]| p.distance(*q);
    let [far, near, next, last] = [[a, b, c, d], [a, b, d, c], [b, a, c, d], [b, a, d, c]]
        .into_iter()
        .min_by(|p, q| distance(p).total_cmp(&distance(q)))?;
    let along = (near - far).try_normalize()?;
    let onward = (last - next).try_normalize()?;
    let sine = along.perp_dot(onward).abs();
    (sine < MAX_SINE && along.dot(onward) > 0.0).then_some(sine)
}

impl Wall {
    /// Splits an arc wall into straight pieces of at most [`ARC_STEP`]. `extent` is the angle of
    /// the arc from start to end, radians, positive clockwise in plan.
    pub(super) fn split_arc(self, extent: f64) -> Vec<Self> {
        let chord = self.end - self.start;
        if extent == 0.0 || extent.abs() >= TAU || chord == DVec2::ZERO {
            return vec![self];
        }
        let offset = chord.perp() * (((PI - extent) / 2.0).tan() / 2.0);
        let centre = (self.start + self.end) / 2.0 + offset;
        let count = (extent.abs() / ARC_STEP).ceil().max(1.0);
        // Outer faces of adjacent pieces meet; inner ones intersect.
        let joint = self.thickness / 2.0 * (extent / count / 2.0).abs().tan();
        let at =
            |share: f64| centre + DVec2::from_angle(extent * share).rotate(self.start - centre);
        let height = |share: f64| self.heights[0] + (self.heights[1] - self.heights[0]) * share;
        let count = count as usize;
        let piece = |i: usize| {
            let [from, to] = [i, i + 1].map(|end| end as f64 / count as f64);
            Self {
                start: at(from),
                end: at(to),
                heights: [height(from), height(to)],
                extension: [
                    if i == 0 {
                        self.extension[0]
                    } else {
                        Some(joint)
                    },
                    if i + 1 == count {
                        self.extension[1]
                    } else {
                        Some(joint)
                    },
                ],
                is_arc: true,
                ..self.clone()
            }
        };
        (0..count).map(piece).collect()
    }
}
