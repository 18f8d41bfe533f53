//! Plan of a frame: merged and placed layers, where they may be visible, and the cameras to sample
//! (L8, L10; C20).

use super::cells::{Batch, Bundle, Cells};
use super::lanes::taps::LANES;
use super::layer_in_view::{LayerInView, MergedLayer};
use super::merge::Merger;
use super::show::{LumigraphOverlay, depth_color, palette_color};
use crate::Lumigraph;
use crate::bounds::ErrorBound;
use crate::grid::PlaneView;
use crate::settings::{Blend, LumigraphSettings};
use fearless_simd::{Level as SimdLevel, dispatch};
use glam::DVec2;
use headbox_core::camera::Camera;
use std::ops::Range;

/// Largest distance of neighbouring merged layers, in units of the allowed disagreement of cameras:
/// those of one surface are about 1 apart.
const NEIGHBOUR_DISTANCE: f64 = 1.5;

/// Smallest tolerance of merging, pixels: below it, rounding would decide.
const MIN_TOLERANCE_PX: f64 = 1e-6;

/// Smallest distance between a layer and the eye, as a share of the layer's depth: nearer layers
/// would fill the frame and are not drawn.
const MIN_AHEAD: f64 = 1e-6;

/// Bias towards finer levels, octaves: between two levels the coarser one, which is smoothed twice,
/// has the larger error (docs/decisions/0040).
const LEVEL_BIAS: f64 = 0.25;

/// Merges the layers of a frame, from near to far; infinity comes last.
pub(crate) fn merged_layers(
    lumigraph: &Lumigraph,
    view: &PlaneView,
    settings: &LumigraphSettings,
    merger: &mut Merger,
) -> Vec<MergedLayer> {
    let layers = lumigraph.layers();
    let focal_px = lumigraph.grid().focal_px();
    let [most, middle] = view.px_per_slope().unwrap_or([focal_px; 2]);
    let tolerance = settings.tolerance_px.max(MIN_TOLERANCE_PX) * (1.0 / focal_px).max(1.0 / most);
    let bound = ErrorBound {
        focal: 1.0,
        spacing: lumigraph
            .grid()
            .spacing()
            .max(distance_outside_grid(lumigraph, view)),
        behind: view.behind(),
        tolerance: if settings.merge { tolerance } else { -1.0 },
    };
    merger.update(layers, &bound);
    let coarsest = if settings.levels {
        lumigraph.pyramid.levels.len() - 1
    } else {
        0
    };
    let merged = |indices: [u16; 2], drawn: f64| {
        let ahead = 1.0 + view.behind() * drawn;
        let finer = (focal_px * ahead / middle).log2();
        let level = (finer - LEVEL_BIAS).floor().clamp(0.0, coarsest as f64) as usize;
        (ahead > MIN_AHEAD).then_some(MergedLayer {
            indices,
            with_neighbours: indices,
            drawn,
            level,
        })
    };
    let surfaces = merger.merged.iter().rev().filter_map(|range| {
        let whole = layers[range.start].through(&layers[range.end - 1]);
        merged([range.start as u16 + 1, range.end as u16], whole.drawn())
    });
    let mut merged_layers: Vec<_> = surfaces.chain(merged([0, 0], 0.0)).collect();
    let near_enough = ErrorBound {
        tolerance: NEIGHBOUR_DISTANCE * tolerance,
        ..bound
    };
    for i in 1..merged_layers.len() {
        let (front, behind) = (merged_layers[i - 1], merged_layers[i]);
        // Infinity is not a neighbour of a layer.
        if behind.drawn > 0.0 && near_enough.allows([behind.drawn, front.drawn]) {
            merged_layers[i - 1].with_neighbours[0] = behind.indices[0];
            merged_layers[i].with_neighbours[1] = front.indices[1];
        }
    }
    merged_layers
}

/// Returns the largest distance outside the grid at which rays towards visible surfaces cross the
/// plane, metres: there the bound must hold for a single camera.
fn distance_outside_grid(lumigraph: &Lumigraph, view: &PlaneView) -> f64 {
    let (grid, behind) = (lumigraph.grid(), view.behind());
    let [width, height] = view.size;
    let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
    let crossings = corners.iter().try_fold(
        [DVec2::INFINITY, DVec2::NEG_INFINITY],
        |[low, high], &corner| {
            let crossing = view.crossing(view.slopes(corner)?);
            Some([low.min(crossing), high.max(crossing)])
        },
    );
    let Some([low, high]) = crossings else {
        return 0.0;
    };
    let ends = |positions: &[f64]| [positions[0], positions[positions.len() - 1]];
    let (columns, rows) = (ends(grid.columns()), ends(grid.rows()));
    let [half_x, half_y] = grid
        .size_px()
        .map(|side| f64::from(side) / 2.0 / grid.focal_px());
    let mut outside = 0.0f64;
    for disparity in lumigraph.range().into_iter().flatten() {
        if 1.0 + behind * disparity <= MIN_AHEAD {
            continue;
        }
        for (ends, half, eye, frame) in [
            (columns, half_x, view.eye.x, [low.x, high.x]),
            (rows, half_y, view.eye.y, [low.y, high.y]),
        ] {
            // Outermost points that the outermost cameras see at this depth, and the crossings of
            // the eye's rays to them.
            let crossings = [-1.0, 1.0].map(|side| {
                let edge =
                    |camera: f64| camera + (side * half - camera * grid.convergence()) / disparity;
                let point = if side < 0.0 {
                    edge(ends[0]).min(edge(ends[1]))
                } else {
                    edge(ends[0]).max(edge(ends[1]))
                };
                eye + (point - eye) * behind * disparity / (1.0 + behind * disparity)
            });
            let [low, high] = [
                crossings[0].min(crossings[1]),
                crossings[0].max(crossings[1]),
            ];
            outside = outside
                .max(ends[0] - low.max(frame[0]))
                .max(high.min(frame[1]) - ends[1]);
        }
    }
    outside
}

/// Colours of an overlay by layer or camera number.
pub(super) struct Paint {
    /// Never [`Show::Colors`].
    pub(super) show: LumigraphOverlay,
    /// Linear red, green and blue, 65535 for 1.
    pub(super) colors: Vec<[f32; 3]>,
}

impl Paint {
    fn new(lumigraph: &Lumigraph, show: LumigraphOverlay) -> Option<Self> {
        let layers = lumigraph.layers().len();
        let colors = match show {
            LumigraphOverlay::Colors => return None,
            LumigraphOverlay::Layers => (0..=layers)
                .map(|i| depth_color(i as f32 / layers.max(1) as f32))
                .collect(),
            LumigraphOverlay::Merged => (0..=layers as u32).map(palette_color).collect(),
            LumigraphOverlay::Cameras => (0..lumigraph.grid().camera_count() as u32)
                .map(palette_color)
                .collect(),
        };
        Some(Self { show, colors })
    }
}

/// State shared by all blocks of a frame.
pub(crate) struct LumigraphPlan {
    pub(super) view: PlaneView,
    /// From near to far.
    pub(super) layers: Vec<LayerInView>,
    /// The same layers.
    batches: Vec<Batch>,
    /// Camera positions along the columns, metres.
    pub(super) columns: Vec<f32>,
    /// Camera positions along the rows, metres.
    pub(super) rows: Vec<f32>,
    pub(super) blend: Blend,
    /// Paint that replaces the images' colours.
    pub(super) paint: Option<Paint>,
    /// See [`LumigraphSettings::skip`].
    pub(super) skip: bool,
    /// Order in which cells are searched for surfaces hidden from a ray's own cell.
    pub(super) steps: Vec<Step>,
}

/// Returns the order in which cells are searched for surfaces hidden from a ray's own cell, in a
/// grid of `columns` x `rows` cameras: first between the layers, then from neighbouring cells, near
/// ones first.
pub(crate) fn steps(columns: usize, rows: usize) -> Vec<Step> {
    let reach = |cameras: usize| SEARCH_RADIUS.min(cameras.saturating_sub(2) as i32);
    let (columns, rows) = (reach(columns), reach(rows));
    let all = (-rows..=rows).flat_map(|row| (-columns..=columns).map(move |column| [column, row]));
    let mut others: Vec<[i32; 2]> = all.filter(|cell| *cell != [0, 0]).collect();
    others.sort_by_key(|[column, row]| column * column + row * row);
    let between_layers = Step {
        with_neighbours: true,
        ..Step::FIRST
    };
    let others = others.into_iter().map(|shift| Step {
        shift,
        with_neighbours: false,
    });
    std::iter::once(between_layers).chain(others).collect()
}

impl LumigraphPlan {
    /// Plans a frame; the merger holds the layers of the last one.
    pub(super) fn new(
        lumigraph: &Lumigraph,
        camera: &Camera,
        settings: &LumigraphSettings,
        merger: &mut Merger,
    ) -> Self {
        let (grid, view) = (lumigraph.grid(), PlaneView::new(lumigraph.grid(), camera));
        let merged = merged_layers(lumigraph, &view, settings, merger);
        let to_f32 = |positions: &[f64]| positions.iter().map(|at| *at as f32).collect();
        let layers: Vec<_> = merged
            .iter()
            .map(|layer| LayerInView::new(lumigraph, &view, layer))
            .collect();
        Self {
            view,
            batches: batches(&layers),
            layers,
            columns: to_f32(grid.columns()),
            rows: to_f32(grid.rows()),
            blend: settings.blend,
            paint: Paint::new(lumigraph, settings.show),
            skip: settings.skip,
            steps: steps(grid.columns().len(), grid.rows().len()),
        }
    }

    /// Creates a bundle of rays with slopes between a minimum and a maximum along both axes,
    /// between the cameras of two columns and two rows.
    pub(super) fn bundle(
        &self,
        slopes: [[f32; 2]; 2],
        columns: [usize; 2],
        rows: [usize; 2],
    ) -> Bundle {
        let count = self.columns.len();
        Bundle {
            slopes,
            positions: [
                columns.map(|column| self.columns[column]),
                rows.map(|row| self.rows[row]),
            ],
            cameras: [
                rows[0] * count + columns[0],
                rows[0] * count + columns[1],
                rows[1] * count + columns[0],
                rows[1] * count + columns[1],
            ],
        }
    }

    /// Returns the layers that may be visible in a block of the frame from the cells of its rays,
    /// and from cells up to `radius` around them.
    pub(super) fn visible_layers(
        &self,
        cells: &Cells,
        columns: &Range<usize>,
        rows: &Range<usize>,
        radius: usize,
        level: SimdLevel,
    ) -> Vec<Batch> {
        let ends = |range: &Range<usize>| [range.start as f64, range.end as f64];
        let corners = ends(columns)
            .into_iter()
            .flat_map(|x| ends(rows).map(|y| [x, y]));
        let slopes = corners
            .map(|corner| self.view.slopes(corner))
            .collect::<Option<Vec<DVec2>>>();
        let Some(slopes) = slopes.filter(|_| self.skip) else {
            return batches(&self.layers);
        };
        let bounds = |points: &mut dyn Iterator<Item = DVec2>| {
            points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| {
                [low.min(p), high.max(p)]
            })
        };
        let [low, high] = bounds(&mut slopes.iter().copied()).map(DVec2::as_vec2);
        let [from, until] = bounds(&mut slopes.iter().map(|&slopes| self.view.crossing(slopes)))
            .map(DVec2::as_vec2);
        // Two cameras of each axis at a time.
        let pairs = |positions: &[f32], from: f32, until: f32| {
            let last = positions.len() - 1;
            let first = cell(positions, from).saturating_sub(radius);
            let end = (cell(positions, until) + radius + 1).min(last);
            (first..=end.max(first))
                .step_by(2)
                .map(move |low| [low, (low + 1).min(last)])
        };
        let slopes = [[low.x, high.x], [low.y, high.y]];
        let mut visible = vec![0; self.batches.len()];
        for rows in pairs(&self.rows, from.y, until.y) {
            for columns in pairs(&self.columns, from.x, until.x) {
                let bundle = self.bundle(slopes, columns, rows);
                for (visible, batch) in visible.iter_mut().zip(&self.batches) {
                    // The search of other cells also includes neighbouring layers.
                    *visible |=
                        dispatch!(level, simd => batch.visible(simd, cells, &bundle, radius > 0))
                            .layers;
                }
            }
        }
        let visible_layers = visible
            .into_iter()
            .zip(&self.batches)
            .flat_map(|(bits, batch)| {
                let layers = batch.layers.iter().enumerate();
                layers.filter_map(move |(i, layer)| (bits >> i & 1 == 1).then_some(*layer))
            });
        batches(&visible_layers.collect::<Vec<_>>())
    }
}

/// Divides layers into batches.
fn batches(layers: &[LayerInView]) -> Vec<Batch> {
    layers.chunks(LANES).map(Batch::new).collect()
}

/// Radius of the search for hidden surfaces, cells around the ray's own cell.
pub(super) const SEARCH_RADIUS: i32 = 2;

/// Step of the search for the surface that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    /// Cell whose cameras are tested: columns and rows from the ray's own cell.
    pub(crate) shift: [i32; 2],
    /// True if neighbouring layers count as the layer: a steep surface can fall between two layers,
    /// where no camera sees either of them at its own position.
    pub(crate) with_neighbours: bool,
}

impl Step {
    /// First step: the ray's own cell.
    pub(crate) const FIRST: Self = Self {
        shift: [0, 0],
        with_neighbours: false,
    };
}

/// Returns the index of the gap between positions that contains `position`; the outermost gap if it
/// is outside.
#[inline(always)]
pub(super) fn cell(positions: &[f32], position: f32) -> usize {
    match positions {
        [_, inner @ .., _] => inner.partition_point(|at| *at <= position),
        _ => 0,
    }
}
