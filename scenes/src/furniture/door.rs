//! Door leaves.

use super::Piece;
use crate::finishes::Finishes;
use crate::mesh::Mesh;
use glam::{DMat3, DVec3};

/// Sizes of a leaf, metres.
pub(crate) struct DoorLeaf {
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) thickness: f64,
}

/// Adds a leaf from its lower corner at the hinge: `width` along the unit vector `along`,
/// `thickness` along `across`, with two panels and a handle on each face.
pub(crate) fn door_leaf(
    mesh: &mut Mesh,
    corner: DVec3,
    along: DVec3,
    across: DVec3,
    leaf: &DoorLeaf,
    finishes: &Finishes,
) {
    let (width, height, thick) = (leaf.width, leaf.height, leaf.thickness);
    let mut piece = Piece {
        mesh,
        place: corner,
        world_from_piece: DMat3::from_cols(along, DVec3::Y, across),
    };
    piece.block(DVec3::ZERO, [width, height, thick], 0.9, finishes.oak);
    for (back, front) in [(-0.008, 0.0), (thick, thick + 0.008)] {
        for (low, high) in [(0.12, 0.9), (1.05, height - 0.12)] {
            piece.block(
                [0.12, low, back],
                [width - 0.12, high, front],
                0.7,
                finishes.oak,
            );
        }
    }
    let at = width - 0.06;
    piece.pipe(
        [[at, 1.0, -0.05], [at, 1.0, thick + 0.05]],
        0.01,
        finishes.metal,
    );
    for z in [-0.05, thick + 0.05] {
        piece.pipe([[at, 1.0, z], [at - 0.12, 1.0, z]], 0.011, finishes.metal);
    }
}
