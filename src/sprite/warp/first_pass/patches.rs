//! Planar patches of a sprite's displacements, which the first pass moves whole: where a tile of 16
//! x 16, 8 x 8 or 4 x 4 cells lies on a plane, the plane moves instead of its cells. Pure parallax
//! maps planes to planes exactly, so the only error is that of the fit, and a magnified plane has
//! no gaps.

use crate::warp::cell::VISIBLE;

/// Number of patches that are set up together.
pub(super) const GROUP: usize = 16;

/// Side of the largest tiles, cells.
pub(super) const TILE: u32 = 16;

/// Side of the smallest tiles, and of blocks of cells that are not planar, cells.
pub(super) const BLOCK_SIDE: u32 = 4;

/// Largest distance of a displacement from its tile's plane, as a share of the largest
/// displacement: 0.025 px at 50 px of parallax.
const FLATNESS: f32 = 1.0 / 2048.0;

/// Sixteen patches of one strip: squares of the displacement grid in which the displacement is
/// `d + slope . (position - centre)`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PatchGroup {
    /// Centre, cells.
    pub x: [f32; GROUP],
    pub y: [f32; GROUP],
    /// Displacement at the centre.
    pub d: [f32; GROUP],
    /// Change of the displacement per cell.
    pub slope_x: [f32; GROUP],
    pub slope_y: [f32; GROUP],
    /// Half a side, cells; 0 in unused lanes.
    pub half: [f32; GROUP],
    /// [`VISIBLE`] or 0.
    pub visible: [u32; GROUP],
}

impl PatchGroup {
    pub(crate) const EMPTY: Self = Self {
        x: [0.0; GROUP],
        y: [0.0; GROUP],
        d: [0.0; GROUP],
        slope_x: [0.0; GROUP],
        slope_y: [0.0; GROUP],
        half: [0.0; GROUP],
        visible: [0; GROUP],
    };
}

/// Patches of a strip of [`TILE`] rows of cells.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Strip {
    pub groups: Vec<PatchGroup>,
    /// First column and row of the blocks of [`BLOCK_SIDE`] x [`BLOCK_SIDE`] cells that move cell
    /// by cell.
    pub rough: Vec<[u32; 2]>,
}

/// All strips of a field, from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Patches {
    pub strips: Vec<Strip>,
    /// Largest distance of a displacement from its patch's plane.
    pub tolerance: f32,
}

/// A field before it is packed.
pub(crate) struct UnpackedField<'a> {
    pub width: u32,
    pub height: u32,
    pub values: &'a [f32],
    /// Packed cells; only their visibility is used.
    pub cells: &'a [u32],
}

impl Patches {
    /// Divides a field into patches. `step` is the quantisation step of the stored displacements (0
    /// if they are fine); an eighth of it is below their rounding error.
    pub(crate) fn new(surface: &UnpackedField, step: f32) -> Self {
        let largest = surface
            .values
            .iter()
            .fold(0.0f32, |max, d| max.max(d.abs()));
        let tolerance = (largest * FLATNESS).max(step / 8.0);
        let strip = |y: u32| {
            let mut strip = Strip::default();
            let mut patches = Vec::new();
            for x in (0..surface.width).step_by(TILE as usize) {
                split(
                    surface,
                    tolerance,
                    [x, y],
                    TILE,
                    &mut patches,
                    &mut strip.rough,
                );
            }
            strip.groups = patches.chunks(GROUP).map(pack_group).collect();
            strip
        };
        Self {
            strips: (0..surface.height)
                .step_by(TILE as usize)
                .map(strip)
                .collect(),
            tolerance,
        }
    }
}

/// One patch: centre, displacement, slopes and half a side; and [`VISIBLE`] or 0.
type Patch = ([f32; 6], u32);

fn pack_group(patches: &[Patch]) -> PatchGroup {
    let mut group = PatchGroup::EMPTY;
    for (i, &([x, y, d, slope_x, slope_y, half], visible)) in patches.iter().enumerate() {
        (group.x[i], group.y[i], group.d[i]) = (x, y, d);
        (group.slope_x[i], group.slope_y[i], group.half[i]) = (slope_x, slope_y, half);
        group.visible[i] = visible;
    }
    group
}

/// Divides a square of `side` cells into patches and rough blocks.
fn split(
    surface: &UnpackedField,
    tolerance: f32,
    [x, y]: [u32; 2],
    side: u32,
    patches: &mut Vec<Patch>,
    rough: &mut Vec<[u32; 2]>,
) {
    if x >= surface.width || y >= surface.height {
        return;
    }
    if let Some(patch) = fit(surface, tolerance, [x, y], side) {
        patches.push(patch);
    } else if side == BLOCK_SIDE {
        rough.push([x, y]);
    } else {
        let half = side / 2;
        for corner in [[x, y], [x + half, y], [x, y + half], [x + half, y + half]] {
            split(surface, tolerance, corner, half, patches, rough);
        }
    }
}

/// Fits the least-squares plane of a square; `None` if the square extends beyond the field, mixes
/// visible and transparent cells, or has a displacement farther than `tolerance` from the plane.
fn fit(surface: &UnpackedField, tolerance: f32, [x0, y0]: [u32; 2], side: u32) -> Option<Patch> {
    if x0 + side > surface.width || y0 + side > surface.height {
        return None;
    }
    let index = |i: u32| ((y0 + i / side) * surface.width + x0 + i % side) as usize;
    let count = side * side;
    let visible = surface.cells[index(0)] & VISIBLE;
    if (1..count).any(|i| surface.cells[index(i)] & VISIBLE != visible) {
        return None;
    }
    let half = f64::from(side) / 2.0;
    let offset = |i: u32| {
        [
            f64::from(i % side) + 0.5 - half,
            f64::from(i / side) + 0.5 - half,
        ]
    };
    let (mut mean, mut along, mut square) = (0.0, [0.0; 2], 0.0);
    for i in 0..count {
        let d = f64::from(surface.values[index(i)]);
        let [u, v] = offset(i);
        mean += d;
        along = [along[0] + u * d, along[1] + v * d];
        square += u * u;
    }
    let (d, slope) = (mean / f64::from(count), along.map(|sum| sum / square));
    let off = |i: u32| {
        let [u, v] = offset(i);
        (f64::from(surface.values[index(i)]) - (d + slope[0] * u + slope[1] * v)).abs()
    };
    if !(0..count).all(|i| off(i) <= f64::from(tolerance)) {
        return None;
    }
    let center = [f64::from(x0) + half, f64::from(y0) + half];
    Some((
        [center[0], center[1], d, slope[0], slope[1], half].map(|v| v as f32),
        visible,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_become_patches_and_edges_stay_cells() {
        // A plane with a cliff at column 20, and one bump of a cell at (3, 13); 24 x 18 cells.
        let value = |x: u32, y: u32| {
            let cliff = if x >= 20 { 10.0 } else { 0.0 };
            let bump = if (x, y) == (3, 13) { 1.0 } else { 0.0 };
            0.1 * x as f32 - 0.2 * y as f32 + cliff + bump
        };
        let values: Vec<f32> = (0..24 * 18).map(|i| value(i % 24, i / 24)).collect();
        let cells = vec![VISIBLE; values.len()];
        let patches = Patches::new(
            &UnpackedField {
                width: 24,
                height: 18,
                values: &values,
                cells: &cells,
            },
            0.0,
        );
        let count: Vec<_> = patches
            .strips
            .iter()
            .map(|strip| {
                let halves = || strip.groups.iter().flat_map(|group| group.half);
                let count = |half: f32| halves().filter(|h| *h == half).count();
                (count(4.0), count(2.0), strip.rough.clone())
            })
            .collect();
        // The cliff lies between small tiles; the bump spoils one; the last two rows fill no tile.
        let last: Vec<[u32; 2]> = (0..6).map(|i| [4 * i, 16]).collect();
        assert_eq!(count, [(3, 11, vec![[0, 12]]), (0, 0, last)]);
        let group = &patches.strips[0].groups[0];
        assert!((group.slope_x[0] - 0.1).abs() < 1e-6 && (group.slope_y[0] + 0.2).abs() < 1e-6);
        assert!((group.d[0] - (0.1 * 3.5 - 0.2 * 3.5)).abs() < 1e-6 && group.x[0] == 4.0);
    }
}
