//! Assignment of pixels to planes by depth, by photo-consistency of the frames on the plane, and by
//! neighbours (costs aggregated along eight directions, Hirschmueller 2008, here of labels instead
//! of disparities), or by masks.

use super::canvas::Canvas;
use super::frames::{Frame, Frames};
use super::planes::Affine;
use super::{LayersError, MIN_PIXELS, Mask, planes};
use rayon::prelude::*;

/// Label of pixels without a layer.
pub(super) const NONE: u8 = u8::MAX;

/// Maximum cost of the distance from a plane, and the distance of that cost, in tolerances.
const DEPTH_COST: f32 = 1.0;
const MAX_DISTANCE: f64 = 6.0;

/// Maximum cost of colour differences between frames, the difference of that cost above the noise,
/// and the difference due to noise and lighting, levels.
const COLOR_COST: f32 = 0.35;
const MAX_LEVELS: f32 = 40.0;
const NOISE_LEVELS: f32 = 5.0;

/// Radius of the window over which frames are compared, pixels.
const WINDOW: usize = 2;

/// Cost of different labels of neighbours in even areas and at strong edges, and the scale of its
/// decrease, levels.
const SMOOTHNESS_COST: [f32; 2] = [1.5, 0.15];
const EDGE_LEVELS: f32 = 10.0;

/// Minimum number of pixels of a patch of one label.
const SPECK: usize = 80;

/// Directions along which costs are aggregated.
const DIRECTIONS: [[isize; 2]; 8] = [
    [1, 0],
    [-1, 0],
    [0, 1],
    [0, -1],
    [1, 1],
    [-1, -1],
    [1, -1],
    [-1, 1],
];

/// Assigns a plane to each pixel.
pub(super) fn assign(canvas: &Canvas, frames: &Frames, planes: &[Affine]) -> Vec<u8> {
    let costs = compute_costs(canvas, frames, planes);
    let mut sums = vec![0.0f32; costs.len()];
    for direction in DIRECTIONS {
        aggregate_along(canvas, &costs, planes.len(), direction, &mut sums);
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
    merge_specks(canvas, &mut labels);
    labels
}

/// Returns the cost of each plane at each pixel.
fn compute_costs(canvas: &Canvas, frames: &Frames, planes: &[Affine]) -> Vec<f32> {
    let differences: Vec<Vec<f32>> = planes
        .iter()
        .map(|plane| average(canvas, &color_differences(canvas, frames, plane)))
        .collect();
    let max_distance = (MAX_DISTANCE * canvas.on_plane_px) as f32;
    let pixel_costs = |pixel: usize| {
        let differences = &differences;
        planes.iter().enumerate().map(move |(label, plane)| {
            let known = canvas.inverse_depth[pixel];
            let distance = plane.distance_px(canvas, pixel, known).abs() as f32;
            let depth_cost = if known > 0.0 {
                DEPTH_COST * (distance / max_distance).min(1.0)
            } else {
                0.0
            };
            depth_cost
                + COLOR_COST
                    * ((differences[label][pixel] - NOISE_LEVELS) / MAX_LEVELS).clamp(0.0, 1.0)
        })
    };
    (0..canvas.shown.len())
        .into_par_iter()
        .flat_map_iter(pixel_costs)
        .collect()
}

/// Returns the colour difference of the frames from the canvas on a plane, levels: the mean of the
/// better half of the frames, because the plane may be occluded in the others.
fn color_differences(canvas: &Canvas, frames: &Frames, plane: &Affine) -> Vec<f32> {
    let pixel_difference = |pixel: usize| {
        let inverse_depth = plane.inverse_depth(canvas.center(pixel));
        if !canvas.shown[pixel] || inverse_depth <= 0.0 {
            return MAX_LEVELS;
        }
        let point = canvas.point(pixel, inverse_depth);
        let difference = |frame: &Frame| {
            let [x, y, _] = frame.project(point)?;
            let color = frame.color_at(x, y)?;
            Some(
                (0..3)
                    .map(|c| (color[c] - canvas.color[pixel][c]).abs())
                    .sum::<f32>()
                    / 3.0,
            )
        };
        let mut all: Vec<f32> = frames.others().iter().filter_map(difference).collect();
        all.sort_unstable_by(f32::total_cmp);
        all.truncate(all.len().div_ceil(2));
        if all.is_empty() {
            MAX_LEVELS
        } else {
            all.iter().sum::<f32>() / all.len() as f32
        }
    };
    (0..canvas.shown.len())
        .into_par_iter()
        .map(pixel_difference)
        .collect()
}

/// Averages values over the visible pixels of a window.
fn average(canvas: &Canvas, values: &[f32]) -> Vec<f32> {
    let mean = |pixel: usize| {
        let (sum, count) = canvas
            .around(pixel, WINDOW)
            .filter(|near| canvas.shown[*near])
            .fold((0.0f32, 0.0f32), |(sum, count), near| {
                (sum + values[near].min(MAX_LEVELS), count + 1.0)
            });
        sum / count.max(1.0)
    };
    (0..values.len()).into_par_iter().map(mean).collect()
}

/// Adds to `sums` the cost of each label of each pixel, aggregated along one direction.
fn aggregate_along(
    canvas: &Canvas,
    costs: &[f32],
    count: usize,
    [dx, dy]: [isize; 2],
    sums: &mut [f32],
) {
    let width = canvas.width;
    let height = canvas.height;
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
                    smoothness_cost(&canvas.color[before], &canvas.color[pixel]),
                )
            });
            for label in 0..count {
                let path_cost = least.map_or(0.0, |(before, least, smoothness)| {
                    // Relative to the minimum, so that sums stay small.
                    (along[before * count + label] - least).min(smoothness)
                });
                along[pixel * count + label] = costs[pixel * count + label] + path_cost;
                sums[pixel * count + label] += costs[pixel * count + label] + path_cost;
            }
        }
    }
}

/// Returns the cost of different labels of two neighbours.
fn smoothness_cost(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let levels = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
    let [even, edge] = SMOOTHNESS_COST;
    edge + (even - edge) * (-levels / EDGE_LEVELS).exp()
}

/// Relabels small patches with the most frequent label around them.
fn merge_specks(canvas: &Canvas, labels: &mut [u8]) {
    let mut visited = vec![false; labels.len()];
    for start in 0..labels.len() {
        if visited[start] || labels[start] == NONE {
            continue;
        }
        visited[start] = true;
        let mut patch = vec![start];
        let mut adjacent = [0usize; 256];
        let mut next = 0;
        while let Some(&pixel) = patch.get(next) {
            next += 1;
            for near in canvas.around(pixel, 1) {
                if labels[near] != labels[start] {
                    adjacent[usize::from(labels[near])] += 1;
                } else if !visited[near] {
                    visited[near] = true;
                    patch.push(near);
                }
            }
        }
        adjacent[usize::from(NONE)] = 0;
        let most = (0..256)
            .max_by_key(|label| (adjacent[*label], std::cmp::Reverse(*label)))
            .unwrap_or(0);
        if patch.len() < SPECK && adjacent[most] > 0 {
            patch.iter().for_each(|pixel| labels[*pixel] = most as u8);
        }
    }
}

/// Assigns pixels by hand-drawn masks, and fits their planes.
pub(super) fn assign_masks(
    canvas: &Canvas,
    frames: &Frames,
    masks: &[Mask],
) -> Result<(Vec<Affine>, Vec<u8>), LayersError> {
    let middle = frames.middle();
    let expected = middle.view.size_px;
    for Mask { path, picture } in masks {
        let size = [picture.width(), picture.height()];
        if size != expected {
            let name = frames.middle_name().into();
            return Err(LayersError::MaskSize {
                path: path.clone(),
                size,
                name,
                expected,
            });
        }
    }
    let label = |pixel: usize| {
        let projected = middle
            .project(canvas.point(pixel, 1.0))
            .filter(|_| canvas.shown[pixel]);
        let [x, y, _] = projected?;
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
        let known = own
            .iter()
            .filter(|pixel| canvas.inverse_depth[**pixel] > 0.0)
            .count();
        let plane =
            planes::find_in_pixels(canvas, &own, number as u64).filter(|_| known >= MIN_PIXELS);
        plane.ok_or_else(|| LayersError::EmptyMask {
            path: mask.path.clone(),
            known,
        })
    });
    Ok((planes.collect::<Result<_, _>>()?, labels))
}
