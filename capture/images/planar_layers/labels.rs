//! Which pixel belongs to which plane: by its depth, by how alike the frames are where the plane has it, and by its neighbours (costs summed along eight
//! directions, Hirschmueller 2008, here of labels instead of disparities). Or as masks say.

use super::canvas::Canvas;
use super::frames::{Frame, Frames};
use super::planes::Affine;
use super::{LEAST_PIXELS, LayersError, Mask};
use crate::planar_layers::planes;
use rayon::prelude::*;

/// The label of what belongs to no layer.
pub(super) const NONE: u8 = u8::MAX;

/// What a depth off a plane costs at most, and how many times as far as what lies on it that is.
const OFF_PLANE: f32 = 1.0;
const FAR: f64 = 6.0;

/// What frames that look different cost at most, the levels by which they differ then, and those that noise and light make.
const UNLIKE: f32 = 0.35;
const LEVELS: f32 = 40.0;
const NOISE_LEVELS: f32 = 5.0;

/// Half of the window's side over which frames are compared, pixels.
const WINDOW: usize = 2;

/// What neighbours of different labels cost, where the picture is even and at most where it has an edge; and how soon it falls, levels.
const PARTED: [f32; 2] = [1.5, 0.15];
const EDGE_LEVELS: f32 = 10.0;

/// Patches of one label with fewer pixels join what is around them.
const SPECK: usize = 80;

/// Ways along which costs are summed.
const WAYS: [[isize; 2]; 8] = [
    [1, 0],
    [-1, 0],
    [0, 1],
    [0, -1],
    [1, 1],
    [-1, -1],
    [1, -1],
    [-1, 1],
];

/// The plane of each pixel.
pub(super) fn assign(canvas: &Canvas, frames: &Frames, planes: &[Affine]) -> Vec<u8> {
    let costs = costs(canvas, frames, planes);
    let mut sums = vec![0.0f32; costs.len()];
    for way in WAYS {
        add_along(canvas, &costs, planes.len(), way, &mut sums);
    }
    let cheapest = |costs: &[f32]| {
        (0..costs.len())
            .min_by(|a, b| costs[*a].total_cmp(&costs[*b]))
            .unwrap_or(0) as u8
    };
    let labels = sums.chunks_exact(planes.len()).zip(&canvas.shown);
    let mut labels: Vec<u8> = labels
        .map(|(costs, shown)| if *shown { cheapest(costs) } else { NONE })
        .collect();
    join_specks(canvas, &mut labels);
    labels
}

/// What each plane costs each pixel.
fn costs(canvas: &Canvas, frames: &Frames, planes: &[Affine]) -> Vec<f32> {
    let unlike: Vec<Vec<f32>> = planes
        .iter()
        .map(|plane| averaged(canvas, &unlike(canvas, frames, plane)))
        .collect();
    let far = (FAR * canvas.on_plane_px) as f32;
    let of_pixel = |pixel: usize| {
        let unlike = &unlike;
        planes.iter().enumerate().map(move |(label, plane)| {
            let known = canvas.inverse_depth[pixel];
            let off = plane.off_px(canvas, pixel, known).abs() as f32;
            let by_depth = if known > 0.0 {
                OFF_PLANE * (off / far).min(1.0)
            } else {
                0.0
            };
            by_depth + UNLIKE * ((unlike[label][pixel] - NOISE_LEVELS) / LEVELS).clamp(0.0, 1.0)
        })
    };
    (0..canvas.shown.len())
        .into_par_iter()
        .flat_map_iter(of_pixel)
        .collect()
}

/// By how many levels the frames differ from the canvas where a plane has its pixels: the mean of the half of them that is most alike, as the others may see something before it.
fn unlike(canvas: &Canvas, frames: &Frames, plane: &Affine) -> Vec<f32> {
    let of_pixel = |pixel: usize| {
        let inverse_depth = plane.at(canvas.center(pixel));
        if !canvas.shown[pixel] || inverse_depth <= 0.0 {
            return LEVELS;
        }
        let point = canvas.point(pixel, inverse_depth);
        let differs = |frame: &Frame| {
            let [x, y, _] = frame.place(point)?;
            let color = frame.color_at(x, y)?;
            Some(
                (0..3)
                    .map(|c| (color[c] - canvas.color[pixel][c]).abs())
                    .sum::<f32>()
                    / 3.0,
            )
        };
        let mut all: Vec<f32> = frames.others().iter().filter_map(differs).collect();
        all.sort_unstable_by(f32::total_cmp);
        all.truncate(all.len().div_ceil(2));
        if all.is_empty() {
            LEVELS
        } else {
            all.iter().sum::<f32>() / all.len() as f32
        }
    };
    (0..canvas.shown.len())
        .into_par_iter()
        .map(of_pixel)
        .collect()
}

/// Means over a window, of what is shown.
fn averaged(canvas: &Canvas, values: &[f32]) -> Vec<f32> {
    let mean = |pixel: usize| {
        let (sum, count) = canvas
            .around(pixel, WINDOW)
            .filter(|near| canvas.shown[*near])
            .fold((0.0f32, 0.0f32), |(sum, count), near| {
                (sum + values[near].min(LEVELS), count + 1.0)
            });
        sum / count.max(1.0)
    };
    (0..values.len()).into_par_iter().map(mean).collect()
}

/// Adds to `sums` what each label of each pixel costs together with the best way to it from one side.
fn add_along(canvas: &Canvas, costs: &[f32], count: usize, [dx, dy]: [isize; 2], sums: &mut [f32]) {
    let (width, height) = (canvas.width, canvas.height);
    let mut along = vec![0.0f32; costs.len()];
    for row in 0..height {
        let y = if dy < 0 { height - 1 - row } else { row };
        for column in 0..width {
            let x = if dx < 0 { width - 1 - column } else { column };
            let pixel = y * width + x;
            let before = x
                .checked_add_signed(-dx)
                .filter(|x| *x < width)
                .zip(y.checked_add_signed(-dy).filter(|y| *y < height));
            let before = before
                .map(|(x, y)| y * width + x)
                .filter(|before| canvas.shown[*before]);
            let least = before.map(|before| {
                let least = along[before * count..][..count]
                    .iter()
                    .copied()
                    .fold(f32::INFINITY, f32::min);
                (
                    before,
                    least,
                    parted(&canvas.color[before], &canvas.color[pixel]),
                )
            });
            for label in 0..count {
                let so_far = least.map_or(0.0, |(before, least, parted)| {
                    // Less the least of all, so that sums stay small.
                    (along[before * count + label] - least).min(parted)
                });
                along[pixel * count + label] = costs[pixel * count + label] + so_far;
                sums[pixel * count + label] += costs[pixel * count + label] + so_far;
            }
        }
    }
}

/// What it costs that two neighbours belong to different planes.
fn parted(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let levels = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
    let [even, edge] = PARTED;
    edge + (even - edge) * (-levels / EDGE_LEVELS).exp()
}

/// Small patches take the label of most of the pixels beside them.
fn join_specks(canvas: &Canvas, labels: &mut [u8]) {
    let mut visited = vec![false; labels.len()];
    for start in 0..labels.len() {
        if visited[start] || labels[start] == NONE {
            continue;
        }
        visited[start] = true;
        let (mut patch, mut beside, mut next) = (vec![start], [0usize; 256], 0);
        while let Some(&pixel) = patch.get(next) {
            next += 1;
            for near in canvas.around(pixel, 1) {
                if labels[near] != labels[start] {
                    beside[usize::from(labels[near])] += 1;
                } else if !visited[near] {
                    visited[near] = true;
                    patch.push(near);
                }
            }
        }
        beside[usize::from(NONE)] = 0;
        let most = (0..256)
            .max_by_key(|label| (beside[*label], std::cmp::Reverse(*label)))
            .unwrap_or(0);
        if patch.len() < SPECK && beside[most] > 0 {
            patch.iter().for_each(|pixel| labels[*pixel] = most as u8);
        }
    }
}

/// Planes and labels of regions made by hand.
pub(super) fn from_masks(
    canvas: &Canvas,
    frames: &Frames,
    masks: &[Mask],
) -> Result<(Vec<Affine>, Vec<u8>), LayersError> {
    let middle = frames.middle();
    let wanted = middle.view.size_px;
    for Mask { path, picture } in masks {
        let size = [picture.width(), picture.height()];
        if size != wanted {
            let name = frames.middle_name().into();
            return Err(LayersError::MaskSize {
                path: path.clone(),
                size,
                name,
                wanted,
            });
        }
    }
    let label = |pixel: usize| {
        let place = middle
            .place(canvas.point(pixel, 1.0))
            .filter(|_| canvas.shown[pixel]);
        let [x, y, _] = place?;
        masks
            .iter()
            .position(|mask| mask.picture.get_pixel(x as u32, y as u32).0[0] >= 128)
    };
    let labels: Vec<u8> = (0..canvas.shown.len())
        .map(|pixel| label(pixel).map_or(NONE, |label| label as u8))
        .collect();
    let planes = masks.iter().enumerate().map(|(number, mask)| {
        let own: Vec<usize> = (0..labels.len())
            .filter(|pixel| usize::from(labels[*pixel]) == number)
            .collect();
        let found = own
            .iter()
            .filter(|pixel| canvas.inverse_depth[**pixel] > 0.0)
            .count();
        let plane =
            planes::of_pixels(canvas, &own, number as u64).filter(|_| found >= LEAST_PIXELS);
        plane.ok_or_else(|| LayersError::EmptyMask {
            path: mask.path.clone(),
            found,
        })
    });
    Ok((planes.collect::<Result<_, _>>()?, labels))
}
