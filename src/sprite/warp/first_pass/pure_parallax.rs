//! Pure parallax in displacement cells, for the first pass: where displacements move, and how the
//! result is packed (Eq. 6, C5).

use crate::warp::cell::Coding;
use crate::warp::field::Field;
use crate::warp::transfer::SpriteTransfer;

/// Smallest drawn depth of a surface point from the target eye, as a share of its plane's depth:
/// nearer points would be magnified beyond use, and at 0 they are behind the eye.
pub const NEAREST_DEPTH_SHARE: f32 = 1.0 / 16.0;

/// Value that the first pass stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StoredValue {
    /// d1 / w3: correct if the second pass divides its first term by its third component (C5).
    Corrected,
    /// d1, as in equations (7) and (8) as printed.
    AsPrinted,
}

/// Parameters of the first pass.
#[derive(Clone, Copy)]
pub(crate) struct FirstPass {
    /// The size of a cell in pixels.
    pub cell_px: [f64; 2],
    pub stored: StoredValue,
    /// Number of gap-filling steps, one cell each.
    pub fill_steps: u32,
}

/// Pure parallax in units of displacement cells.
pub(super) struct PureParallax {
    pub(crate) epipole: [f32; 3],
    pub(crate) stored: StoredValue,
    /// Offset from a column (row) of the source grid to that of the output.
    pub(crate) origin: [f32; 2],
    pub(crate) width: f32,
    pub(crate) height: f32,
    /// Largest distance of a displacement from its patch's plane.
    pub(crate) tolerance: f32,
    pub(super) source_coding: Coding,
    pub(super) encoding: Encoding,
}

impl PureParallax {
    /// Prepares a pass; also returns the range of displacements in front of the target eye. Sets
    /// origin, size and coding of `out`.
    pub(crate) fn new(
        source: &Field,
        transfer: &SpriteTransfer,
        pass: FirstPass,
        out: &mut Field,
    ) -> (Self, [f32; 2]) {
        let e = transfer.epipole_in_sprite;
        let epipole = [
            (e.x / pass.cell_px[0]) as f32,
            (e.y / pass.cell_px[1]) as f32,
            e.z as f32,
        ];
        let range = clamp_in_front(source.range, epipole[2]);
        let [x0, x1] = reachable_cells(source.width, range, epipole[0], epipole[2]);
        let [y0, y1] = reachable_cells(source.height, range, epipole[1], epipole[2]);
        (out.x0, out.y0) = (x0, y0);
        (out.width, out.height) = ((x1 - x0) as u32, (y1 - y0) as u32);
        let stored = |d: f32| {
            if pass.stored == StoredValue::Corrected {
                d / (1.0 + d * epipole[2])
            } else {
                d
            }
        };
        let [a, b] = range.map(stored);
        let shallowest = range
            .map(|d| 1.0 + d * epipole[2])
            .into_iter()
            .fold(1.0, f32::min);
        let steepest = 127.0 * source.coding.slope_scale / shallowest * 1.25;
        out.coding = Coding::new(a.min(b), a.max(b), steepest, transfer.side as f32);
        let parallax = Self {
            epipole,
            stored: pass.stored,
            origin: [-x0 as f32, -y0 as f32],
            width: out.width as f32,
            height: out.height as f32,
            tolerance: source.patches.tolerance,
            source_coding: source.coding,
            encoding: Encoding::new(&out.coding),
        };
        (parallax, range)
    }
}

/// Reciprocals of a [`Coding`], for packing.
pub(super) struct Encoding {
    pub(super) steps_per_unit: f32,
    /// Cell value of displacement 0 plus 0.5, so that truncation rounds to nearest.
    pub(super) rounded_zero: f32,
    pub(super) slopes_per_unit: f32,
}

impl Encoding {
    fn new(coding: &Coding) -> Self {
        Self {
            steps_per_unit: 1.0 / coding.scale,
            rounded_zero: coding.zero + 0.5,
            slopes_per_unit: 1.0 / coding.slope_scale,
        }
    }
}

/// Clamps a range of displacements so that w3 = 1 + d * epipole_z is at least
/// [`NEAREST_DEPTH_SHARE`].
fn clamp_in_front([low, high]: [f32; 2], epipole_z: f32) -> [f32; 2] {
    let limit = (NEAREST_DEPTH_SHARE - 1.0) / epipole_z;
    if epipole_z > 0.0 {
        [low.max(limit), high.max(limit)]
    } else if epipole_z < 0.0 {
        [low.min(limit), high.min(limit)]
    } else {
        [low, high]
    }
}

/// Moves a coordinate `x` with displacement `d` by pure parallax.
pub(super) fn move_position(x: f32, d: f32, epipole: f32, epipole_z: f32) -> f32 {
    (x + d * epipole) / (1.0 + d * epipole_z)
}

/// Returns the first cell, and the end, of what positions 0 to `length` can reach; at most one
/// `length` beyond either end.
fn reachable_cells(length: u32, range: [f32; 2], epipole: f32, epipole_z: f32) -> [i32; 2] {
    let length = length as f32;
    let ends = [0.0, length]
        .into_iter()
        .flat_map(|x| range.map(|d| move_position(x, d, epipole, epipole_z)));
    let [low, high] = ends.fold([0.0, length], |[low, high]: [f32; 2], x| {
        [low.min(x), high.max(x)]
    });
    [
        low.max(-length).floor() as i32,
        high.min(2.0 * length).ceil() as i32,
    ]
}

/// A band of output rows, written by one thread.
pub(super) struct CellBand<'a> {
    pub(crate) cells: &'a mut [u32],
    /// Number of its first row in the output.
    pub(crate) first: i32,
    /// Number of rows.
    pub(crate) rows: i32,
    /// Number of columns.
    pub(crate) width: i32,
}
