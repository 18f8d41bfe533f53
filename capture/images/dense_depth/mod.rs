//! Dense multi-view stereo: depth of photographs with known cameras (E3).
//!
//! The paper matches pairs of images along epipolar lines and links disparities over a rig's views,
//! without further detail. Here each view's pixels get planes, first by a plane sweep in a small
//! image (`coarse`), then by PatchMatch in ever finer ones (`matching`), compared by zero-mean
//! normalised cross-correlation with the most suitable views (`neighbors`). Then all views are
//! refined again with the depth of the others as a constraint (`pipeline`), and depths that too few
//! of them confirm are discarded (`consistency`). `store` keeps the result next to the images;
//! `agreement` compares it with known depth.
//!
//! The result is a function of the images and of hashes: it is equal to the bit on any number of
//! threads and at every SIMD level. Images are loaded again when needed and the planes
//! of all views lie in an unnamed temporary file (`storage`), so that memory does not grow with the
//! set.

mod agreement;
mod coarse;
mod consistency;
mod matching;
mod neighbors;
mod pipeline;
mod search_counts;
mod storage;
mod store;
#[cfg(test)]
mod tests;

pub use agreement::{Agreement, TOLERANCES};
pub use search_counts::SearchCounts;
pub(super) use store::attach;

use super::{ImageSet, ImagesError, LoadedView, Pinhole, View};
use matching::patch_match::MAX_NEIGHBORS;
use pipeline::{JOINT_PASSES, Pipeline};
use std::path::{Path, PathBuf};
use store::DepthStore;

/// Error of estimating dense depth.
#[derive(Debug, thiserror::Error)]
pub enum DenseDepthError {
    /// A view could not be read, or its depth not written.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Fewer than two perspective views.
    #[error("{0} perspective views, but depth needs at least two from different positions")]
    TooFew(usize),
    /// No pixel of any view got a depth that other views confirm.
    #[error("{0}")]
    NothingFound(SearchCounts),
    /// The temporary file failed.
    #[error("{}: cannot write a temporary file: {cause}", folder.display())]
    Spool {
        /// Folder of the temporary file.
        folder: PathBuf,
        /// Error of the operating system.
        cause: std::io::Error,
    },
}

/// Steps of one view in each pass, about in proportion to their times. The first pass, of each view
/// alone, takes 78 % of the time of views of 250 px, and about 57 % of that of 1000 px.
const ALONE_STEPS: u64 = 20;
const JOINT_STEPS: u64 = 4;
const FILTER_STEPS: u64 = 1;

/// Settings of dense stereo.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseDepth {
    /// Maximum longer side, pixels; larger images are halved.
    pub longest_px: u32,
    /// Minimum shorter side of the smallest image, pixels; the plane sweep starts at up to twice
    /// this size.
    pub coarsest_px: u32,
    /// Number of other views matched with each, at most 8.
    pub neighbors: usize,
    /// Number of views that must confirm a depth, limited to the number of neighbours.
    pub confirmations: usize,
    /// Capacity of the image cache, bytes.
    pub budget_bytes: usize,
}

impl Default for DenseDepth {
    fn default() -> Self {
        Self {
            longest_px: 1600,
            coarsest_px: 100,
            neighbors: MAX_NEIGHBORS,
            confirmations: 2,
            budget_bytes: 512 << 20,
        }
    }
}

/// Estimated depth of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedDepth {
    /// Undistorted view with the estimated eye depth, metres, NaN where unknown.
    pub view: LoadedView,
    /// Fraction of the neighbours that confirm each pixel's depth; 0 where unknown.
    pub confidence: Vec<f32>,
    /// Standard deviation of inverse depth between views, 1/m.
    pub deviation: f32,
}

impl DenseDepth {
    /// Estimates the depth of views from each other, in memory, with temporary data in an unnamed
    /// file in the system's temporary folder. `advance` receives the [`Self::steps`] as they end.
    ///
    /// # Errors
    /// See [`DenseDepthError`].
    pub fn find(
        &self,
        views: &[&View],
        advance: &dyn Fn(u64),
    ) -> Result<Vec<EstimatedDepth>, DenseDepthError> {
        let mut all = Vec::with_capacity(views.len());
        self.run(
            views,
            &std::env::temp_dir(),
            advance,
            &mut |_, estimated| {
                all.push(estimated);
                Ok(())
            },
        )?;
        Ok(all)
    }

    /// Selects the best views for the depth of view `own`, at most `most` and at most 8, by stereo
    /// on a small image; none if all views have the same position or none overlaps `own`.
    ///
    /// # Errors
    /// See [`DenseDepthError`].
    pub fn select_neighbors(
        &self,
        views: &[&View],
        own: usize,
        most: usize,
    ) -> Result<Vec<usize>, DenseDepthError> {
        let lenses = lenses(views)?;
        let folder = std::env::temp_dir();
        let mut pipeline = Pipeline::new(self, views, lenses, &folder)?;
        Ok(pipeline.select_neighbors(own, most)?)
    }

    /// Returns the number of steps of [`Self::find`] for a number of views. All steps take about
    /// the same time.
    pub fn steps(views: usize) -> u64 {
        views as u64 * (ALONE_STEPS + JOINT_PASSES as u64 * JOINT_STEPS + FILTER_STEPS)
    }

    /// Estimates the depth of views and passes each to `keep` with its index. Temporary data lies
    /// in an unnamed file in `folder`. `advance` receives the [`Self::steps`] as they end.
    ///
    /// # Errors
    /// See [`DenseDepthError`]; errors of `keep`.
    fn run(
        &self,
        views: &[&View],
        folder: &Path,
        advance: &dyn Fn(u64),
        keep: &mut dyn FnMut(usize, EstimatedDepth) -> Result<(), ImagesError>,
    ) -> Result<SearchCounts, DenseDepthError> {
        let mut pipeline = Pipeline::new(self, views, lenses(views)?, folder)?;
        for view in 0..views.len() {
            pipeline.estimate_alone(view)?;
            advance(ALONE_STEPS);
        }
        for _ in 0..JOINT_PASSES {
            for view in 0..views.len() {
                pipeline.estimate_jointly(view)?;
                advance(JOINT_STEPS);
            }
            pipeline.swap();
        }
        for view in 0..views.len() {
            let estimated = pipeline.filter(view)?;
            keep(view, estimated)?;
            advance(FILTER_STEPS);
        }
        Ok(pipeline.search_counts()?)
    }
}

/// Returns the lenses of the views' colours, which must be at least two and all perspective.
fn lenses(views: &[&View]) -> Result<Vec<Pinhole>, DenseDepthError> {
    let lenses: Vec<Pinhole> = views.iter().filter_map(|view| view.pinhole()).collect();
    if lenses.len() < 2 || lenses.len() < views.len() {
        Err(DenseDepthError::TooFew(lenses.len()))
    } else {
        Ok(lenses)
    }
}

impl ImageSet {
    /// Estimates the depth of the perspective views without measured depth, stores it next to the
    /// set's images, and uses it from then on. `on_view` receives each view with its estimate;
    /// `advance` receives the [`Self::find_depth_steps`] as they end. After an error, nothing is
    /// left in the set's folder.
    ///
    /// # Errors
    /// See [`DenseDepthError`].
    pub fn estimate_depth(
        &mut self,
        settings: &DenseDepth,
        advance: &dyn Fn(u64),
        on_view: &mut dyn FnMut(&View, &EstimatedDepth),
    ) -> Result<(), DenseDepthError> {
        let views: Vec<&View> = self
            .views
            .iter()
            .filter(|view| view.pinhole().is_some())
            .collect();
        lenses(&views)?;
        let mut store = DepthStore::create(self)?;
        let folder = store.staging_folder().to_owned();
        let counts = settings.run(&views, &folder, advance, &mut |i, estimated| {
            if !views[i].has_own_depth() {
                on_view(views[i], &estimated);
                store.add(views[i], &estimated)?;
            }
            Ok(())
        })?;
        if counts.confirmed == 0 {
            return Err(DenseDepthError::NothingFound(counts));
        }
        store.finish()?;
        for view in &mut self.views {
            view.depth = view
                .depth
                .take()
                .filter(|depth| depth.estimated_deviation.is_none());
        }
        Ok(attach(self)?)
    }

    /// Returns the number of steps of [`Self::estimate_depth`].
    pub fn find_depth_steps(&self) -> u64 {
        DenseDepth::steps(
            self.views
                .iter()
                .filter(|view| view.pinhole().is_some())
                .count(),
        )
    }
}
