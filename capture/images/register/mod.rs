//! Registration of colour with depth (S12): pose, lens and exposure of a sensor's colour camera.
//!
//! Raw RGB-D frames contain two images of two cameras: the colour camera has another focal length
//! than the depth camera, stands next to it and opens its shutter at another moment, and its
//! exposure and white balance adapt to the scene. Files contain little of this, but it follows from
//! the images: a point of the depth image has the same colour in the colour images of two frames.
//! [`ImageSet::register`] minimises the difference over many pairs of frames ([`photometric`]) and
//! keeps the result only if points excluded from the estimate agree better; of a large set, a
//! subset is estimated first ([`estimate`]). [`View::load`] then reprojects the depth into the
//! colour image ([`reproject`]).

mod calibration;
mod estimate;
mod exposure;
mod photometric;
mod reproject;
mod solve;
mod subset;
#[cfg(test)]
mod tests;
mod view_samples;

pub(super) use subset::rank_others;

use super::{ImageSet, ImagesError, Lens, LoadedView, Pinhole, Pose, View};

/// Colour camera of a view, if it is not the camera of its depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// Lens.
    pub lens: Pinhole,
    /// Pose, world metres.
    pub pose: Pose,
    /// Exposure of the view relative to the set.
    pub exposure: Exposure,
}

/// Exposure of a view relative to its set: automatic exposure and white balance scale the levels of
/// a channel, stray light in the lens raises them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Factor on the levels of each channel.
    pub gain: [f32; 3],
    /// Levels, 0..255, added to them.
    pub offset: [f32; 3],
}

impl Exposure {
    /// Exposure of all views of an evenly exposed set.
    pub const EVEN: Self = Self {
        gain: [1.0; 3],
        offset: [0.0; 3],
    };

    /// Converts a level of the set to this exposure.
    pub fn expose(&self, channel: usize, level: f32) -> u8 {
        (level * self.gain[channel] + self.offset[channel] + 0.5).clamp(0.0, 255.0) as u8
    }

    /// Converts a level of this exposure to that of the set.
    pub fn even_out(&self, channel: usize, level: f32) -> u8 {
        ((level - self.offset[channel]) / self.gain[channel] + 0.5).clamp(0.0, 255.0) as u8
    }
}

/// Result of registering a set.
#[derive(Clone, Debug, PartialEq)]
pub struct RegistrationReport {
    /// Mean difference of levels (0..=255) between frames at validation points: as given, with one
    /// shared offset for all frames, and with a pose for each frame.
    pub levels: [f64; 3],
    /// The applied model.
    pub applied: RegistrationModel,
    /// Focal length of the set's file and the estimated one, pixels.
    pub focal_px: [f64; 2],
    /// Offset of colour cameras from depth cameras: mean angle, degrees, and mean distance,
    /// metres.
    pub offset: [f64; 2],
    /// Smallest and largest exposure of a view, relative to the mean.
    pub gain: [f32; 2],
    /// Number of views from which the model was chosen.
    pub sampled_views: usize,
    /// Number of views to which the model applies.
    pub views: usize,
}

/// Progress of a registration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegistrationStep {
    /// Loading of this number of views starts.
    LoadingStarted(usize),
    /// A view was loaded.
    ViewLoaded,
}

/// Model of the colour cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegistrationModel {
    /// Lens and poses of the set's file.
    AsGiven,
    /// One lens and one offset from the depth camera for all views.
    SharedOffset,
    /// One lens, and a pose for each view.
    PerView,
}

impl ImageSet {
    /// Estimates registration and exposure and applies them to the views; `on_step` reports
    /// progress. Returns `None` for sets without overlapping pinhole views with depth, or whose
    /// views are already registered.
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded.
    pub fn register(
        &mut self,
        on_step: &(dyn Fn(RegistrationStep) + Sync),
    ) -> Result<Option<RegistrationReport>, ImagesError> {
        let Some((report, registrations)) = estimate::estimate(self, estimate::GROUPS, on_step)?
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
    /// Returns the pose of the colour camera, world metres.
    pub fn color_pose(&self) -> Pose {
        self.registration
            .map_or(self.pose, |registration| registration.pose)
    }
}

impl Registration {
    /// Reprojects the depth of an undistorted view into its colour image, undistorts the colours
    /// with the estimated lens, and equalises their exposure.
    pub(super) fn apply(&self, mut view: LoadedView) -> LoadedView {
        if self.exposure != Exposure::EVEN {
            for pixel in &mut view.color {
                for (channel, level) in pixel[..3].iter_mut().enumerate() {
                    *level = self.exposure.even_out(channel, f32::from(*level));
                }
            }
        }
        let lens = Lens::Pinhole(self.lens);
        if lens == view.lens && self.pose == view.pose {
            return view;
        }
        let depth = reproject::reproject_depth(&view, lens.ideal(), &self.pose);
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
