//! Plan of a frame: merged and placed layers, where they may be visible, and the cameras to sample
//! (L8, L10; C20).

use super::cells::{Batch, Bundle, Cells};
use super::layer_in_view::{LayerInView, MergedLayer};
use super::merge::Merger;
use super::show::{Show, from_far_to_near, own_color};
use super::taps::LANES;
use crate::Lumigraph;
use crate::bounds::ErrorBound;
use crate::grid::PlaneView;
use crate::settings::{Blend, LumigraphSettings};
use fearless_simd::{Level as SimdLevel, dispatch};
use glam::DVec2;
use headbox_core::camera::Camera;
use std::ops::Range;

/// Merged layers of one surface are about as far apart as cameras may disagree.
const NEIGHBOURS: f64 = 1.5;

/// Merging with less would tell rounding apart.
const LEAST_TOLERANCE_PX: f64 = 1e-6;

/// Layers nearer to the eye's own depth than this share of it cannot be drawn: they would fill the
/// frame.
const LEAST_AHEAD: f64 = 1e-6;

/// A coarser level serves from this share of an octave later on: between two levels the coarser
/// one, which is smoothed twice, errs more (docs/decisions/0040).
const SHARPER: f64 = 0.25;

/// The layers of a frame, near ones first; what is at infinity comes last.
pub(crate) fn merged_layers(
    lumigraph: &Lumigraph,
    view: &PlaneView,
    settings: &LumigraphSettings,
    merger: &mut Merger,
) -> Vec<MergedLayer> {
    let layers = lumigraph.layers();
    let focal_px = lumigraph.grid().focal_px();
    let [most, middle] = view.px_per_slope().unwrap_or([focal_px; 2]);
    let tolerance =
        settings.tolerance_px.max(LEAST_TOLERANCE_PX) * (1.0 / focal_px).max(1.0 / most);
    let bound = ErrorBound {
        focal: 1.0,
        spacing: lumigraph
            .grid()
            .spacing()
            .max(beside_the_grid(lumigraph, view)),
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
        let level = (finer - SHARPER).floor().clamp(0.0, coarsest as f64) as usize;
        (ahead > LEAST_AHEAD).then_some(MergedLayer {
            indices,
            with_neighbours: indices,
            drawn,
            level,
        })
    };
    let surfaces = merger.merged().iter().rev().filter_map(|range| {
        let whole = layers[range.start].through(&layers[range.end - 1]);
        merged([range.start as u16 + 1, range.end as u16], whole.drawn())
    });
    let mut found: Vec<MergedLayer> = surfaces.chain(merged([0, 0], 0.0)).collect();
    let near_enough = ErrorBound {
        tolerance: NEIGHBOURS * tolerance,
        ..bound
    };
    for i in 1..found.len() {
        let (front, behind) = (found[i - 1], found[i]);
        // What is at infinity is nobody's neighbour.
        if behind.drawn > 0.0 && near_enough.allows([behind.drawn, front.drawn]) {
            found[i - 1].with_neighbours[0] = behind.indices[0];
            found[i].with_neighbours[1] = front.indices[1];
        }
    }
    found
}

/// Largest distance from the nearest camera at which rays that may meet something cross the plane
/// outside the grid, metres: there the bound must hold for a single camera.
fn beside_the_grid(lumigraph: &Lumigraph, view: &PlaneView) -> f64 {
    let (grid, behind) = (lumigraph.grid(), view.behind());
    let [width, height] = view.size();
    let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
    let of_frame = corners.iter().try_fold(
        [DVec2::INFINITY, DVec2::NEG_INFINITY],
        |[low, high], &corner| {
            let crossing = view.crossing(view.slopes(corner)?);
            Some([low.min(crossing), high.max(crossing)])
        },
    );
    let Some([low, high]) = of_frame else {
        return 0.0;
    };
    let ends = |places: &[f64]| [places[0], places[places.len() - 1]];
    let (columns, rows) = (ends(grid.columns()), ends(grid.rows()));
    let mut beside = 0.0f64;
    for disparity in lumigraph.range().into_iter().flatten() {
        if 1.0 + behind * disparity <= LEAST_AHEAD {
            continue;
        }
        let [half_x, half_y] = grid
            .size_px()
            .map(|side| f64::from(side) / 2.0 / grid.focal_px());
        for (ends, half, eye, frame) in [
            (columns, half_x, view.eye.x, [low.x, high.x]),
            (rows, half_y, view.eye.y, [low.y, high.y]),
        ] {
            // The outermost points that the outermost cameras see at this depth, and where the
            // eye's rays to them cross.
            let crossings = [-1.0, 1.0].map(|side| {
                let of =
                    |place: f64| place + (side * half - place * grid.convergence()) / disparity;
                let point = if side < 0.0 {
                    of(ends[0]).min(of(ends[1]))
                } else {
                    of(ends[0]).max(of(ends[1]))
                };
                eye + (point - eye) * behind * disparity / (1.0 + behind * disparity)
            });
            let [low, high] = [
                crossings[0].min(crossings[1]),
                crossings[0].max(crossings[1]),
            ];
            beside = beside
                .max(ends[0] - low.max(frame[0]))
                .max(high.min(frame[1]) - ends[1]);
        }
    }
    beside
}

/// Colours by number: linear red, green and blue, 65535 for 1.
pub(super) struct Paint {
    /// Never [`Show::Colors`].
    pub(super) show: Show,
    pub(super) colors: Vec<[f32; 3]>,
}

impl Paint {
    fn new(lumigraph: &Lumigraph, show: Show) -> Option<Self> {
        let layers = lumigraph.layers().len();
        let colors = match show {
            Show::Colors => return None,
            Show::Layers => (0..=layers)
                .map(|i| from_far_to_near(i as f32 / layers.max(1) as f32))
                .collect(),
            Show::Merged => (0..=layers as u32).map(own_color).collect(),
            Show::Cameras => (0..lumigraph.grid().camera_count() as u32)
                .map(own_color)
                .collect(),
        };
        Some(Self { show, colors })
    }
}

/// State shared by all blocks of a frame.
pub(super) struct LumigraphPlan {
    pub(super) view: PlaneView,
    /// Near ones first.
    pub(super) layers: Vec<LayerInView>,
    /// The same.
    batches: Vec<Batch>,
    /// Cameras' places.
    pub(super) columns: Vec<f32>,
    pub(super) rows: Vec<f32>,
    pub(super) blend: Blend,
    /// Paint that replaces the images' colours.
    pub(super) paint: Option<Paint>,
    pub(super) skip: bool,
    /// Order in which cells are searched for surfaces hidden from a ray's own cell.
    pub(super) steps: Vec<Step>,
}

/// Order in which cells are searched for surfaces hidden from a ray's own cell, in a grid of
/// `columns` x `rows` cameras: first between the layers, then from neighbouring cells, near ones
/// first.
pub(crate) fn steps(columns: usize, rows: usize) -> Vec<Step> {
    let reach = |cameras: usize| WIDER.min(cameras.saturating_sub(2) as i32);
    let (columns, rows) = (reach(columns), reach(rows));
    let all = (-rows..=rows).flat_map(|row| (-columns..=columns).map(move |column| [column, row]));
    let mut beside: Vec<[i32; 2]> = all.filter(|cell| *cell != [0, 0]).collect();
    beside.sort_by_key(|[column, row]| column * column + row * row);
    let beside = beside.into_iter().map(|shift| Step {
        shift,
        loose: false,
    });
    std::iter::once(Step {
        loose: true,
        ..Step::FIRST
    })
    .chain(beside)
    .collect()
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
        let places = |places: &[f64]| places.iter().map(|place| *place as f32).collect();
        let layers: Vec<_> = merged
            .iter()
            .map(|layer| LayerInView::new(lumigraph, &view, layer))
            .collect();
        Self {
            view,
            batches: batches(&layers),
            layers,
            columns: places(grid.columns()),
            rows: places(grid.rows()),
            blend: settings.blend,
            paint: Paint::new(lumigraph, settings.show),
            skip: settings.skip,
            steps: steps(grid.columns().len(), grid.rows().len()),
        }
    }

    /// Rays with slopes from the least to the most along both axes, between the cameras of two
    /// columns and two rows.
    pub(super) fn bundle(
        &self,
        slopes: [[f32; 2]; 2],
        columns: [usize; 2],
        rows: [usize; 2],
    ) -> Bundle {
        let count = self.columns.len();
        Bundle {
            slopes,
            places: [
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

    /// The layers that may show in a block of the frame to the cameras of its rays' cells, and of
    /// `beside` cells around them.
    pub(super) fn layers_of(
        &self,
        cells: &Cells,
        columns: &Range<usize>,
        rows: &Range<usize>,
        beside: usize,
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
        let pairs = |places: &[f32], from: f32, until: f32| {
            let last = places.len() - 1;
            let first = cell(places, from).saturating_sub(beside);
            let end = (cell(places, until) + beside + 1).min(last);
            (first..=end.max(first))
                .step_by(2)
                .map(move |low| [low, (low + 1).min(last)])
        };
        let slopes = [[low.x, high.x], [low.y, high.y]];
        let mut near = vec![0; self.batches.len()];
        for rows in pairs(&self.rows, from.y, until.y) {
            for columns in pairs(&self.columns, from.x, until.x) {
                let bundle = self.bundle(slopes, columns, rows);
                for (near, batch) in near.iter_mut().zip(&self.batches) {
                    // What is looked for beside is looked for between layers as well.
                    *near |= dispatch!(level, simd => batch.near(simd, cells, &bundle, beside > 0))
                        .layers;
                }
            }
        }
        let of_batch = |(near, batch): (u32, &'_ Batch)| {
            let is_near = move |(i, _): &(usize, LayerInView)| near >> i & 1 == 1;
            batch
                .layers
                .clone()
                .into_iter()
                .enumerate()
                .filter(is_near)
                .map(|(_, layer)| layer)
                .collect::<Vec<_>>()
        };
        batches(
            &near
                .into_iter()
                .zip(&self.batches)
                .flat_map(of_batch)
                .collect::<Vec<_>>(),
        )
    }
}

/// Layers in batches.
fn batches(layers: &[LayerInView]) -> Vec<Batch> {
    layers.chunks(LANES).map(Batch::new).collect()
}

/// Cells that are asked to each side of a ray's own where all of its cameras look at something that
/// hides what the ray meets.
pub(super) const WIDER: i32 = 2;

/// A way to look for what a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    /// Whose cameras are asked: columns and rows from the ray's own cell.
    pub(crate) shift: [i32; 2],
    /// True if neighbouring layers count as this one: a steep surface falls between layers where no
    /// camera finds either of them at its own position.
    pub(crate) loose: bool,
}

impl Step {
    /// The first: the ray's own cell.
    pub(crate) const FIRST: Self = Self {
        shift: [0, 0],
        loose: false,
    };
}

/// Index of the gap between positions that contains `position`; the outermost one beyond them.
#[inline(always)]
pub(super) fn cell(places: &[f32], position: f32) -> usize {
    match places {
        [_, inner @ .., _] => inner.partition_point(|place| *place <= position),
        _ => 0,
    }
}
