//! How a view's depth is begun: in its smallest picture, which also tells which other views serve best, and from there alone in finer ones.

use super::DenseDepthError;
use super::hypotheses::{Chequerboard, Hypothesis};
use super::neighbors::Candidate;
use super::picture::MatchView;
use super::work::{ROUNDS, Work, matcher_alone, rounds};
use crate::ImagesError;
use crate::dense_depth::neighbors;
use glam::DVec3;

/// Planes that cost no more are believed where it is asked how far away things are.
const GOOD_COST: f32 = 0.25;

/// What the smallest picture says of a view.
struct Start {
    /// Which of the views near it are asked from now on.
    asked: Vec<usize>,
    /// Between which inverse depths to look, 1/m.
    range: [f32; 2],
    board: Chequerboard,
    seed: u64,
}

impl Work<'_> {
    /// Planes of a view in its smallest picture by some of the views near it, and which of these serve best now that it is known how far away things are. `None` if
    /// nobody sees what the view sees.
    fn start(
        &mut self,
        view: usize,
        near: &[usize],
        candidates: &[Candidate],
        mut asked: Vec<usize>,
        suits: impl Fn(&Candidate, Vec<DVec3>) -> Vec<usize>,
    ) -> Result<Option<Start>, ImagesError> {
        let own = self.shelf.get(view)?;
        let here = self.candidate(view);
        let pictures = self.pictures(near, &asked)?;
        let chosen: Vec<&Candidate> = asked.iter().map(|&i| &candidates[i]).collect();
        let Some(mut range) = neighbors::range(&here, &chosen) else {
            return Ok(None);
        };
        let coarsest = own.levels() - 1;
        let seed = headbox_core::random::hash(view as u64);
        let picture = own.level(coarsest);
        let mut board = Chequerboard::new(picture.width, picture.height);
        let motion =
            neighbors::motion_px(&here, &chosen, range) / (own.reduced() << coarsest) as f32;
        let coarse = matcher_alone(&own, &pictures, coarsest, range, seed);
        coarse.sweep(&mut board, (motion as u32).clamp(16, 192));
        rounds(&coarse, &mut board, ROUNDS[2], true);
        if let Some((points, near_and_far)) = surfaces(&own, coarsest, &board) {
            asked = suits(&here, points);
            range = [range[0].max(near_and_far[0]), range[1].min(near_and_far[1])];
        }
        Ok(Some(Start {
            asked,
            range,
            board,
            seed,
        }))
    }

    /// Planes of a view that knows nothing of others' planes.
    pub(super) fn alone(&mut self, view: usize) -> Result<(), DenseDepthError> {
        let own = self.shelf.get(view)?;
        let eyes: Vec<_> = self
            .views
            .iter()
            .map(|view| view.color_pose().eye)
            .collect();
        let near = neighbors::candidates(&eyes, view);
        let candidates: Vec<Candidate> = near.iter().map(|&i| self.candidate(i)).collect();
        let here = self.candidate(view);
        let most = self.most();
        let asked = neighbors::choose(
            &here,
            &candidates,
            &neighbors::anywhere(&here, &candidates),
            most,
        );
        let suits =
            |here: &Candidate, points| neighbors::choose(here, &candidates, &[points], most);
        let Some(Start {
            mut asked,
            range,
            mut board,
            seed,
        }) = self.start(view, &near, &candidates, asked, suits)?
        else {
            let planes = own.level(0).width * own.level(0).height;
            return self.keep(view, Vec::new(), &vec![Hypothesis::default(); planes]);
        };
        let coarsest = own.levels() - 1;
        let pictures = self.pictures(&near, &asked)?;
        for level in (0..coarsest).rev() {
            let picture = own.level(level);
            board = board.doubled(picture.width, picture.height);
            let finer = matcher_alone(&own, &pictures, level, range, seed);
            finer.evaluate(&mut board);
            rounds(&finer, &mut board, ROUNDS[level.min(1)], false);
        }
        asked.iter_mut().for_each(|i| *i = near[*i]);
        self.keep(view, asked, &board.rows())
    }

    /// The views, at most `most`, from which a view's depth is found best: first some at all distances are asked, then those that suit what they say. None if all were
    /// taken from one place.
    pub(super) fn partners(&mut self, view: usize, most: usize) -> Result<Vec<usize>, ImagesError> {
        let eyes: Vec<_> = self
            .views
            .iter()
            .map(|view| view.color_pose().eye)
            .collect();
        let near = neighbors::candidates(&eyes, view);
        let candidates: Vec<Candidate> = near.iter().map(|&i| self.candidate(i)).collect();
        let spread = neighbors::spread(&self.candidate(view), &candidates, self.most());
        // Each point has a say of its own, so that all of the picture is seen by some of them.
        let suits = |here: &Candidate, points: Vec<DVec3>| {
            let alone: Vec<Vec<DVec3>> = points.into_iter().map(|point| vec![point]).collect();
            neighbors::choose(here, &candidates, &alone, most)
        };
        let start = self.start(view, &near, &candidates, spread, suits)?;
        Ok(start
            .map(|start| start.asked.iter().map(|&i| near[i]).collect())
            .unwrap_or_default())
    }
}

/// Points of the world that a view surely sees, a few hundred, and between which inverse depths nearly all of them lie, with room to both sides.
fn surfaces(own: &MatchView, level: usize, board: &Chequerboard) -> Option<(Vec<DVec3>, [f32; 2])> {
    /// The fewest that say something.
    const LEAST: usize = 50;
    /// How many are taken.
    const MOST: usize = 200;
    let camera = own.camera(level);
    let planes = board.rows();
    let mut good: Vec<(usize, f32)> = planes
        .iter()
        .enumerate()
        .filter(|(_, plane)| plane.inverse_depth > 0.0 && plane.cost < GOOD_COST)
        .map(|(i, plane)| (i, plane.inverse_depth))
        .collect();
    if good.len() < LEAST {
        return None;
    }
    let step = good.len().div_ceil(MOST);
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
