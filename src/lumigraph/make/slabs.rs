//! Several light slabs of one scene, each a lumigraph with a plane of its own, shown as one (the paper's limitation 4).
//!
//! A slab serves a ray well that goes where its cameras look and crosses its plane between them. For a frame the slab that serves
//! its rays best is drawn, and the next best, in shares that depend on the camera alone and smoothly: the share of the second is nothing
//! before a third takes its place, and the two change roles at a half, so that nothing jumps as the eye moves from one to the next.

use crate::grid::PlaneView;
use crate::{Lumigraph, LumigraphError, LumigraphInfo, optimal_disparity};
use headbox_core::camera::Camera;
use glam::DVec2;

#[cfg(test)]
mod tests;

/// Slabs at most: a hundred planes about an object are more than any needs.
pub const MAX_SLABS: usize = 256;

/// How much worse than the best slab one may serve a frame and still be seen in it, radians: planes turned about a place hand over within some
/// seven degrees to either side of the middle.
const REACH: f64 = 0.5;

/// Where rays are asked that stand for a frame's, in shares of its width and height.
const PROBES: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// Light slabs of one scene, at least one.
#[derive(Clone, Debug)]
pub struct Slabs {
    slabs: Vec<Lumigraph>,
}

/// A slab that a frame shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlabShare {
    /// Its number.
    pub slab: usize,
    /// Its share of the frame; those of a frame add up to 1.
    pub share: f64,
}

impl From<Lumigraph> for Slabs {
    fn from(lumigraph: Lumigraph) -> Self {
        Self { slabs: vec![lumigraph] }
    }
}

impl Slabs {
    /// Slabs of one scene; the first one's environment and info are those of all.
    ///
    /// # Errors
    /// [`LumigraphError::Slabs`] if there are none or too many.
    pub fn new(mut slabs: Vec<Lumigraph>) -> Result<Self, LumigraphError> {
        if slabs.is_empty() || slabs.len() > MAX_SLABS {
            return Err(LumigraphError::Slabs(slabs.len()));
        }
        let (info, environment) = (slabs[0].info.clone(), slabs[0].environment.clone());
        for slab in &mut slabs[1..] {
            (slab.info, slab.environment) = (info.clone(), environment.clone());
        }
        Ok(Self { slabs })
    }

    /// All of them.
    pub fn all(&self) -> &[Lumigraph] {
        &self.slabs
    }

    /// The first.
    pub fn first(&self) -> &Lumigraph {
        &self.slabs[0]
    }

    /// The only one, if there are no others.
    pub fn into_single(self) -> Option<Lumigraph> {
        <[Lumigraph; 1]>::try_from(self.slabs).ok().map(|[slab]| slab)
    }

    /// Where they come from.
    pub fn info(&self) -> &LumigraphInfo {
        &self.first().info
    }

    /// Which slabs a frame shows: the best first, and at most one more.
    pub fn shares(&self, camera: &Camera) -> Vec<SlabShare> {
        let mut order: Vec<(usize, f64)> = self.slabs.iter().map(|slab| unfit(slab, camera)).enumerate().collect();
        order.sort_by(|(_, a), (_, b)| a.total_cmp(b));
        let [(best, least), ref others @ ..] = order[..] else { return Vec::new() };
        let limit = others.get(1).map_or(least + REACH, |(_, third)| third.min(least + REACH));
        let second = others.first().filter(|(_, unfit)| *unfit < limit);
        let Some(&(second, unfit)) = second else { return vec![SlabShare { slab: best, share: 1.0 }] };
        let share = 0.5 * smooth((limit - unfit) / (limit - least));
        vec![SlabShare { slab: best, share: 1.0 - share }, SlabShare { slab: second, share }]
    }
}

/// From 0 at 0 to 1 at 1, with no slope at either.
fn smooth(x: f64) -> f64 {
    x * x * (3.0 - 2.0 * x)
}

/// How badly a slab serves a frame, radians: the mean over some rays of how far they turn from where its cameras look and of how far beside its
/// cameras they cross its plane, as seen from the middle of its disparities (up to one). A continuous function of the camera.
fn unfit(slab: &Lumigraph, camera: &Camera) -> f64 {
    let grid = slab.grid();
    let view = PlaneView::new(grid, camera);
    let [width, height] = view.size();
    let ends = |places: &[f64]| [places[0], places[places.len() - 1]];
    let (columns, rows) = (ends(grid.columns()), ends(grid.rows()));
    let disparity = slab.range().map_or(0.0, optimal_disparity);
    let of_ray = |share: [f64; 2]| {
        let at = [width * share[0], height * share[1]];
        let direction = view.start + view.step[0] * at[0] + view.step[1] * at[1];
        let turned = (direction.z / direction.length()).clamp(-1.0, 1.0).acos();
        let Some(slopes) = view.slopes(at) else { return turned + 1.0 };
        let crossing = view.crossing(slopes);
        let beside = |at: f64, [low, high]: [f64; 2]| (low - at).max(at - high).max(0.0);
        let off = DVec2::new(beside(crossing.x, columns), beside(crossing.y, rows)).length();
        turned + (off * disparity).min(1.0)
    };
    let rays = PROBES.into_iter().flat_map(|x| PROBES.map(|y| [x, y]));
    rays.map(of_ray).sum::<f64>() / (PROBES.len() * PROBES.len()) as f64
}
