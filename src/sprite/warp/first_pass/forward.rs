//! First pass: moving displacements by pure parallax (Eq. 6), d1(x1, y1) to d3(x3, y3) with d3 = d1
//! / w3 (C5).
//!
//! Planar tiles ([`super::patches`]) are drawn whole, as the parallelograms to which they map
//! ([`super::planes`]); all other cells move one by one. There are no more bands of rows than
//! threads, since neighbouring bands draw the same tiles (docs/decisions/0044).

use super::patches::{BLOCK_SIDE, GROUP, PatchGroup, TILE};
use super::planes::{Setups, draw_patch, set_up, slope_units};
use super::pure_parallax::{
    CellBand, Encoding, FirstPass, NEAREST_DEPTH_SHARE, PureParallax, StoredValue, move_position,
};
use crate::warp::cell::{Coding, VISIBLE, slopes};
use crate::warp::field::Field;
use crate::warp::fill::{GapBuffers, fill};
use crate::warp::second_pass::sampling::COPIES;
use crate::warp::transfer::SpriteTransfer;
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, prelude::*, u8x64, u32x4, u32x16};
use rayon::prelude::*;

/// Buffers of a band of rows, reused from frame to frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct BandBuffers {
    /// The band's rows, and the rows around it that gap filling reads.
    cells: Vec<u32>,
    gaps: GapBuffers,
}

/// Moves `source` (the sprite's d1) into `out`, which is resized to hold the result, and fills its
/// gaps.
///
/// The result does not depend on the number of threads. Gap filling reads as many rows up and down
/// as it takes steps: a band draws these too, in its own memory, so that no thread waits for
/// another in between.
pub(crate) fn forward(
    level: Level,
    source: &Field,
    transfer: &SpriteTransfer,
    pass: FirstPass,
    out: &mut Field,
    memory: &mut Vec<BandBuffers>,
) {
    let (parallax, range) = PureParallax::new(source, transfer, pass, out);
    let (width, height) = (out.width as usize, out.height as usize);
    out.cells.resize(width * height, 0);
    let steps = pass.fill_steps as usize;
    // A band with fewer rows than its margins would draw mostly margins.
    let bands = rayon::current_num_threads()
        .min(height / (2 * steps).max(1))
        .max(1);
    let band_rows = height.div_ceil(bands).max(1);
    memory.resize_with(bands, BandBuffers::default);
    let coding = out.coding;
    let draw_rows = |rows: [usize; 2], cells: &mut [u32], gaps: &mut GapBuffers| {
        cells.fill(0);
        dispatch!(level, simd => {
            forward_band(simd, source, &parallax, range, rows, cells);
            fill(simd, cells, width, &coding, pass.fill_steps, gaps);
        });
    };
    let draw_band = |(band, (own, memory)): (usize, (&mut [u32], &mut BandBuffers))| {
        let first = band * band_rows;
        let end = first + own.len() / width;
        let around = [first.saturating_sub(steps), (end + steps).min(height)];
        if around == [first, end] {
            draw_rows(around, own, &mut memory.gaps);
            return;
        }
        memory.cells.resize((around[1] - around[0]) * width, 0);
        draw_rows(around, &mut memory.cells, &mut memory.gaps);
        own.copy_from_slice(&memory.cells[(first - around[0]) * width..][..own.len()]);
    };
    if let [memory] = memory.as_mut_slice() {
        draw_band((0, (&mut out.cells, memory)));
    } else {
        out.cells
            .par_chunks_mut(width * band_rows)
            .zip(memory)
            .enumerate()
            .for_each(draw_band);
    }
}

/// Moves all patches and cells that may reach the rows `first..end` of the output.
#[inline(always)]
fn forward_band<S: Simd>(
    simd: S,
    source: &Field,
    parallax: &PureParallax,
    range: [f32; 2],
    [first, end]: [usize; 2],
    cells: &mut [u32],
) {
    let [_, epipole_y, epipole_z] = parallax.epipole;
    let mut band = CellBand {
        cells,
        first: first as i32,
        rows: (end - first) as i32,
        width: parallax.width as i32,
    };
    let mut setups = Setups::new();
    // Of cells, so that those of the group's other patches are kept.
    let mut cell_setups = Setups::new();
    for (number, strip) in source.patches.strips.iter().enumerate() {
        let y0 = number as u32 * TILE;
        // Range of output rows that the strip can reach under all displacements.
        let edges = [y0 as f32, (y0 + TILE) as f32];
        let ends = edges
            .into_iter()
            .flat_map(|y| range.map(|d| move_position(y, d, epipole_y, epipole_z)));
        let ends = ends.fold([f32::MAX, f32::MIN], |[low, high], y| {
            [low.min(y), high.max(y)]
        });
        let [low, high] = ends.map(|y| y + parallax.origin[1]);
        if high < first as f32 - 1.0 || low > end as f32 + 1.0 {
            continue;
        }
        for group in &strip.groups {
            let whole = set_up(simd, parallax, group, &mut setups);
            // Neighbours are not drawn one after the other: loads of recently written cells stall.
            for lane in (0..GROUP).map(|i| i * 5 % GROUP) {
                if whole >> lane & 1 == 1 {
                    draw_patch(simd, &setups, lane, &mut band);
                    continue;
                }
                let side = (2.0 * group.half[lane]) as u32;
                if side > 0 {
                    let corner = [group.x[lane], group.y[lane]];
                    let corner = corner.map(|center| (center - group.half[lane]) as u32);
                    move_square(
                        simd,
                        source,
                        parallax,
                        corner,
                        side,
                        &mut cell_setups,
                        &mut band,
                    );
                }
            }
        }
        for &corner in &strip.rough {
            move_square(
                simd,
                source,
                parallax,
                corner,
                BLOCK_SIDE,
                &mut cell_setups,
                &mut band,
            );
        }
    }
}

/// Moves a square of cells one by one, in blocks of [`BLOCK_SIDE`]. A magnified cell is also drawn
/// as a patch, so that no farther surface shows through between cells.
fn move_square<S: Simd>(
    simd: S,
    source: &Field,
    parallax: &PureParallax,
    corner: [u32; 2],
    side: u32,
    setups: &mut Setups,
    band: &mut CellBand,
) {
    simd.vectorize(
        #[inline(always)]
        || move_square_kernel(simd, source, parallax, corner, side, setups, band),
    );
}

#[inline(always)]
fn move_square_kernel<S: Simd>(
    simd: S,
    source: &Field,
    parallax: &PureParallax,
    [x0, y0]: [u32; 2],
    side: u32,
    setups: &mut Setups,
    band: &mut CellBand,
) {
    for y in (y0..y0 + side).step_by(BLOCK_SIDE as usize) {
        for x in (x0..x0 + side).step_by(BLOCK_SIDE as usize) {
            let block = load_block(simd, source, [x, y]);
            let position = [x as f32 + 0.5, y as f32 + 0.5];
            let (moved, magnified) = move_cells(simd, parallax, block, position, band);
            scatter(simd, moved, band.cells);
            if magnified != 0 && parallax.stored == StoredValue::Corrected {
                let whole = set_up(
                    simd,
                    parallax,
                    &cells_to_patches(&block.to_array(), parallax, position),
                    setups,
                );
                for lane in (0..GROUP).filter(|lane| (whole & magnified) >> lane & 1 == 1) {
                    draw_patch(simd, setups, lane, band);
                }
            }
        }
    }
}

/// Loads the cells of a block, row-major; 0 outside the field.
#[inline(always)]
fn load_block<S: Simd>(simd: S, source: &Field, [x, y]: [u32; 2]) -> u32x16<S> {
    let width = source.width as usize;
    let start = y as usize * width + x as usize;
    if x + BLOCK_SIDE <= source.width
        && let Some(cells) = source.cells.get(start..start + 3 * width + 4)
    {
        let (upper, lower) = cells.split_at(2 * width);
        let first = u32x4::from_slice(simd, &upper[..4])
            .combine(u32x4::from_slice(simd, &upper[width..width + 4]));
        let second = u32x4::from_slice(simd, &lower[..4])
            .combine(u32x4::from_slice(simd, &lower[width..width + 4]));
        return first.combine(second);
    }
    let mut block = [0; 16];
    for (i, cell) in block.iter_mut().enumerate() {
        let inside = x as usize + i % 4 < width;
        *cell = source
            .cells
            .get(start + i / 4 * width + i % 4)
            .copied()
            .filter(|_| inside)
            .unwrap_or(0);
    }
    u32x16::load_array(simd, block)
}

/// Converts the cells of a block, whose first cell is centred at `position`, to patches.
fn cells_to_patches(
    block: &[u32; GROUP],
    parallax: &PureParallax,
    position: [f32; 2],
) -> PatchGroup {
    let mut group = PatchGroup::EMPTY;
    for (i, &cell) in block.iter().enumerate().filter(|(_, cell)| **cell != 0) {
        (group.x[i], group.y[i]) = (position[0] + BLOCK_COLUMNS[i], position[1] + BLOCK_ROWS[i]);
        group.d[i] = parallax.source_coding.displacement(cell, 0.0, 0.0);
        [group.slope_x[i], group.slope_y[i]] =
            slopes(cell).map(|slope| slope * parallax.source_coding.slope_scale);
        (group.half[i], group.visible[i]) = (0.5, cell & VISIBLE);
    }
    group
}

/// Sixteen indices into a band and the cells to store there; lanes without a cell have an index
/// outside every band.
type MovedCells<S> = (u32x16<S>, u32x16<S>);

/// Offsets of the lanes in groups of four neighbours.
const NEIGHBOR_OFFSETS: [u32; 16] = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3];

/// Keeps the nearer of the stored and the moved cell. On smooth surfaces most groups of four stay
/// neighbours, and are stored together.
#[inline(always)]
fn scatter<S: Simd>(simd: S, (indices, values): MovedCells<S>, cells: &mut [u32]) {
    let firsts = indices.swizzle_dyn_within_blocks(u8x64::load_array_ref(simd, &COPIES[0]));
    let adjacent = (indices - firsts)
        .simd_eq(u32x16::load_array_ref(simd, &NEIGHBOR_OFFSETS))
        .to_bitmask();
    let (indices, values) = (indices.to_array(), values.to_array());
    for group in 0..4 {
        let (indices, values) = (
            &indices[4 * group..4 * group + 4],
            &values[4 * group..4 * group + 4],
        );
        let first = indices[0] as usize;
        if adjacent >> (4 * group) & 15 == 15
            && let Some(target) = cells.get_mut(first..first + 4)
        {
            u32x4::from_slice(simd, target)
                .max(u32x4::from_slice(simd, values))
                .store_slice(target);
            continue;
        }
        for (&index, &value) in indices.iter().zip(values) {
            if let Some(cell) = cells.get_mut(index as usize) {
                *cell = value.max(*cell);
            }
        }
    }
}

/// Column of each cell of a block.
const BLOCK_COLUMNS: [f32; 16] = [
    0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0,
];
/// Row of each cell of a block.
const BLOCK_ROWS: [f32; 16] = [
    0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0,
];

/// Moves the cells of a block, the first centred at `position`; also returns a bit mask of the
/// magnified ones.
#[inline(always)]
fn move_cells<S: Simd>(
    simd: S,
    parallax: &PureParallax,
    cells: u32x16<S>,
    position: [f32; 2],
    band: &CellBand,
) -> (MovedCells<S>, u64) {
    let (d, slope_x, slope_y) = decode(cells, &parallax.source_coding);
    let [ex, ey, ez] = parallax.epipole;
    let x = f32x16::load_array_ref(simd, &BLOCK_COLUMNS) + position[0];
    let y = f32x16::load_array_ref(simd, &BLOCK_ROWS) + position[1];
    let w3 = d * ez + 1.0;
    // Slopes at the new position: grad3 d3 = grad1 d1 / (w3 + (e - x1 e_z) . grad1 d1). Where the
    // denominator is zero or negative, the surface faces away from the target eye.
    let toward_x = f32x16::splat(simd, ex) - x * ez;
    let stretch = w3 + toward_x * slope_x + slope_y * (f32x16::splat(simd, ey) - y * ez);
    let stretch = stretch.max(w3 * 0.25);
    // One division for 1 / w3 and 1 / stretch.
    let both = f32x16::splat(simd, 1.0) / (w3 * stretch);
    let inverse_w3 = both * stretch;
    let x3 = (x + d * ex) * inverse_w3;
    let y3 = (y + d * ey) * inverse_w3;
    let (column, row) = (x3.floor(), y3.floor());
    let (value, factor) = match parallax.stored {
        StoredValue::Corrected => (d * inverse_w3, both * w3),
        StoredValue::AsPrinted => (d, both * w3 * w3 * w3),
    };
    let (slope_x, slope_y) = (slope_x * factor, slope_y * factor);
    let value = value + slope_x * (column + 0.5 - x3) + slope_y * (row + 0.5 - y3);

    let (column, row) = (
        column + parallax.origin[0],
        row + (parallax.origin[1] - band.first as f32),
    );
    let inside = column.simd_ge(0.0)
        & column.simd_lt(parallax.width)
        & row.simd_ge(0.0)
        & row.simd_lt(band.rows as f32)
        & w3.simd_ge(NEAREST_DEPTH_SHARE)
        & cells.simd_ne(0);
    let zero = f32x16::splat(simd, 0.0);
    let row = inside.select(row, zero).to_int::<i32x16<S>>();
    let column = inside.select(column, zero).to_int::<i32x16<S>>();
    let index = inside.select(
        row * parallax.width as i32 + column,
        i32x16::splat(simd, -1),
    );
    let packed = encode(
        &parallax.encoding,
        cells,
        inside.select(value, zero),
        slope_x,
        slope_y,
    );
    let magnified = inverse_w3
        .max(stretch * inverse_w3 * inverse_w3)
        .simd_gt(MAGNIFIED)
        & cells.simd_ne(0);
    (
        (index.bitcast::<u32x16<S>>(), packed),
        magnified.to_bitmask(),
    )
}

/// Magnification above which moved cells leave adjacent gaps. Below it a gap is one cell wide, and
/// gap filling closes it from its neighbours.
pub const MAGNIFIED: f32 = 1.5;

/// Decodes the displacements at the cell centres, as [`Coding::displacement`], and the slopes.
#[inline(always)]
fn decode<S: Simd>(cells: u32x16<S>, coding: &Coding) -> (f32x16<S>, f32x16<S>, f32x16<S>) {
    let value = ((cells >> 16) & 0x7fff).to_float::<f32x16<S>>();
    let signed = cells.bitcast::<i32x16<S>>();
    let slope_x = ((signed << 16) >> 24).to_float::<f32x16<S>>() * coding.slope_scale;
    let slope_y = ((signed << 24) >> 24).to_float::<f32x16<S>>() * coding.slope_scale;
    ((value - coding.zero) * coding.scale, slope_x, slope_y)
}

/// Packs cells as [`Coding::pack`], with the visibility of `source`.
#[inline(always)]
fn encode<S: Simd>(
    encoding: &Encoding,
    source: u32x16<S>,
    d: f32x16<S>,
    slope_x: f32x16<S>,
    slope_y: f32x16<S>,
) -> u32x16<S> {
    let value = d * encoding.steps_per_unit + encoding.rounded_zero;
    let value = value
        .max(1.0)
        .min(32767.0)
        .to_int::<i32x16<S>>()
        .bitcast::<u32x16<S>>();
    let x = slope_units(slope_x * encoding.slopes_per_unit);
    let y = slope_units(slope_y * encoding.slopes_per_unit);
    (source & VISIBLE) | (value << 16) | (x << 8) | y
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Displacement, DisplacementFormat, Sprite, SpritePlane};
    use glam::{DMat3, DVec3, dvec3};
    use headbox_core::camera::Camera;
    use image::{Rgba, RgbaImage};

    #[test]
    fn bands_agree_with_the_whole() {
        const SIDE: u32 = 144;
        let camera = Camera::look_at(
            dvec3(0.0, 0.0, 2.0),
            DVec3::ZERO,
            DVec3::Y,
            50.0,
            [SIDE, SIDE],
        )
        .expect("valid");
        let color = RgbaImage::from_pixel(SIDE, SIDE, Rgba([255; 4]));
        let sprite =
            Sprite::new(color, camera, SpritePlane::through(DVec3::ZERO, DVec3::Z)).expect("valid");
        // Squares at heights of their own: gaps of more rows than filling takes steps lie
        // everywhere.
        let height = |x: u32, y: u32| ((x / 24 * 37 + y / 24 * 101) % 11) as f32 / 11.0;
        let values: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| height(i % SIDE, i / SIDE))
            .collect();
        let displacement =
            Displacement::new(SIDE, SIDE, &values, DisplacementFormat::F32).expect("finite");
        let field = Field::from_sprite(&sprite, &displacement);
        let transfer = SpriteTransfer::from_parts(DMat3::IDENTITY, dvec3(4.0, 60.0, 0.05), 1.0)
            .expect("regular");
        let moved = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            let (mut out, mut memory) = (Field::empty(), Vec::new());
            let pass = FirstPass {
                cell_px: [1.0; 2],
                stored: StoredValue::Corrected,
                fill_steps: 5,
            };
            pool.install(|| forward(Level::new(), &field, &transfer, pass, &mut out, &mut memory));
            out
        };
        let whole = moved(1);
        assert!(
            whole.cells.contains(&0) && whole.cells.iter().any(|&cell| cell != 0),
            "gaps wider than are filled"
        );
        for threads in 2..7 {
            assert!(moved(threads) == whole, "{threads} threads");
        }
    }

    #[test]
    fn patch_is_drawn_beside_one_that_moves_cell_by_cell() {
        // Two tiles. The first reaches behind the target eye and moves out of sight cell by cell.
        const WIDTH: u32 = 2 * TILE;
        const HEIGHT: u32 = TILE;
        let camera = Camera::look_at(
            dvec3(0.0, 0.0, 2.0),
            DVec3::ZERO,
            DVec3::Y,
            50.0,
            [WIDTH, HEIGHT],
        )
        .expect("valid");
        let color = RgbaImage::from_pixel(WIDTH, HEIGHT, Rgba([255; 4]));
        let sprite =
            Sprite::new(color, camera, SpritePlane::through(DVec3::ZERO, DVec3::Z)).expect("valid");
        let value = |x: u32| {
            if x < TILE {
                0.5 + 0.46 * x as f32 / 15.0
            } else {
                0.2
            }
        };
        let values: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| value(i % WIDTH)).collect();
        let displacement =
            Displacement::new(WIDTH, HEIGHT, &values, DisplacementFormat::F32).expect("finite");
        let field = Field::from_sprite(&sprite, &displacement);
        let transfer = SpriteTransfer::from_parts(DMat3::IDENTITY, dvec3(-60.0, 0.0, -1.0), 1.0)
            .expect("regular");
        let pass = FirstPass {
            cell_px: [1.0; 2],
            stored: StoredValue::Corrected,
            fill_steps: 0,
        };
        let (mut out, mut memory) = (Field::empty(), Vec::new());
        forward(Level::new(), &field, &transfer, pass, &mut out, &mut memory);
        // Columns 16 to 32 with a displacement of 0.2 move to 5 to 25, rows to 0 to 20.
        for (x, y) in (1..19).flat_map(|y| (6..24).map(move |x| (x, y))) {
            let column = (x - out.x0) as usize;
            let row = (y - out.y0) as usize;
            let cell = out.cells[row * out.width as usize + column];
            assert!(cell & VISIBLE != 0, "column {x}, row {y}");
        }
    }
}
