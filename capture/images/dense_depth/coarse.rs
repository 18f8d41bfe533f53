//! Coarse-to-fine estimation of a single view: plane sweep in the smallest image, selection of the
//! neighbours, then refinement in finer images.

use super::DenseDepthError;
use super::matching::hypotheses::{Chequerboard, Hypothesis};
use super::matching::picture::MatchView;
use super::neighbors::{self, Candidate};
use super::pipeline::{Pipeline, ROUNDS, create_matcher, run_rounds};
use crate::ImagesError;
use glam::DVec3;

/// Maximum cost of planes that determine the depth range.
const GOOD_COST: f32 = 0.25;

/// Estimate of a view in its smallest image.
struct CoarseEstimate {
    /// Selected neighbours, as indices of the near views.
    neighbors: Vec<usize>,
    /// Range of inverse depths, 1/m.
    range: [f32; 2],
    board: Chequerboard,
    seed: u64,
}

impl Pipeline<'_> {
    /// Returns the indices and the cameras of the candidate neighbours of a view.
    fn find_candidates(&self, view: usize) -> (Vec<usize>, Vec<Candidate>) {
        let eyes: Vec<DVec3> = self
            .views
            .iter()
            .map(|view| view.color_pose().eye)
            .collect();
        let near = neighbors::candidates(&eyes, view);
        let candidates = near.iter().map(|&i| self.candidate(i)).collect();
        (near, candidates)
    }

    /// Estimates planes of a view in its smallest image from some of the near views, then selects
    /// neighbours at the estimated depths with `select`. `None` if no view overlaps.
    fn estimate_coarse(
        &mut self,
        view: usize,
        near: &[usize],
        candidates: &[Candidate],
        mut selected: Vec<usize>,
        select: impl Fn(&Candidate, Vec<DVec3>) -> Vec<usize>,
    ) -> Result<Option<CoarseEstimate>, ImagesError> {
        let own = self.view_cache.get(view)?;
        let here = self.candidate(view);
        let pictures = self.pictures(near, &selected)?;
        let chosen: Vec<&Candidate> = selected.iter().map(|&i| &candidates[i]).collect();
        let Some(mut range) = neighbors::depth_range(&here, &chosen) else {
            return Ok(None);
        };
        let coarsest = own.levels() - 1;
        let seed = headbox_core::random::hash(view as u64);
        let picture = own.level(coarsest);
        let mut board = Chequerboard::new(picture.width, picture.height);
        let motion =
            neighbors::motion_px(&here, &chosen, range) / (own.reduced() << coarsest) as f32;
        let coarse = create_matcher(&own, &pictures, coarsest, range, seed);
        coarse.sweep(&mut board, (motion as u32).clamp(16, 192));
        run_rounds(&coarse, &mut board, ROUNDS[2], true);
        if let Some((points, [low, high])) = find_surfaces(&own, coarsest, &board) {
            selected = select(&here, points);
            range = [range[0].max(low), range[1].min(high)];
        }
        Ok(Some(CoarseEstimate {
            neighbors: selected,
            range,
            board,
            seed,
        }))
    }

    /// Estimates planes of a view without the depths of other views.
    pub(super) fn estimate_alone(&mut self, view: usize) -> Result<(), DenseDepthError> {
        let own = self.view_cache.get(view)?;
        let (near, candidates) = self.find_candidates(view);
        let here = self.candidate(view);
        let most = self.max_neighbors();
        let anywhere = neighbors::sample_frustum(&here, &candidates);
        let initial = neighbors::choose(&here, &candidates, &anywhere, most);
        let select =
            |here: &Candidate, points| neighbors::choose(here, &candidates, &[points], most);
        let Some(CoarseEstimate {
            neighbors: mut selected,
            range,
            mut board,
            seed,
        }) = self.estimate_coarse(view, &near, &candidates, initial, select)?
        else {
            let planes = own.level(0).width * own.level(0).height;
            return self.store(view, Vec::new(), &vec![Hypothesis::default(); planes]);
        };
        let coarsest = own.levels() - 1;
        let pictures = self.pictures(&near, &selected)?;
        for level in (0..coarsest).rev() {
            let picture = own.level(level);
            board = board.doubled(picture.width, picture.height);
            let finer = create_matcher(&own, &pictures, level, range, seed);
            finer.evaluate(&mut board);
            run_rounds(&finer, &mut board, ROUNDS[level.min(1)], false);
        }
        selected.iter_mut().for_each(|i| *i = near[*i]);
        self.store(view, selected, &board.rows())
    }

    /// Selects the best views for a view's depth, at most `most`, by a coarse estimate from views
    /// at all distances; none if all views have the same position.
    pub(super) fn select_neighbors(
        &mut self,
        view: usize,
        most: usize,
    ) -> Result<Vec<usize>, ImagesError> {
        let (near, candidates) = self.find_candidates(view);
        let here = self.candidate(view);
        let spread = neighbors::choose_spread(&here, &candidates, self.max_neighbors());
        // Each point is a group of its own, so that the selected views cover the whole image.
        let select = |here: &Candidate, points: Vec<DVec3>| {
            let groups: Vec<Vec<DVec3>> = points.into_iter().map(|point| vec![point]).collect();
            neighbors::choose(here, &candidates, &groups, most)
        };
        let coarse = self.estimate_coarse(view, &near, &candidates, spread, select)?;
        Ok(coarse
            .map(|coarse| coarse.neighbors.iter().map(|&i| near[i]).collect())
            .unwrap_or_default())
    }
}

/// Samples up to a few hundred reliable surface points of a view, and returns them with the range
/// of inverse depths of nearly all of them, with a margin on both sides.
fn find_surfaces(
    own: &MatchView,
    level: usize,
    board: &Chequerboard,
) -> Option<(Vec<DVec3>, [f32; 2])> {
    /// Minimum number of reliable planes.
    const MIN_PLANES: usize = 50;
    /// Maximum number of sampled points.
    const MAX_POINTS: usize = 200;
    let camera = own.camera(level);
    let planes = board.rows();
    let mut good: Vec<(usize, f32)> = planes
        .iter()
        .enumerate()
        .filter(|(_, plane)| plane.inverse_depth > 0.0 && plane.cost < GOOD_COST)
        .map(|(i, plane)| (i, plane.inverse_depth))
        .collect();
    if good.len() < MIN_PLANES {
        return None;
    }
    let step = good.len().div_ceil(MAX_POINTS);
    let points = good.iter().step_by(step).map(|&(i, q)| {
        let ray = camera.ray(
            (i % board.width) as f64 + 0.5,
            (i / board.width) as f64 + 0.5,
        );
        camera.pose.to_world(ray / f64::from(q))
    });
    let points = points.collect();
    good.sort_by(|a, b| a.1.total_cmp(&b.1));
    let quantile = |share: f64| good[((good.len() - 1) as f64 * share) as usize].1;
    Some((points, [quantile(0.02) * 0.5, quantile(0.98) * 2.0]))
}
