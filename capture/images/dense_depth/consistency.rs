//! What is kept: depths that other views confirm.

use super::hypotheses::Hypothesis;
use super::patch_match::Other;

/// A depth is confirmed by a view that knows nearly the same: it leads there and back to within so many pixels, and to a depth that differs by no
/// more than this share.
const RETURNS_PX: f32 = 1.5;
const SAME_DEPTH: f32 = 0.01;

/// Views that show something farther, by this share, where a depth says that there is a surface see through it.
const THROUGH: f32 = 0.03;

/// Pixels of one surface differ in inverse depth by no more than this share.
const CONNECTED: f32 = 0.02;

/// What the other views say of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Verdict {
    /// Views that know the same depth.
    pub(super) confirm: u8,
    /// Views that see through it, to something farther or to nothing at all.
    pub(super) through: u8,
    /// By how much the inverse depths of those that confirm it differ from it, on average, 1/m.
    pub(super) off: f32,
}

impl Verdict {
    /// Whether enough views confirm it, and fewer see through it.
    pub(super) fn confirms(&self, needed: usize) -> bool {
        usize::from(self.confirm) >= needed && self.through < self.confirm
    }
}

/// What other views say of a plane at a pixel.
pub(super) fn judge(others: &[Other], [x, y]: [f32; 2], plane: &Hypothesis) -> Verdict {
    let mut verdict = Verdict::default();
    for other in others {
        let Some(known) = &other.known else { continue };
        let h = other.relative.at(x, y, plane.inverse_depth);
        let (px, py) = (h.x / h.z, h.y / h.z);
        let (width, height) = (other.picture.width, other.picture.height);
        if !(h.z > 0.0 && px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32) {
            continue;
        }
        let at = py as usize * width + px as usize;
        if other.picture.nothing[at] {
            verdict.through += 1;
            continue;
        }
        // Inverse depth that the other view would know of this point.
        let expected = plane.inverse_depth / h.z;
        let there = known.inverse_depths[at];
        if there <= 0.0 {
            continue;
        }
        let back = known.back.at(px, py, there);
        let distance = (back.x / back.z - x).hypot(back.y / back.z - y);
        if back.z > 0.0 && distance < RETURNS_PX && (there - expected).abs() < SAME_DEPTH * expected
        {
            verdict.confirm += 1;
            verdict.off += (there / back.z - plane.inverse_depth).abs();
        } else if there < expected * (1.0 - THROUGH) {
            verdict.through += 1;
        }
    }
    verdict.off /= f32::from(verdict.confirm.max(1));
    verdict
}

/// Removes patches of connected pixels that are fewer than `least`: sets their inverse depths to 0.
pub(super) fn remove_specks(inverse_depths: &mut [f32], width: usize, least: usize) {
    let mut seen = vec![false; inverse_depths.len()];
    let mut patch = Vec::new();
    for start in 0..inverse_depths.len() {
        if seen[start] || inverse_depths[start] <= 0.0 {
            continue;
        }
        patch.clear();
        patch.push(start);
        seen[start] = true;
        let mut next = 0;
        while let Some(&at) = patch.get(next) {
            next += 1;
            let (x, own) = (at % width, inverse_depths[at]);
            let sides = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then(|| at + 1),
                at.checked_sub(width),
                Some(at + width).filter(|&below| below < inverse_depths.len()),
            ];
            for side in sides.into_iter().flatten() {
                let there = inverse_depths[side];
                if !seen[side] && there > 0.0 && (there - own).abs() <= CONNECTED * own.max(there) {
                    seen[side] = true;
                    patch.push(side);
                }
            }
        }
        if patch.len() < least {
            patch.iter().for_each(|&at| inverse_depths[at] = 0.0);
        }
    }
}
