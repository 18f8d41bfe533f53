//! A set on its way from pictures to depth, view by view and round by round.

use super::consistency::{Verdict, judge, remove_specks};
use super::hypotheses::{Chequerboard, Hypothesis};
use super::neighbors::Candidate;
use super::patch_match::{Draw, Known, MOST_OTHERS, Matcher, Other};
use super::picture::{Grey, MatchView};
use super::relative::{CameraAt, Relative};
use super::shelf::{Shelf, Spool};
use super::{DenseDepth, DenseDepthError, FoundDepth};
use crate::{ImagesError, LoadedView, Pinhole, View, backdrop};
use headbox_core::simd;
use headbox_core::statistics::median;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Rounds in a picture, from coarse to fine: far-reaching ones first.
pub(super) const ROUNDS: [&[(f32, f32)]; 3] = [
    &[(1.0, 0.3), (0.5, 0.15), (0.25, 0.08)],
    &[(1.0, 0.5), (0.5, 0.2), (0.25, 0.1)],
    &[(2.0, 1.0), (2.0, 0.7), (1.0, 0.5), (0.5, 0.3)],
];

/// How often all views are improved by what the others found, and the rounds each time.
pub(super) const TOGETHER: usize = 2;
const TOGETHER_ROUNDS: [(f32, f32); 2] = [(0.5, 0.15), (0.2, 0.05)];

/// Costs above which a plane is not believed, however many views confirm it.
const MOST_COST: f32 = 0.9;

/// Patches of fewer pixels are specks.
const SPECK: usize = 60;

/// The standard deviation of a view's inverse depths, over the median difference between two views': 1.4826 / sqrt(2) for normal errors.
const DEVIATION: f64 = 1.048;

/// Views that are asked whether there is a dark backdrop.
const BACKDROP_VIEWS: usize = 16;
/// What becomes of a set on the way.
pub(super) struct Work<'a> {
    settings: &'a DenseDepth,
    pub(super) views: &'a [&'a View],
    /// Of their colours.
    lenses: Vec<Pinhole>,
    folder: &'a Path,
    pub(super) shelf: Shelf<'a>,
    /// Of each view, which others are asked.
    asked: Vec<Vec<usize>>,
    found: Spool,
    improved: Spool,
}

impl<'a> Work<'a> {
    pub(super) fn new(
        settings: &'a DenseDepth,
        views: &'a [&'a View],
        lenses: Vec<Pinhole>,
        folder: &'a Path,
    ) -> Result<Self, DenseDepthError> {
        let step = views.len().div_ceil(BACKDROP_VIEWS);
        let some: Result<Vec<LoadedView>, ImagesError> = views
            .par_iter()
            .step_by(step)
            .map(|view| view.load())
            .collect();
        let dark = backdrop::find_threshold(&some?);
        let load = move |i: usize| {
            let view = views[i].load()?;
            let nothing = backdrop::background_mask(&view, dark);
            MatchView::new(&view, nothing, settings.longest_px, settings.coarsest_px).ok_or_else(
                || ImagesError::Picture {
                    path: views[i].color.clone(),
                    cause: "is no perspective picture".into(),
                },
            )
        };
        let planes = || {
            views.iter().map(|view| {
                let [mut width, mut height] = view.size_px;
                while width.max(height) > settings.longest_px.max(1) {
                    (width, height) = ((width / 2).max(1), (height / 2).max(1));
                }
                width as usize * height as usize
            })
        };
        let spool = || {
            Spool::new(folder, planes()).map_err(|cause| DenseDepthError::Spool {
                folder: folder.into(),
                cause,
            })
        };
        let shelf = Shelf::new(settings.budget_bytes, load);
        Ok(Self {
            settings,
            views,
            lenses,
            folder,
            shelf,
            asked: vec![Vec::new(); views.len()],
            found: spool()?,
            improved: spool()?,
        })
    }

    fn spool_error(&self, cause: std::io::Error) -> DenseDepthError {
        DenseDepthError::Spool {
            folder: self.folder.into(),
            cause,
        }
    }

    /// Keeps what was found of a view, and which others are asked about it from now on.
    pub(super) fn keep(
        &mut self,
        view: usize,
        asked: Vec<usize>,
        planes: &[Hypothesis],
    ) -> Result<(), DenseDepthError> {
        self.asked[view] = asked;
        self.found
            .write(view, planes)
            .map_err(|cause| self.spool_error(cause))
    }

    /// Other views that are asked about each.
    pub(super) fn most(&self) -> usize {
        self.settings.neighbors.clamp(1, MOST_OTHERS)
    }

    /// What is known of a view's camera without its picture.
    pub(super) fn candidate(&self, view: usize) -> Candidate {
        Candidate {
            camera: CameraAt::new(self.lenses[view], self.views[view].color_pose(), 0),
            size: self.views[view].size_px.map(f64::from),
        }
    }

    pub(super) fn pictures(
        &mut self,
        near: &[usize],
        asked: &[usize],
    ) -> Result<Vec<Arc<MatchView>>, ImagesError> {
        asked.iter().map(|&i| self.shelf.get(near[i])).collect()
    }

    /// The other views that are asked about one, with what they know.
    fn informed(&mut self, view: usize) -> Result<Informed, DenseDepthError> {
        let own = self.shelf.get(view)?;
        let mut others = Vec::new();
        for other in self.asked[view].clone() {
            let known = self
                .found
                .inverse_depths(other)
                .map_err(|cause| self.spool_error(cause))?;
            others.push((self.shelf.get(other)?, Arc::new(known)));
        }
        Ok(Informed { own, others })
    }

    /// What was improved is what was found from now on.
    pub(super) fn swap(&mut self) {
        std::mem::swap(&mut self.found, &mut self.improved);
    }

    /// Planes of a view that knows what the others found.
    pub(super) fn together(&mut self, view: usize) -> Result<(), DenseDepthError> {
        let informed = self.informed(view)?;
        let own = informed.own.level(0);
        let planes = self
            .found
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
            focal_px: informed.own.camera(0).focal_px[0] as f32,
            others: informed.others(),
            range,
            seed: headbox_core::random::hash(!(view as u64)),
            level: simd::level(),
        };
        matcher.evaluate(&mut board);
        rounds(&matcher, &mut board, &TOGETHER_ROUNDS, false);
        self.improved
            .write(view, &board.rows())
            .map_err(|cause| self.spool_error(cause))
    }

    /// What the others confirm of a view, in pixels of its picture.
    pub(super) fn confirmed(&mut self, view: usize) -> Result<FoundDepth, DenseDepthError> {
        let informed = self.informed(view)?;
        let own = informed.own.level(0);
        let mut planes = self
            .found
            .read(view)
            .map_err(|cause| self.spool_error(cause))?;
        let others = informed.others();
        let needed = self.settings.confirmations.min(others.len()).max(1);
        let verdicts: Vec<Option<Verdict>> = planes
            .par_iter()
            .enumerate()
            .map(|(i, plane)| {
                let at = [(i % own.width) as f32 + 0.5, (i / own.width) as f32 + 0.5];
                let known = plane.inverse_depth > 0.0 && plane.cost <= MOST_COST;
                known
                    .then(|| judge(&others, at, plane))
                    .filter(|verdict| verdict.confirms(needed))
            })
            .collect();
        let off = median(
            verdicts
                .iter()
                .flatten()
                .map(|verdict| f64::from(verdict.off)),
        );
        let deviation = (off.unwrap_or(0.0) * DEVIATION) as f32;
        let share = |verdict: &Option<Verdict>| {
            verdict.map_or(0.0, |v| f32::from(v.confirm) / others.len() as f32)
        };
        let confidence: Vec<f32> = verdicts.iter().map(share).collect();
        let mut kept: Vec<f32> = planes
            .iter()
            .zip(&confidence)
            .map(|(plane, c)| if *c > 0.0 { plane.inverse_depth } else { 0.0 })
            .collect();
        remove_specks(&mut kept, own.width, SPECK);
        for (plane, kept) in planes.iter_mut().zip(kept) {
            plane.inverse_depth = kept;
        }
        let mut loaded = self.views[view].load()?;
        let (depth, confidence) =
            full_size(&loaded, own, informed.own.reduced(), &planes, &confidence);
        loaded.depth = depth;
        Ok(FoundDepth {
            view: loaded,
            confidence,
            deviation,
        })
    }
}

/// A view, and the others that are asked about it with what they know.
struct Informed {
    own: Arc<MatchView>,
    others: Vec<(Arc<MatchView>, Arc<Vec<f32>>)>,
}

impl Informed {
    fn others(&self) -> Vec<Other<'_>> {
        self.others
            .iter()
            .map(|(picture, known)| other(&self.own, picture, 0, Some(Arc::clone(known))))
            .collect()
    }
}

fn other<'a>(
    own: &MatchView,
    other: &'a MatchView,
    level: usize,
    known: Option<Arc<Vec<f32>>>,
) -> Other<'a> {
    let (here, there) = (own.camera(level), other.camera(level));
    let known = known.map(|inverse_depths| Known {
        inverse_depths,
        back: Relative::new(&there, &here),
    });
    Other {
        relative: Relative::new(&here, &there),
        picture: other.level(level),
        known,
    }
}

/// At a level of a view, with others of which nothing is known.
pub(super) fn matcher_alone<'a>(
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
            .map(|picture| other(own, picture, level, None))
            .collect(),
        range,
        seed: seed ^ level as u64,
        level: simd::level(),
    }
}

pub(super) fn rounds(
    matcher: &Matcher,
    board: &mut Chequerboard,
    rounds: &[(f32, f32)],
    anywhere: bool,
) {
    for (round, &(motion_px, slope)) in rounds.iter().enumerate() {
        matcher.improve(
            board,
            Draw {
                motion_px,
                slope,
                anywhere,
                round: round as u64,
            },
        );
    }
}

/// Depth and confidence for every pixel of a view's picture, from planes of a smaller one.
fn full_size(
    view: &LoadedView,
    small: &Grey,
    reduced: u32,
    planes: &[Hypothesis],
    confidence: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    let [width, height] = view.size_px;
    let pixels = width as usize * height as usize;
    let (mut depths, mut confidences) = (vec![f32::NAN; pixels], vec![0.0; pixels]);
    for y in 0..height {
        for x in 0..width {
            let (column, row) = ((x / reduced) as usize, (y / reduced) as usize);
            if column >= small.width || row >= small.height {
                continue;
            }
            let plane = &planes[row * small.width + column];
            let at = |fine: u32, coarse: usize| {
                (fine as f32 + 0.5) / reduced as f32 - (coarse as f32 + 0.5)
            };
            let inverse_depth = plane.moved(at(x, column), at(y, row)).inverse_depth;
            if plane.inverse_depth > 0.0 && inverse_depth > 0.0 {
                let pixel = (y * width + x) as usize;
                depths[pixel] = 1.0 / inverse_depth;
                confidences[pixel] = confidence[row * small.width + column];
            }
        }
    }
    (depths, confidences)
}
