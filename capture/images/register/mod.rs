//! Colour registered with depth (S12): where a sensor's colour camera was, what lens it has, how it exposed.
//!
//! Raw RGB-D frames hold two pictures of two cameras: colour has another focal length than depth, stands beside it, opens its
//! shutter at another moment, and its exposure and white balance follow what it sees. Files say little of this. All of it follows from the
//! pictures: a point of the depth image, seen by the colour cameras of two frames, has one colour. [`ImageSet::register`] minimises
//! the difference over many pairs of frames ([`photometric`]), and keeps what it found only if points that it did not use
//! agree better for it; of a large set a part is asked first ([`estimate`]). [`View::load`] then brings the depth into the colour picture ([`reproject`]).

mod estimate;
mod evidence;
mod exposure;
mod part;
mod photometric;
mod reproject;
mod solve;
mod state;
#[cfg(test)]
mod tests;

pub(super) use part::apart;

use super::{ImageSet, ImagesError, Lens, LoadedView, Pinhole, Pose, View};

/// The camera that took a view's colours, where that is not the camera of its depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// Its lens.
    pub lens: Pinhole,
    /// Where it was, world metres.
    pub pose: Pose,
    /// How much brighter its levels are than the set's, a channel.
    pub gain: [f32; 3],
}

/// What was found of a set's colour cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct RegistrationReport {
    /// Mean difference of levels (of 255) between frames, at points that were not used to estimate: as the set says, with one lens and place
    /// for all frames, and with a place for each.
    pub levels: [f64; 3],
    /// What is applied.
    pub kept: Kept,
    /// The focal length that the set says, and the one found, pixels.
    pub focal_px: [f64; 2],
    /// How far colour cameras are from depth cameras: mean angle, degrees, and mean distance, metres.
    pub moved: [f64; 2],
    /// The least and the largest exposure of a view, over the mean.
    pub gain: [f32; 2],
    /// How many views were judged by.
    pub judged: usize,
    /// How many views these speak for.
    pub views: usize,
}

/// How far registration is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegistrationStep {
    /// So many views are to be loaded now.
    Begins(usize),
    /// Another one was.
    Loaded,
}

/// Which of the estimates is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// Colour and depth are registered as the set says.
    AsGiven,
    /// One lens and one place beside the depth camera.
    OneForAll,
    /// One lens, and a place for each view.
    EachView,
}

impl ImageSet {
    /// Estimates registration and exposure, and applies them to the views; `look` is told how far that is. `None` for sets without
    /// overlapping pinhole views with depth, or whose views are registered already.
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded.
    pub fn register(
        &mut self,
        look: &(dyn Fn(RegistrationStep) + Sync),
    ) -> Result<Option<RegistrationReport>, ImagesError> {
        let Some((report, registrations)) = estimate::estimate(self, estimate::GROUPS, look)?
        else {
            return Ok(None);
        };
        for (view, registration) in self.views.iter_mut().zip(registrations) {
            view.registration = registration;
        }
        Ok(Some(report))
    }
}

impl View {
    /// Where its colours were taken from, world metres.
    pub fn color_pose(&self) -> Pose {
        self.registration
            .map_or(self.pose, |registration| registration.pose)
    }
}

impl Registration {
    /// Brings the depth of a view, its lens ideal, into its colour picture, takes the distortion that was found from the colours, and
    /// evens out their exposure.
    pub(super) fn apply(&self, mut view: LoadedView) -> LoadedView {
        if self.gain != [1.0; 3] {
            for pixel in &mut view.color {
                for (level, gain) in pixel.iter_mut().zip(self.gain) {
                    *level = (f32::from(*level) / gain + 0.5).min(255.0) as u8;
                }
            }
        }
        let lens = Lens::Pinhole(self.lens);
        if lens == view.lens && self.pose == view.pose {
            return view;
        }
        let depth = reproject::depth(&view, lens.ideal(), &self.pose);
        let color = LoadedView {
            lens,
            pose: self.pose,
            depth: Vec::new(),
            ..view
        }
        .undistorted();
        LoadedView { depth, ..color }
    }
}
