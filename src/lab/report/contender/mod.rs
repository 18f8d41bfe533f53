//! Contenders of a report: anything that turns a camera into an image.
//!
//! A representation in the registry of views takes part by itself ([`ViewDraw`]). For a comparison
//! of more than its variants, implement [`Draw`] and push a [`Contender`] in `report::field`.

mod baked;
mod ldi;
mod lumigraph;
mod points;
mod raster;
mod sprites;
mod traced;
mod view;
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
use image::RgbImage;
use rayon::ThreadPool;
use std::sync::Arc;

/// Origin of a pixel's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelOrigin {
    /// Geometry, at least in part.
    Surface,
    /// The far surroundings alone.
    Environment,
    /// Nothing is known of the pixel.
    Nothing,
}

/// A frame as it is judged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JudgedFrame {
    /// Its colours.
    pub color: RgbImage,
    /// Origin of each pixel, row-major; empty if the renderer does not report it.
    pub shown: Vec<PixelOrigin>,
}

impl JudgedFrame {
    /// A frame of the LDI renderer.
    pub fn of_frame(frame: &Frame) -> Self {
        let shown = frame.coverage.iter().map(|coverage| {
            if coverage.splat_share() > 0 {
                PixelOrigin::Surface
            } else if coverage.is_hole() {
                PixelOrigin::Nothing
            } else {
                PixelOrigin::Environment
            }
        });
        let pixel = |x: u32, y: u32| {
            let [r, g, b, _] = frame.color[y as usize * frame.width as usize + x as usize];
            image::Rgb([r, g, b])
        };
        Self {
            shown: shown.collect(),
            color: RgbImage::from_fn(frame.width, frame.height, pixel),
        }
    }

    /// Share of pixels that show nothing, or the environment where truth shows geometry alone.
    /// `truth`: its coverages. `None` if the renderer does not tell.
    pub fn hole_fraction(&self, truth: &[Coverage]) -> Option<f64> {
        let is_hole = |(shown, truth): &(&PixelOrigin, &Coverage)| match shown {
            PixelOrigin::Surface => false,
            PixelOrigin::Environment => **truth == Coverage::FULL,
            PixelOrigin::Nothing => true,
        };
        let holes = self.shown.iter().zip(truth).filter(is_hole).count();
        (!self.shown.is_empty()).then(|| holes as f64 / self.shown.len() as f64)
    }
}

/// Turns cameras into pictures.
pub trait Draw {
    /// Draws what `camera` sees: the work that is timed, and nothing else.
    fn draw(&mut self, camera: &Camera);

    /// Depth pixels that a frame has to look at, each counted once however often it is warped:
    /// bands of a frame overlap. 0 if there are no such things. Not timed.
    fn depth_pixels(&mut self, _camera: &Camera) -> u64 {
        0
    }

    /// Returns the image that [`Self::draw`] draws. Not timed.
    fn picture(&mut self, camera: &Camera) -> JudgedFrame;
}

/// One row to be: a renderer with its setting, and what is known of it beforehand.
pub struct Contender {
    /// Group, name in the group, and whether it is the group's baseline; one measurement may serve
    /// several groups.
    pub roles: Vec<Role>,
    /// Eyes at which it is judged.
    pub eyes: EyeSet,
    /// True if it traces the scene itself: truth need not be better than it.
    pub traces: bool,
    /// Thread pool in which it draws.
    pub pool: Arc<ThreadPool>,
    /// Bytes in memory that drawing needs.
    pub bytes: u64,
    /// Depth pixels in all, or 0.
    pub depth_pixels: u64,
    /// Seconds to make it.
    pub capture_s: Option<f64>,
    /// Rays traced to make it.
    pub rays: Option<u64>,
    /// The renderer.
    pub draw: Box<dyn Draw + Send>,
}

/// Role of a contender in a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Role {
    /// The group.
    pub group: &'static str,
    /// The setting's name.
    pub variant: String,
    /// True for the baseline of the group.
    pub baseline: bool,
}

impl Role {
    /// The row that others are compared with.
    pub fn baseline(group: &'static str, variant: impl Into<String>) -> Self {
        Self {
            group,
            variant: variant.into(),
            baseline: true,
        }
    }

    /// Another row.
    pub fn other(group: &'static str, variant: impl Into<String>) -> Self {
        Self {
            group,
            variant: variant.into(),
            baseline: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_unknown_or_sky_before_geometry() {
        let color = RgbImage::new(2, 2);
        let shown = vec![
            PixelOrigin::Surface,
            PixelOrigin::Environment,
            PixelOrigin::Environment,
            PixelOrigin::Nothing,
        ];
        let picture = JudgedFrame {
            color: color.clone(),
            shown,
        };
        assert_eq!(
            picture.hole_fraction(&[
                Coverage::FULL,
                Coverage::FULL,
                Coverage::from_splat_share(254),
                Coverage::ENVIRONMENT
            ]),
            Some(0.5)
        );
        assert_eq!(
            JudgedFrame {
                color,
                shown: vec![]
            }
            .hole_fraction(&[Coverage::FULL; 4]),
            None
        );
    }
}
