//! Consistency filter: depths that other views confirm.

use super::matching::hypotheses::Hypothesis;
use super::matching::patch_match::NeighborView;

/// A view confirms a depth if its own depth leads back to within this number of pixels and differs
/// by no more than this ratio.
const MAX_RETURN_PX: f32 = 1.5;
const MAX_DEPTH_RATIO: f32 = 0.01;

/// Minimum relative difference of inverse depth at which a view with a farther surface sees through
/// the depth.
const THROUGH: f32 = 0.03;

/// Maximum relative difference of inverse depth between connected pixels.
const CONNECTED: f32 = 0.02;

/// Confirmation of a pixel's depth by the other views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Confirmation {
    /// Number of views with the same depth.
    pub(super) confirming: u8,
    /// Number of views that see through it, to a farther surface or to background.
    pub(super) through: u8,
    /// Mean difference of the confirming inverse depths, 1/m.
    pub(super) difference: f32,
}

impl Confirmation {
    /// Returns true if at least `needed` views confirm the depth and fewer see through it.
    pub(super) fn is_sufficient(&self, needed: usize) -> bool {
        usize::from(self.confirming) >= needed && self.through < self.confirming
    }
}

/// Compares the depth of a plane at a pixel with the other views.
pub(super) fn confirm(
    others: &[NeighborView],
    [x, y]: [f32; 2],
    plane: &Hypothesis,
) -> Confirmation {
    let mut confirmation = Confirmation::default();
    for other in others {
        let Some(known) = &other.known else { continue };
        let h = other.relative.warp(x, y, plane.inverse_depth);
        let px = h.x / h.z;
        let py = h.y / h.z;
        let width = other.picture.width;
        let height = other.picture.height;
        if !(h.z > 0.0 && px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32) {
            continue;
        }
        let pixel = py as usize * width + px as usize;
        if other.picture.background[pixel] {
            confirmation.through += 1;
            continue;
        }
        // Inverse depth of this point in the other view.
        let expected = plane.inverse_depth / h.z;
        let actual = known.inverse_depths[pixel];
        if actual <= 0.0 {
            continue;
        }
        let back = known.back.warp(px, py, actual);
        let distance = (back.x / back.z - x).hypot(back.y / back.z - y);
        if back.z > 0.0
            && distance < MAX_RETURN_PX
            && (actual - expected).abs() < MAX_DEPTH_RATIO * expected
        {
            confirmation.confirming += 1;
            confirmation.difference += (actual / back.z - plane.inverse_depth).abs();
        } else if actual < expected * (1.0 - THROUGH) {
            confirmation.through += 1;
        }
    }
    confirmation.difference /= f32::from(confirmation.confirming.max(1));
    confirmation
}

/// Removes connected patches of fewer than `least` pixels by setting their inverse depths to 0.
pub(super) fn remove_specks(inverse_depths: &mut [f32], width: usize, least: usize) {
    let mut visited = vec![false; inverse_depths.len()];
    let mut patch = Vec::new();
    for start in 0..inverse_depths.len() {
        if visited[start] || inverse_depths[start] <= 0.0 {
            continue;
        }
        patch.clear();
        patch.push(start);
        visited[start] = true;
        let mut next = 0;
        while let Some(&pixel) = patch.get(next) {
            next += 1;
            let x = pixel % width;
            let own = inverse_depths[pixel];
            let sides = [
                (x > 0).then(|| pixel - 1),
                (x + 1 < width).then(|| pixel + 1),
                pixel.checked_sub(width),
                Some(pixel + width).filter(|&below| below < inverse_depths.len()),
            ];
            for side in sides.into_iter().flatten() {
                let other = inverse_depths[side];
                if !visited[side]
                    && other > 0.0
                    && (other - own).abs() <= CONNECTED * own.max(other)
                {
                    visited[side] = true;
                    patch.push(side);
                }
            }
        }
        if patch.len() < least {
            patch.iter().for_each(|&pixel| inverse_depths[pixel] = 0.0);
        }
    }
}
