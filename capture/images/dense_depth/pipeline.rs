//! Stereo pipeline of a set: passes over all views, with their planes in a temporary file.

use super::consistency::{Confirmation, confirm, remove_specks};
use super::matching::hypotheses::{Chequerboard, Hypothesis};
use super::matching::patch_match::{
    KnownDepths, MAX_NEIGHBORS, Matcher, NeighborView, Perturbation,
};
use super::matching::picture::{Grey, MatchView};
use super::matching::relative::{LevelCamera, Relative};
use super::matching::zncc::Patch;
use super::neighbors::Candidate;
use super::search_counts::SearchCounts;
use super::storage::{Spool, ViewCache};
use super::{DenseDepth, DenseDepthError, EstimatedDepth};
use crate::{ImagesError, LoadedView, Pinhole, View, backdrop};
use headbox_core::simd;
use headbox_core::statistics::median;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// PatchMatch rounds per image level, finest level first: motion (pixels) and slope of the
/// perturbations, which shrink from round to round.
pub(super) const ROUNDS: [&[(f32, f32)]; 3] = [
    &[(1.0, 0.3), (0.5, 0.15), (0.25, 0.08)],
    &[(1.0, 0.5), (0.5, 0.2), (0.25, 0.1)],
    &[(2.0, 1.0), (2.0, 0.7), (1.0, 0.5), (0.5, 0.3)],
];

/// Number of joint passes over all views, and the rounds of each.
pub(super) const JOINT_PASSES: usize = 2;
const JOINT_ROUNDS: [(f32, f32); 2] = [(0.5, 0.15), (0.2, 0.05)];

/// Maximum cost of a valid plane, regardless of confirmations.
const MAX_COST: f32 = 0.9;

/// Minimum number of pixels of a connected patch.
const SPECK: usize = 60;

/// Ratio of the standard deviation of a view's inverse depths to the median difference between two
/// views: 1.4826 / sqrt(2) for normal errors.
const DEVIATION: f64 = 1.048;

/// Maximum number of views used to detect a dark backdrop.
const BACKDROP_VIEWS: usize = 16;

/// State of the pipeline.
pub(super) struct Pipeline<'a> {
    settings: &'a DenseDepth,
    pub(super) views: &'a [&'a View],
    /// Lenses of the views' colours.
    lenses: Vec<Pinhole>,
    folder: &'a Path,
    pub(super) view_cache: ViewCache<'a>,
    /// Neighbours of each view.
    neighbors: Vec<Vec<usize>>,
    /// Planes of the last pass.
    current: Spool,
    /// Planes of the pass in progress.
    next: Spool,
    /// Counts of [`Self::filter`].
    counts: SearchCounts,
}

impl<'a> Pipeline<'a> {
    pub(super) fn new(
        settings: &'a DenseDepth,
        views: &'a [&'a View],
        lenses: Vec<Pinhole>,
        folder: &'a Path,
    ) -> Result<Self, DenseDepthError> {
        let step = views.len().div_ceil(BACKDROP_VIEWS);
        let sampled: Result<Vec<LoadedView>, ImagesError> = views
            .par_iter()
            .step_by(step)
            .map(|view| view.load())
            .collect();
        let dark = backdrop::find_threshold(&sampled?);
        let load = move |i: usize| {
            let view = views[i].load()?;
            let background = backdrop::background_mask(&view, dark);
            MatchView::new(&view, background, settings.longest_px, settings.coarsest_px).ok_or_else(
                || ImagesError::invalid_picture(&views[i].color, "is not a perspective image"),
            )
        };
        let plane_counts = || {
            views.iter().map(|view| {
                let [mut width, mut height] = view.size_px;
                while width.max(height) > settings.longest_px.max(1) {
                    (width, height) = ((width / 2).max(1), (height / 2).max(1));
                }
                width as usize * height as usize
            })
        };
        let spool = || {
            Spool::new(folder, plane_counts()).map_err(|cause| DenseDepthError::Spool {
                folder: folder.into(),
                cause,
            })
        };
        let view_cache = ViewCache::new(settings.budget_bytes, load);
        Ok(Self {
            settings,
            views,
            lenses,
            folder,
            view_cache,
            neighbors: vec![Vec::new(); views.len()],
            current: spool()?,
            next: spool()?,
            counts: SearchCounts {
                views: views.len(),
                ..SearchCounts::default()
            },
        })
    }

    fn spool_error(&self, cause: std::io::Error) -> DenseDepthError {
        DenseDepthError::Spool {
            folder: self.folder.into(),
            cause,
        }
    }

    /// Stores the planes of a view and its neighbours.
    pub(super) fn store(
        &mut self,
        view: usize,
        neighbors: Vec<usize>,
        planes: &[Hypothesis],
    ) -> Result<(), DenseDepthError> {
        self.neighbors[view] = neighbors;
        self.current
            .write(view, planes)
            .map_err(|cause| self.spool_error(cause))
    }

    /// Returns the maximum number of neighbours of a view.
    pub(super) fn max_neighbors(&self) -> usize {
        self.settings.neighbors.clamp(1, MAX_NEIGHBORS)
    }

    /// Returns the camera of a view, without loading its image.
    pub(super) fn candidate(&self, view: usize) -> Candidate {
        Candidate {
            camera: LevelCamera::new(self.lenses[view], self.views[view].color_pose(), 0),
            size: self.views[view].size_px.map(f64::from),
        }
    }

    /// Returns the images of `chosen` indices into `near`.
    pub(super) fn pictures(
        &mut self,
        near: &[usize],
        chosen: &[usize],
    ) -> Result<Vec<Arc<MatchView>>, ImagesError> {
        chosen
            .iter()
            .map(|&i| self.view_cache.get(near[i]))
            .collect()
    }

    /// Returns a view and its neighbours with their current depths.
    fn load_with_neighbors(&mut self, view: usize) -> Result<ViewWithNeighbors, DenseDepthError> {
        let own = self.view_cache.get(view)?;
        let mut neighbors = Vec::new();
        for other in self.neighbors[view].clone() {
            let depths = self
                .current
                .inverse_depths(other)
                .map_err(|cause| self.spool_error(cause))?;
            neighbors.push((self.view_cache.get(other)?, Arc::new(depths)));
        }
        Ok(ViewWithNeighbors { own, neighbors })
    }

    /// Makes the planes of the finished pass the current ones.
    pub(super) fn swap(&mut self) {
        std::mem::swap(&mut self.current, &mut self.next);
    }

    /// Refines the planes of a view, constrained by the depths of its neighbours.
    pub(super) fn estimate_jointly(&mut self, view: usize) -> Result<(), DenseDepthError> {
        let loaded_views = self.load_with_neighbors(view)?;
        let own = loaded_views.own.level(0);
        let planes = self
            .current
            .read(view)
            .map_err(|cause| self.spool_error(cause))?;
        let mut board = Chequerboard::from_rows(own.width, own.height, &planes);
        let depths = planes
            .iter()
            .map(|plane| plane.inverse_depth)
            .filter(|q| *q > 0.0);
        let range = depths.fold([f32::INFINITY, 0.0f32], |[low, high], q| {
            [low.min(q), high.max(q)]
        });
        let matcher = Matcher {
            picture: own,
            focal_px: loaded_views.own.camera(0).focal_px[0] as f32,
            others: loaded_views.matched_neighbors(),
            range,
            seed: headbox_core::random::hash(!(view as u64)),
            level: simd::level(),
        };
        matcher.evaluate(&mut board);
        run_rounds(&matcher, &mut board, &JOINT_ROUNDS, false);
        self.next
            .write(view, &board.rows())
            .map_err(|cause| self.spool_error(cause))
    }

    /// Counts of the filtered views; pixels without texture are counted only if no depth was found.
    pub(super) fn search_counts(&mut self) -> Result<SearchCounts, ImagesError> {
        if self.counts.confirmed == 0 {
            for view in 0..self.views.len() {
                if !self.neighbors[view].is_empty() {
                    let picture = self.view_cache.get(view)?;
                    self.counts.textureless += count_textureless(picture.level(0));
                }
            }
        }
        Ok(self.counts)
    }

    /// Keeps the depths of a view that its neighbours confirm, at the size of its image.
    pub(super) fn filter(&mut self, view: usize) -> Result<EstimatedDepth, DenseDepthError> {
        let loaded_views = self.load_with_neighbors(view)?;
        let own = loaded_views.own.level(0);
        let mut planes = self
            .current
            .read(view)
            .map_err(|cause| self.spool_error(cause))?;
        let others = loaded_views.matched_neighbors();
        let needed = self.settings.confirmations.min(others.len()).max(1);
        let is_valid = |plane: &Hypothesis| plane.inverse_depth > 0.0 && plane.cost <= MAX_COST;
        let confirmations: Vec<Option<Confirmation>> = planes
            .par_iter()
            .enumerate()
            .map(|(i, plane)| {
                let pixel = [(i % own.width) as f32 + 0.5, (i / own.width) as f32 + 0.5];
                is_valid(plane)
                    .then(|| confirm(&others, pixel, plane))
                    .filter(|confirmation| confirmation.is_sufficient(needed))
            })
            .collect();
        let difference = median(
            confirmations
                .iter()
                .flatten()
                .map(|confirmation| f64::from(confirmation.difference)),
        );
        let deviation = (difference.unwrap_or(0.0) * DEVIATION) as f32;
        let share = |confirmation: &Option<Confirmation>| {
            confirmation.map_or(0.0, |c| f32::from(c.confirming) / others.len() as f32)
        };
        let confidence: Vec<f32> = confirmations.iter().map(share).collect();
        let mut filtered: Vec<f32> = planes
            .iter()
            .zip(&confidence)
            .map(|(plane, c)| if *c > 0.0 { plane.inverse_depth } else { 0.0 })
            .collect();
        remove_specks(&mut filtered, own.width, SPECK);
        if others.is_empty() {
            self.counts.isolated += 1;
        } else {
            let count = |is_counted: &dyn Fn(&Hypothesis) -> bool| {
                planes.iter().filter(|plane| is_counted(plane)).count() as u64
            };
            self.counts.pixels += planes.len() as u64;
            self.counts.matched += count(&is_valid);
            self.counts.confirmed += filtered.iter().filter(|q| **q > 0.0).count() as u64;
        }
        for (plane, filtered) in planes.iter_mut().zip(filtered) {
            plane.inverse_depth = filtered;
        }
        let mut loaded = self.views[view].load()?;
        let reduced = loaded_views.own.reduced();
        let (depth, confidence) = upsample(&loaded, own, reduced, &planes, &confidence);
        loaded.depth = depth;
        Ok(EstimatedDepth {
            view: loaded,
            confidence,
            deviation,
        })
    }
}

/// A view and its neighbours with their inverse depths.
struct ViewWithNeighbors {
    own: Arc<MatchView>,
    neighbors: Vec<(Arc<MatchView>, Arc<Vec<f32>>)>,
}

impl ViewWithNeighbors {
    fn matched_neighbors(&self) -> Vec<NeighborView<'_>> {
        self.neighbors
            .iter()
            .map(|(picture, depths)| {
                match_neighbor(&self.own, picture, 0, Some(Arc::clone(depths)))
            })
            .collect()
    }
}

/// Relates a view to a neighbour at an image level.
fn match_neighbor<'a>(
    own: &MatchView,
    other: &'a MatchView,
    level: usize,
    known: Option<Arc<Vec<f32>>>,
) -> NeighborView<'a> {
    let own_camera = own.camera(level);
    let other_camera = other.camera(level);
    let known = known.map(|inverse_depths| KnownDepths {
        inverse_depths,
        back: Relative::new(&other_camera, &own_camera),
    });
    NeighborView {
        relative: Relative::new(&own_camera, &other_camera),
        picture: other.level(level),
        known,
    }
}

/// Creates a matcher at an image level of a view, with neighbours without depth.
pub(super) fn create_matcher<'a>(
    own: &'a MatchView,
    pictures: &'a [Arc<MatchView>],
    level: usize,
    range: [f32; 2],
    seed: u64,
) -> Matcher<'a> {
    Matcher {
        picture: own.level(level),
        focal_px: own.camera(level).focal_px[0] as f32,
        others: pictures
            .iter()
            .map(|picture| match_neighbor(own, picture, level, None))
            .collect(),
        range,
        seed: seed ^ level as u64,
        level: simd::level(),
    }
}

/// Number of pixels whose patch has no more contrast than noise.
fn count_textureless(picture: &Grey) -> u64 {
    let count_row = |y: usize| {
        (0..picture.width)
            .filter(|&x| !Patch::new(picture, x, y).has_texture())
            .count() as u64
    };
    (0..picture.height).into_par_iter().map(count_row).sum()
}

/// Runs rounds of PatchMatch.
pub(super) fn run_rounds(
    matcher: &Matcher,
    board: &mut Chequerboard,
    rounds: &[(f32, f32)],
    anywhere: bool,
) {
    for (round, &(motion_px, slope)) in rounds.iter().enumerate() {
        matcher.improve(
            board,
            Perturbation {
                motion_px,
                slope,
                anywhere,
                round: round as u64,
            },
        );
    }
}

/// Evaluates planes of a smaller image at every pixel of a view: depth and confidence.
fn upsample(
    view: &LoadedView,
    small: &Grey,
    reduced: u32,
    planes: &[Hypothesis],
    confidence: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    let [width, height] = view.size_px;
    let pixels = width as usize * height as usize;
    let mut depths = vec![f32::NAN; pixels];
    let mut confidences = vec![0.0; pixels];
    for y in 0..height {
        for x in 0..width {
            let column = (x / reduced) as usize;
            let row = (y / reduced) as usize;
            if column >= small.width || row >= small.height {
                continue;
            }
            let plane = &planes[row * small.width + column];
            let offset = |fine: u32, coarse: usize| {
                (fine as f32 + 0.5) / reduced as f32 - (coarse as f32 + 0.5)
            };
            let inverse_depth = plane
                .shifted(offset(x, column), offset(y, row))
                .inverse_depth;
            if plane.inverse_depth > 0.0 && inverse_depth > 0.0 {
                let pixel = (y * width + x) as usize;
                depths[pixel] = 1.0 / inverse_depth;
                confidences[pixel] = confidence[row * small.width + column];
            }
        }
    }
    (depths, confidences)
}
