//! Views of a frame (two eyes, two sets of settings) and their places on the screen.

use crate::input::pose::Pose;
use glam::DVec3;
use headbox_core::camera::{Camera, CameraError};

/// Stereo mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stereo {
    /// One eye.
    #[default]
    Off,
    /// Side by side, the right eye's view on the left: crossed eyes fuse it (as in the papers'
    /// figures).
    CrossEyed,
    /// Side by side, the left eye's view on the left: for a lens stereoscope or parallel viewing.
    Parallel,
}

impl Stereo {
    /// All modes, in the order of the key that switches.
    pub const ALL: [Self; 3] = [Self::Off, Self::CrossEyed, Self::Parallel];

    /// Label of the mode.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "Off",
            Self::CrossEyed => "Cross-eyed",
            Self::Parallel => "Parallel",
        }
    }

    /// Next mode, cyclically.
    #[must_use]
    pub fn next(self) -> Self {
        Self::ALL[(self as usize + 1) % Self::ALL.len()]
    }

    /// Number of views side by side on the screen.
    pub fn places(self) -> u32 {
        if self == Self::Off { 1 } else { 2 }
    }

    /// Positions of the eyes from left to right on the screen. The eyes are `separation` metres
    /// apart about the pose's eye, on its right axis, and look in parallel (a point at infinity has
    /// no disparity).
    pub fn eyes(self, pose: &Pose, separation: f64) -> Vec<DVec3> {
        let half = pose.world_from_eye().x_axis * (separation / 2.0);
        match self {
            Self::Off => vec![pose.eye],
            Self::CrossEyed => vec![pose.eye + half, pose.eye - half],
            Self::Parallel => vec![pose.eye - half, pose.eye + half],
        }
    }

    /// Cameras from left to right on the screen, for a frame of `width` x `height` pixels in total.
    ///
    /// # Errors
    /// [`CameraError`] if the image size cannot be rendered.
    pub fn cameras(
        self,
        pose: &Pose,
        separation: f64,
        width: u32,
        height: u32,
    ) -> Result<Vec<Camera>, CameraError> {
        let eyes = self.eyes(pose, separation).into_iter();
        eyes.map(|eye| Pose { eye, ..*pose }.camera((width / self.places()).max(1), height))
            .collect()
    }
}

/// One rendered image, row 0 on top.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PictureRef<'a> {
    /// Width in pixels.
    pub width: usize,
    pub pixels: &'a [[u8; 4]],
}

/// Assembles the pictures of one frame as the screen shows them. `pictures` holds for each place
/// from left to right one picture per setting set (A, or A and B), all of one size; `divider` is
/// the share of each place's width that shows A. Returns width and pixels, row 0 on top.
pub(crate) fn compose(
    pictures: &[PictureRef<'_>],
    places: usize,
    divider: f64,
) -> (usize, Vec<[u8; 4]>) {
    let sets = pictures.len() / places.max(1);
    let (Some(first), true) = (pictures.first(), sets > 0) else {
        return (0, Vec::new());
    };
    let width = first.width;
    let height = first.pixels.len().checked_div(width).unwrap_or(0);
    let split = if sets > 1 {
        divider_column(divider, width)
    } else {
        width
    };
    let mut out = Vec::with_capacity(places * width * height);
    for row in 0..height {
        for place in pictures.chunks_exact(sets).take(places) {
            let start = row * width;
            out.extend_from_slice(&place[0].pixels[start..start + split]);
            out.extend_from_slice(&place[sets - 1].pixels[start + split..start + width]);
        }
    }
    (places * width, out)
}

/// Index of the first column that shows B.
pub(crate) fn divider_column(divider: f64, width: usize) -> usize {
    ((divider.clamp(0.0, 1.0) * width as f64).round() as usize).min(width)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn eyes_sit_apart_on_the_right_axis() {
        let pose = Pose::looking_at(dvec3(1.0, 0.0, 0.0), dvec3(1.0, 0.0, -1.0), 60.0);
        let eyes = |stereo: Stereo| stereo.eyes(&pose, 0.064);
        assert_eq!(eyes(Stereo::Off), [pose.eye]);
        assert_eq!(
            eyes(Stereo::Parallel),
            [dvec3(0.968, 0.0, 0.0), dvec3(1.032, 0.0, 0.0)]
        );
        assert_eq!(
            eyes(Stereo::CrossEyed),
            [dvec3(1.032, 0.0, 0.0), dvec3(0.968, 0.0, 0.0)]
        );
    }

    #[test]
    fn a_near_point_moves_right_in_the_left_eye() {
        let pose = Pose::looking_at(DVec3::ZERO, DVec3::NEG_Z, 60.0);
        let cameras = Stereo::Parallel.cameras(&pose, 0.064, 800, 300).unwrap();
        assert_eq!((cameras[0].width(), cameras[0].height()), (400, 300));
        let x = |i: usize| cameras[i].project(dvec3(0.0, 0.0, -1.0)).unwrap()[0];
        assert!(x(0) > x(1), "crossed disparity");
    }

    #[test]
    fn composing_splits_and_joins() {
        let picture = |value: u8| vec![[value; 4]; 4 * 2];
        let pictures = [picture(1), picture(2), picture(3), picture(4)];
        let refs: Vec<_> = pictures
            .iter()
            .map(|pixels| PictureRef { width: 4, pixels })
            .collect();
        let row = |(width, pixels): (usize, Vec<[u8; 4]>)| {
            assert_eq!(pixels.len(), width * 2);
            pixels[width..].iter().map(|p| p[0]).collect::<Vec<_>>()
        };
        assert_eq!(row(compose(&refs, 2, 0.25)), [1, 2, 2, 2, 3, 4, 4, 4]);
        assert_eq!(row(compose(&refs[..2], 2, 0.25)), [1, 1, 1, 1, 2, 2, 2, 2]);
        assert_eq!(row(compose(&refs[..2], 1, 0.5)), [1, 1, 2, 2]);
        assert_eq!(row(compose(&refs[..1], 1, 0.5)), [1, 1, 1, 1]);
        assert_eq!(compose(&[], 1, 0.5).0, 0);
    }
}
