//! The pixels of a block, sixteen at a time: which layer each ray meets, and the blend of its four cameras (L9, C21).
//!
//! Of a ray the slopes say all: texels in every camera's image are linear in them, layer by layer ([`LayerInView`]), and so is the
//! crossing of the camera plane, which decides the cell and the bilinear weights. The index of a layer is looked up in the nearest
//! texel; colours are bilinear over those texels that show the layer, and normalised over the cameras that show it, in linear light.
//!
//! One code for every SIMD level, without fused multiply-adds and approximate reciprocals, so that all give the same bits.

use super::grid::LEAST_FORWARD;
use super::plan::{LayerInView, LumigraphPlan, Paint, Step, cell};
use super::pyramid::{Level, Pyramid};
use super::settings::Blend;
use super::show::Show;
use super::taps::{LANES, add_taps, nearest};
use crate::render::linear::LinearLight;
use fearless_simd::{Level as SimdLevel, Simd, dispatch, f32x16, i32x16, mask32x16, prelude::*, u32x16};
use std::ops::Range;

const LANE_NUMBERS: [f32; LANES] = [0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.];

/// What is left to see behind a pixel, at least, for anyone to look there.
const LEAST_OPEN: f32 = 1.0 / 256.0;

/// The share of a cell's camera along each axis, at least: where it alone sees what a ray meets, beside the grid or just where another
/// cell begins, it is asked.
pub(super) const LEAST_WEIGHT: f32 = 1.0 / 1024.0;

/// A part of a frame.
pub(super) struct Block<'a> {
    pub(super) plan: &'a LumigraphPlan,
    pub(super) pyramid: &'a Pyramid,
    /// Those that may show in it, near ones first.
    pub(super) layers: &'a [LayerInView],
    pub(super) columns: Range<usize>,
    pub(super) rows: Range<usize>,
    /// Of the frame.
    pub(super) width: usize,
}

/// Alpha of pixels of which no camera of the ray's cell sees anything, though one looks there: something nearer hides it.
pub(super) const HIDDEN: u8 = 1;

/// Which pixels are drawn, and from which cameras.
#[derive(Clone, Copy)]
pub(super) enum Pass<'a> {
    /// All, from the cameras of the ray's cell.
    First,
    /// Those that are [`HIDDEN`], in steps.
    Wider(&'a [Step]),
}

/// Draws a block on rows of the frame, of which the first is the block's: straight colours, with alpha 255 where anything is, else 0 or
/// [`HIDDEN`]. Returns whether any pixel is hidden.
pub(super) fn draw(block: &Block, pass: Pass, colors: &mut [[u8; 4]], level: SimdLevel) -> bool {
    dispatch!(level, simd => draw_block(simd, block, pass, colors))
}

#[inline(always)]
fn draw_block<S: Simd>(simd: S, block: &Block, pass: Pass, colors: &mut [[u8; 4]]) -> bool {
    let view = &block.plan.view;
    let mut any_hidden = false;
    for (row, y) in block.rows.clone().enumerate() {
        let start = (view.start + view.step[0] * 0.5 + view.step[1] * (y as f64 + 0.5)).as_vec3();
        let mut x = block.columns.start;
        while x < block.columns.end {
            let count = LANES.min(block.columns.end - x);
            let at = row * block.width + x;
            x += LANES;
            let Some(to) = colors.get_mut(at..at + count) else { continue };
            let wanted = match pass {
                Pass::First => u64::MAX >> (64 - count),
                Pass::Wider(_) => hidden(to),
            };
            if wanted != 0 {
                let pixels = sixteen(simd, block, pass, wanted, start.to_array(), (x - LANES) as f32);
                let mut left = wanted;
                while left != 0 {
                    let i = left.trailing_zeros() as usize;
                    left &= left - 1;
                    to[i] = pixels[i];
                }
                any_hidden |= hidden(to) != 0;
            }
        }
    }
    any_hidden
}

/// Which of some pixels are hidden.
#[inline(always)]
fn hidden(pixels: &[[u8; 4]]) -> u64 {
    let mut bits = 0;
    for (i, pixel) in pixels.iter().enumerate() {
        bits |= u64::from(pixel[3] == HIDDEN) << i;
    }
    bits
}

/// The cameras to either side of some rays, along one axis of the grid.
struct Sides<S: Simd> {
    /// Their places.
    place: [f32x16<S>; 2],
    /// Their bilinear weights.
    weight: [f32x16<S>; 2],
    /// Their numbers.
    number: [u32x16<S>; 2],
}

#[inline(always)]
fn sides<S: Simd>(simd: S, places: &[f32], position: f32x16<S>, shift: i32) -> Sides<S> {
    let positions = position.to_array();
    let most = places.len().saturating_sub(2);
    let shifted = |position: f32| cell(places, position).saturating_add_signed(shift as isize).min(most);
    let (first, last) = (shifted(positions[0]), shifted(positions[LANES - 1]));
    let above = |low: usize| (low + 1).min(places.len() - 1);
    // Along a row crossings are monotonous.
    let (place, number) = if first == last {
        let (low, high) = (first, above(first));
        (
            [f32x16::splat(simd, places[low]), f32x16::splat(simd, places[high])],
            [u32x16::splat(simd, low as u32), u32x16::splat(simd, high as u32)],
        )
    } else {
        let (mut place, mut number) = ([[0.0; LANES]; 2], [[0; LANES]; 2]);
        for i in 0..LANES {
            let low = shifted(positions[i]);
            let high = above(low);
            (number[0][i], number[1][i]) = (low as u32, high as u32);
            (place[0][i], place[1][i]) = (places[low], places[high]);
        }
        (
            [f32x16::load_array(simd, place[0]), f32x16::load_array(simd, place[1])],
            [u32x16::load_array(simd, number[0]), u32x16::load_array(simd, number[1])],
        )
    };
    // A single camera is both.
    let gap = (place[1] - place[0]).max(f32::MIN_POSITIVE);
    let of_high = ((position - place[0]) / gap).max(LEAST_WEIGHT).min(1.0 - LEAST_WEIGHT);
    Sides { place, weight: [f32x16::splat(simd, 1.0) - of_high, of_high], number }
}

/// The rays of sixteen pixels.
struct Rays<S: Simd> {
    slopes: [f32x16<S>; 2],
    across: Sides<S>,
    up: Sides<S>,
    /// Of the four cameras: low and high columns of the low row, then of the high one.
    weight: [f32x16<S>; 4],
    /// Where the cameras' texels begin.
    base: [u32x16<S>; 4],
}

/// Where the four cameras' texels for a layer are.
struct Places<S: Simd> {
    u: [f32x16<S>; 2],
    v: [f32x16<S>; 2],
}

#[inline(always)]
fn places<S: Simd>(layer: &LayerInView, rays: &Rays<S>) -> Places<S> {
    let u = rays.slopes[0] * layer.scale + layer.add[0];
    let v = rays.slopes[1] * -layer.scale + layer.add[1];
    Places {
        u: [u - rays.across.place[0] * layer.shift, u - rays.across.place[1] * layer.shift],
        v: [v + rays.up.place[0] * layer.shift, v + rays.up.place[1] * layer.shift],
    }
}

/// Which positions lie in an image.
#[inline(always)]
fn inside<S: Simd>(level: Level, [u, v]: [f32x16<S>; 2]) -> mask32x16<S> {
    u.simd_ge(0.0) & v.simd_ge(0.0) & u.simd_lt(level.width as f32) & v.simd_lt(level.height as f32)
}

/// What has been found for sixteen pixels.
struct Found<S: Simd> {
    color: [f32x16<S>; 3],
    /// Share of the pixel that is not taken yet.
    open: f32x16<S>,
}

/// Those of sixteen pixels that are `wanted`.
#[inline(always)]
fn sixteen<S: Simd>(simd: S, block: &Block, pass: Pass, wanted: u64, start: [f32; 3], x: f32) -> [[u8; 4]; LANES] {
    let step = block.plan.view.step[0].as_vec3().to_array();
    let number = f32x16::load_array(simd, LANE_NUMBERS) + x;
    let forward = number * step[2] + start[2];
    let ahead = forward.simd_gt(LEAST_FORWARD as f32) & mask32x16::from_bitmask(simd, wanted);
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let mut found = Found { color: [zero; 3], open: ahead.select(one, zero) };
    let mut behind_something = mask32x16::from_bitmask(simd, 0);
    if ahead.any_true() {
        // Of all sixteen, as what holds for the first and the last is taken to hold between them.
        let per_forward = one / forward.max(LEAST_FORWARD as f32);
        let slopes = [(number * step[0] + start[0]) * per_forward, (number * step[1] + start[1]) * per_forward];
        let steps = match pass {
            Pass::First => &[Step::FIRST],
            Pass::Wider(steps) => steps,
        };
        for &step in steps {
            // The same cell again shows the same.
            if leads_away(block, slopes, step.shift) {
                continue;
            }
            let rays = rays(simd, block, slopes, step.shift);
            let mut is_open = true;
            for layer in block.layers {
                is_open = draw_layer(simd, block, layer, step.loose, &rays, &mut found);
                if !is_open {
                    break;
                }
            }
            if !is_open {
                break;
            }
            let nothing = found.open.simd_ge(1.0);
            if step == Step::FIRST && nothing.any_true() {
                behind_something = hides(simd, block, &rays, nothing);
            }
        }
    }
    if matches!(pass, Pass::Wider(_)) {
        behind_something = ahead;
    }
    resolve(simd, &found, ahead, behind_something)
}

/// Where a camera of the cell that looks at infinity sees something instead.
#[inline(always)]
fn hides<S: Simd>(simd: S, block: &Block, rays: &Rays<S>, of: mask32x16<S>) -> mask32x16<S> {
    let none = mask32x16::from_bitmask(simd, 0);
    let Some(infinity) = block.plan.layers.last().filter(|layer| layer.indices == [0, 0]) else { return none };
    let places = places(infinity, rays);
    let level = block.pyramid.levels[infinity.level];
    let mut hides = none;
    for k in 0..4 {
        let at = [places.u[k % 2], places.v[k / 2]];
        let inside = of & inside(level, at);
        if inside.any_true() {
            let index = nearest(simd, &block.pyramid.texels, level, rays.base[k], at, inside);
            hides |= inside & index.simd_gt(0);
        }
    }
    hides
}

/// Whether there is no cell where a shift leads, for any of the rays: cells nearer by were asked before.
#[inline(always)]
fn leads_away<S: Simd>(block: &Block, slopes: [f32x16<S>; 2], shift: [i32; 2]) -> bool {
    let (view, places) = (&block.plan.view, [&block.plan.columns, &block.plan.rows]);
    let eye = view.eye.as_vec3().to_array();
    for axis in 0..2 {
        if shift[axis] != 0 {
            let crossings = (slopes[axis] * -eye[2] + eye[axis]).to_array();
            let last = places[axis].len() as i32 - 2;
            let ends = [crossings[0], crossings[LANES - 1]];
            let led =
                [cell(places[axis], ends[0]) as i32 + shift[axis], cell(places[axis], ends[1]) as i32 + shift[axis]];
            if led[0].max(led[1]) < 0 || led[0].min(led[1]) > last {
                return true;
            }
        }
    }
    false
}

#[inline(always)]
fn rays<S: Simd>(simd: S, block: &Block, slopes: [f32x16<S>; 2], shift: [i32; 2]) -> Rays<S> {
    let eye = block.plan.view.eye.as_vec3();
    let (columns, rows) = (&block.plan.columns, &block.plan.rows);
    let across = sides(simd, columns, slopes[0] * -eye.z + eye.x, shift[0]);
    let up = sides(simd, rows, slopes[1] * -eye.z + eye.y, shift[1]);
    let weight = [
        across.weight[0] * up.weight[0],
        across.weight[1] * up.weight[0],
        across.weight[0] * up.weight[1],
        across.weight[1] * up.weight[1],
    ];
    let (count, stride) = (columns.len() as u32, block.pyramid.stride as u32);
    let row = [up.number[0] * count, up.number[1] * count];
    let base = [
        (row[0] + across.number[0]) * stride,
        (row[0] + across.number[1]) * stride,
        (row[1] + across.number[0]) * stride,
        (row[1] + across.number[1]) * stride,
    ];
    Rays { slopes, across, up, weight, base }
}

/// Adds what the rays meet in a layer; false if nothing is left to see behind it.
#[inline(always)]
fn draw_layer<S: Simd>(
    simd: S,
    block: &Block,
    layer: &LayerInView,
    loose: bool,
    rays: &Rays<S>,
    found: &mut Found<S>,
) -> bool {
    let indices = if loose { layer.with_neighbours } else { layer.indices };
    let level = block.pyramid.levels[layer.level];
    let texels = block.pyramid.texels.as_slice();
    let places = places(layer, rays);
    let open = found.open.simd_ge(LEAST_OPEN);
    let none = mask32x16::from_bitmask(simd, 0);
    let (mut shows, mut through) = ([none; 4], [none; 4]);
    let (first, last) = (i32::from(indices[0]), i32::from(indices[1]));
    for k in 0..4 {
        let at = [places.u[k % 2], places.v[k / 2]];
        let inside = open & inside(level, at);
        if inside.any_true() {
            let index = nearest(simd, texels, level, rays.base[k], at, inside);
            shows[k] = inside & index.simd_ge(first) & index.simd_le(last);
            through[k] = inside & index.simd_lt(first);
        }
    }
    if !(shows[0] | shows[1] | shows[2] | shows[3]).any_true() {
        return true;
    }
    blend(simd, block, layer, indices, rays, &places, [shows, through], found)
}

/// Blends the cameras that show a layer into what was found; false if nothing is left to see behind it.
#[inline(always)]
fn blend<S: Simd>(
    simd: S,
    block: &Block,
    layer: &LayerInView,
    indices: [u16; 2],
    rays: &Rays<S>,
    places: &Places<S>,
    [shows, through]: [[mask32x16<S>; 4]; 2],
    found: &mut Found<S>,
) -> bool {
    let level = block.pyramid.levels[layer.level];
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let mut sum = [zero; 4];
    let (mut showing, mut passing) = (zero, zero);
    for k in 0..4 {
        if shows[k].any_true() {
            let weight = shows[k].select(rays.weight[k], zero);
            showing += weight;
            let at = [places.u[k % 2], places.v[k / 2]];
            match &block.plan.paint {
                None => {
                    add_taps(simd, &block.pyramid.texels, level, rays.base[k], at, indices, weight, &mut sum);
                }
                Some(paint) => {
                    let numbers = match paint.show {
                        Show::Cameras => camera_numbers(rays.base[k].to_array(), block.pyramid.stride),
                        Show::Merged => [u32::from(layer.indices[1]); LANES],
                        _ => {
                            let texels = block.pyramid.texels.as_slice();
                            nearest(simd, texels, level, rays.base[k], at, shows[k]).bitcast::<u32x16<S>>().to_array()
                        }
                    };
                    add_paint(simd, paint, &numbers, weight, &mut sum);
                }
            }
        }
        passing += through[k].select(rays.weight[k], zero);
    }
    let shown = showing.simd_gt(0.0) & sum[3].simd_gt(0.0);
    let share = match block.plan.blend {
        Blend::Whole => one,
        Blend::Shared => showing / shown.select(showing + passing, one),
    };
    let taken = shown.select(found.open * share, zero);
    let scale = taken / shown.select(sum[3], one);
    for c in 0..3 {
        found.color[c] += sum[c] * scale;
    }
    found.open -= taken;
    found.open.simd_ge(LEAST_OPEN).any_true()
}

/// Which cameras' texels begin there.
fn camera_numbers(base: [u32; LANES], stride: usize) -> [u32; LANES] {
    base.map(|base| base / stride.max(1) as u32)
}

/// Adds colours by number times weight, and weight.
#[inline(always)]
fn add_paint<S: Simd>(simd: S, paint: &Paint, numbers: &[u32; LANES], weight: f32x16<S>, sum: &mut [f32x16<S>; 4]) {
    let mut colors = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let color = paint.colors.get(numbers[i] as usize).copied().unwrap_or_default();
        (colors[0][i], colors[1][i], colors[2][i]) = (color[0], color[1], color[2]);
    }
    for c in 0..3 {
        sum[c] += f32x16::load_array(simd, colors[c]) * weight;
    }
    sum[3] += weight;
}

/// Straight sRGB colours, with alpha 255 where anything was found, else 0 or, behind something, [`HIDDEN`].
#[inline(always)]
fn resolve<S: Simd>(simd: S, found: &Found<S>, ahead: mask32x16<S>, behind: mask32x16<S>) -> [[u8; 4]; LANES] {
    let one = f32x16::splat(simd, 1.0);
    let share = one - found.open;
    let any = ahead & share.simd_gt(0.0);
    let scale = f32x16::splat(simd, f32::from(LinearLight::MAX) / 65535.0) / any.select(share, one);
    let mut linear = [[0; LANES]; 3];
    for c in 0..3 {
        let rounded = (found.color[c] * scale + 0.5).min(f32::from(LinearLight::MAX));
        linear[c] = rounded.to_int::<i32x16<S>>().to_array();
    }
    let mut pixels = [[0; 4]; LANES];
    let mut bits = (behind & !any).to_bitmask();
    while bits != 0 {
        pixels[bits.trailing_zeros() as usize][3] = HIDDEN;
        bits &= bits - 1;
    }
    let mut bits = any.to_bitmask();
    let tables = LinearLight::tables();
    while bits != 0 {
        let i = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        let [r, g, b] =
            [tables.srgb(linear[0][i] as u32), tables.srgb(linear[1][i] as u32), tables.srgb(linear[2][i] as u32)];
        pixels[i] = [r, g, b, 255];
    }
    pixels
}
