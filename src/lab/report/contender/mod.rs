//! Contenders of a report: anything that turns a camera into an image.
//!
//! A representation in the registry of views is included automatically ([`ViewDraw`]). To compare
//! more than its variants, implement [`Draw`] and push a [`Contender`] in `contender_list`.

mod baked;
pub(super) mod contender_list;
mod cube_list;
mod ldi;
mod lumigraph;
mod points;
mod raster;
mod sprite_list;
mod sprites;
mod traced;
mod view;
pub(super) mod wall;
mod warp_only;

pub use baked::{BakedLight, BakedRays};
pub use ldi::{ExactDraw, FragmentDraw, LdiDraw, OracleDraw};
pub use lumigraph::LumigraphDraw;
pub use points::PointCloud;
pub use raster::RasterDraw;
pub use sprites::SpriteDraw;
pub use traced::{CubeMapDraw, PathTraced};
pub use view::{SharedView, ViewDraw};
pub use warp_only::{WarpArithmetic, WarpOnly};

use crate::plan::EyeSet;
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};
use headbox_trace::bvh::Hit;
use image::RgbImage;
use rayon::ThreadPool;
use std::sync::Arc;

/// Origin of a pixel's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelOrigin {
    /// Geometry, at least in part.
    Surface,
    /// Environment only.
    Environment,
    /// Hole.
    Hole,
}

impl PixelOrigin {
    /// Classifies the hit of a ray; a ray without a hit shows the environment.
    fn from_hit(hit: &Option<Hit>) -> Self {
        if hit.is_some() {
            Self::Surface
        } else {
            Self::Environment
        }
    }
}

/// A frame of a contender, to be compared with truth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ContenderFrame {
    /// Colours, sRGB.
    pub color: RgbImage,
    /// Origin of each pixel, row-major; empty if the renderer does not report it.
    pub origins: Vec<PixelOrigin>,
}

impl ContenderFrame {
    /// Converts a frame of one of our renderers.
    pub fn from_frame(frame: &Frame) -> Self {
        let origins = frame.coverage.iter().map(|coverage| {
            if coverage.splat_share() > 0 {
                PixelOrigin::Surface
            } else if coverage.is_hole() {
                PixelOrigin::Hole
            } else {
                PixelOrigin::Environment
            }
        });
        Self {
            origins: origins.collect(),
            color: frame.to_rgb().unwrap_or_default(),
        }
    }

    /// Returns the share of pixels that are holes, or show the environment where truth shows only
    /// geometry; `None` if the renderer does not report origins. `truth`: coverages of truth.
    pub fn hole_fraction(&self, truth: &[Coverage]) -> Option<f64> {
        let is_hole = |(origin, truth): &(&PixelOrigin, &Coverage)| match origin {
            PixelOrigin::Surface => false,
            PixelOrigin::Environment => **truth == Coverage::FULL,
            PixelOrigin::Hole => true,
        };
        let holes = self.origins.iter().zip(truth).filter(is_hole).count();
        (!self.origins.is_empty()).then(|| holes as f64 / self.origins.len() as f64)
    }
}

/// Renderer of a contender.
pub trait Draw {
    /// Draws the view of `camera`. Only this is timed.
    fn draw(&mut self, camera: &Camera);

    /// Returns the number of depth pixels that a frame processes, 0 without depth pixels. Each
    /// counts once, though it may be warped in several overlapping bands. Not timed.
    fn depth_pixels(&mut self, _camera: &Camera) -> u64 {
        0
    }

    /// Returns the frame that [`Self::draw`] draws. Not timed.
    fn picture(&mut self, camera: &Camera) -> ContenderFrame;
}

/// A renderer with its settings, and facts for its rows that need no measurement.
pub struct Contender {
    /// Roles in the groups that it belongs to: one measurement may serve several groups.
    pub roles: Vec<Role>,
    /// Eyes at which it is measured.
    pub eyes: EyeSet,
    /// True if it traces the scene itself: truth need not be more exact than it.
    pub traces: bool,
    /// Thread pool in which it draws.
    pub pool: Arc<ThreadPool>,
    /// Memory that drawing needs, bytes.
    pub bytes: u64,
    /// Total number of depth pixels, or 0.
    pub depth_pixels: u64,
    /// Capture time, seconds.
    pub capture_s: Option<f64>,
    /// Number of rays traced by the capture.
    pub rays: Option<u64>,
    /// The renderer.
    pub draw: Box<dyn Draw + Send>,
}

/// Role of a contender in a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Role {
    /// Name of the group.
    pub group: &'static str,
    /// Name of the setting.
    pub variant: String,
    /// True for the baseline of the group.
    pub baseline: bool,
}

impl Role {
    /// Creates a role.
    pub fn new(group: &'static str, variant: impl Into<String>, baseline: bool) -> Self {
        Self {
            group,
            variant: variant.into(),
            baseline,
        }
    }

    /// Creates the role that the others of the group are compared with.
    pub fn baseline(group: &'static str, variant: impl Into<String>) -> Self {
        Self::new(group, variant, true)
    }

    /// Creates a role that is compared with the baseline.
    pub fn other(group: &'static str, variant: impl Into<String>) -> Self {
        Self::new(group, variant, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_include_environment_over_geometry() {
        let color = RgbImage::new(2, 2);
        let origins = vec![
            PixelOrigin::Surface,
            PixelOrigin::Environment,
            PixelOrigin::Environment,
            PixelOrigin::Hole,
        ];
        let mut frame = ContenderFrame { color, origins };
        assert_eq!(
            frame.hole_fraction(&[
                Coverage::FULL,
                Coverage::FULL,
                Coverage::from_splat_share(254),
                Coverage::ENVIRONMENT
            ]),
            Some(0.5)
        );
        frame.origins.clear();
        assert_eq!(frame.hole_fraction(&[Coverage::FULL; 4]), None);
    }
}
