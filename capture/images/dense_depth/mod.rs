//! Dense depth of photographs with known cameras, from the photographs alone (E3).
//!
//! The paper matches pairs of pictures along epipolar lines, links disparities over a rig's views, and says no more of how. Here each
//! view's pixels get planes (`hypotheses`), first by a plane sweep in a small picture, then by PatchMatch in ever finer ones
//! (`patch_match`), compared by zero-mean normalised cross-correlation (`zncc`) with the views that serve best (`neighbors`). Then
//! all views are improved again, each knowing what the others found, and what too few of them confirm is left undefined (`consistency`).
//!
//! Every number is a function of the pictures and of hashes: neither threads nor SIMD levels change a bit. Pictures are read again as they are
//! needed, planes of all views lie in a file without a name, so that memory does not grow with the set.

mod agreement;
mod consistency;
mod hypotheses;
mod neighbors;
mod patch_match;
mod picture;
mod relative;
mod shelf;
mod start;
mod store;
#[cfg(test)]
mod tests;
mod work;
mod zncc;

pub use agreement::{Agreement, TOLERANCES};
pub(super) use store::attach;

use super::{ImageSet, ImagesError, LoadedView, Pinhole, View};
use patch_match::MOST_OTHERS;
use std::path::{Path, PathBuf};
use store::DepthStore;
use work::{TOGETHER, Work};

/// Why there is no dense depth.
#[derive(Debug, thiserror::Error)]
pub enum DenseDepthError {
    /// A view could not be read, or its depth not written.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Depth follows from what moves between views.
    #[error(
        "{0} perspective views: at least two, from different places, are needed to find depth from"
    )]
    TooFew(usize),
    /// No room for what is found on the way.
    #[error("{}: what is found on the way cannot be kept there: {cause}", folder.display())]
    Spool {
        /// Where it was to be kept.
        folder: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
}

/// How dense depth is found.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseDepth {
    /// Pictures are halved until their longer side has no more pixels than this.
    pub longest_px: u32,
    /// A plane sweep begins in pictures whose shorter side has at least so many pixels and less than twice as many.
    pub coarsest_px: u32,
    /// Other views that are asked about each, at most 8.
    pub neighbors: usize,
    /// Views that must confirm a depth; fewer where a view has fewer neighbours.
    pub confirmations: usize,
    /// Bytes of pictures that are kept in memory.
    pub budget_bytes: usize,
}

impl Default for DenseDepth {
    fn default() -> Self {
        Self {
            longest_px: 1600,
            coarsest_px: 100,
            neighbors: MOST_OTHERS,
            confirmations: 2,
            budget_bytes: 512 << 20,
        }
    }
}

/// What was found of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundDepth {
    /// The view, its lens ideal, its depth what was found: eye depth, metres, NaN where unknown.
    pub view: LoadedView,
    /// For each pixel the share of the views asked that confirm its depth; 0 where unknown.
    pub confidence: Vec<f32>,
    /// Standard deviation of inverse depth between views, 1/m.
    pub deviation: f32,
}
impl DenseDepth {
    /// Finds the depth of some views from each other, and keeps it in memory. What is found on the way lies in a file without a name in the system's
    /// folder for such. `advance` is told of each of [`Self::steps`].
    ///
    /// # Errors
    /// See [`DenseDepthError`].
    pub fn find(
        &self,
        views: &[&View],
        advance: &dyn Fn(),
    ) -> Result<Vec<FoundDepth>, DenseDepthError> {
        let mut all = Vec::with_capacity(views.len());
        self.run(views, &std::env::temp_dir(), advance, &mut |_, found| {
            all.push(found);
            Ok(())
        })?;
        Ok(all)
    }

    /// The views, at most `most` of 8, from which the depth of one of them is found best, as far as a small picture tells; none if all were taken from one place, or nobody
    /// sees what that one sees.
    ///
    /// # Errors
    /// See [`DenseDepthError`].
    pub fn partners(
        &self,
        views: &[&View],
        own: usize,
        most: usize,
    ) -> Result<Vec<usize>, DenseDepthError> {
        let lenses = lenses(views)?;
        Ok(Work::new(self, views, lenses, &std::env::temp_dir())?.partners(own, most)?)
    }

    /// Steps of [`Self::find`] for so many views.
    pub fn steps(views: usize) -> u64 {
        views as u64 * (TOGETHER as u64 + 2)
    }

    /// Finds the depth of views, and hands each to `keep` with its number. What is found on the way lies in a file without a name
    /// in `folder`. `advance` is told of every step.
    ///
    /// # Errors
    /// See [`DenseDepthError`]; what `keep` reports.
    fn run(
        &self,
        views: &[&View],
        folder: &Path,
        advance: &dyn Fn(),
        keep: &mut dyn FnMut(usize, FoundDepth) -> Result<(), ImagesError>,
    ) -> Result<(), DenseDepthError> {
        let mut work = Work::new(self, views, lenses(views)?, folder)?;
        for view in 0..views.len() {
            work.alone(view)?;
            advance();
        }
        for _ in 0..TOGETHER {
            for view in 0..views.len() {
                work.together(view)?;
                advance();
            }
            work.swap();
        }
        for view in 0..views.len() {
            let found = work.confirmed(view)?;
            keep(view, found)?;
            advance();
        }
        Ok(())
    }
}

/// Of the views' colours; all must be perspective, and two at least.
fn lenses(views: &[&View]) -> Result<Vec<Pinhole>, DenseDepthError> {
    let lenses: Vec<Pinhole> = views.iter().filter_map(|view| view.pinhole()).collect();
    if lenses.len() < 2 || lenses.len() < views.len() {
        Err(DenseDepthError::TooFew(lenses.len()))
    } else {
        Ok(lenses)
    }
}

impl ImageSet {
    /// Finds the depth of the perspective views that have none but such, writes it beside the set's pictures, and has it from then on. `look` is
    /// shown each view and what was found of it; `advance` is told of each of [`Self::find_depth_steps`].
    ///
    /// # Errors
    /// See [`DenseDepthError`].
    pub fn find_depth(
        &mut self,
        how: &DenseDepth,
        advance: &dyn Fn(),
        look: &mut dyn FnMut(&View, &FoundDepth),
    ) -> Result<(), DenseDepthError> {
        let mut store = DepthStore::beside(self)?;
        let views: Vec<&View> = self
            .views
            .iter()
            .filter(|view| view.pinhole().is_some())
            .collect();
        let folder = store.folder().to_path_buf();
        how.run(&views, &folder, advance, &mut |i, found| {
            if !views[i].has_own_depth() {
                look(views[i], &found);
                store.add(views[i], &found)?;
            }
            Ok(())
        })?;
        store.finish()?;
        for view in &mut self.views {
            view.depth = view.depth.take().filter(|depth| depth.estimated_deviation.is_none());
        }
        Ok(attach(self)?)
    }

    /// Steps of [`Self::find_depth`].
    pub fn find_depth_steps(&self) -> u64 {
        DenseDepth::steps(
            self.views
                .iter()
                .filter(|view| view.pinhole().is_some())
                .count(),
        )
    }
}
