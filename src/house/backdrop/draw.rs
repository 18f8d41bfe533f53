//! A backdrop on a frame.

use super::Backdrop;
use super::sprite::SpriteDrawer;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::{FrameStats, RenderSettings, Renderer};
use serde::Serialize;

/// Statistics of drawing a backdrop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BackdropStats {
    /// Depth pixels (or texels) of the backdrop that was drawn.
    pub samples: u64,
    /// Depth pixels that reached the inner loop, once for each band.
    pub depth_pixels_in: u64,
    /// Splats drawn.
    pub splatted: u64,
}

/// Draws backdrops; owns the buffers.
#[derive(Default)]
pub struct Drawer {
    renderer: Renderer,
    sprites: SpriteDrawer,
    frame: Frame,
}

impl Drawer {
    /// Draws a backdrop as seen by a camera, which may be cropped to the portal. Pixels of which
    /// nothing is known are holes.
    pub fn draw(
        &mut self,
        backdrop: &Backdrop,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, BackdropStats) {
        let mut stats = BackdropStats::default();
        match backdrop {
            Backdrop::Textures(set) => {
                self.frame
                    .reset(camera.width(), camera.height(), settings.hole_color_srgb);
                set.draw(camera, &mut self.frame);
                stats.samples = u64::from(set.size[0]) * u64::from(set.size[1]);
                (&self.frame, stats)
            }
            Backdrop::Sprite(sprite) => {
                self.frame
                    .reset(camera.width(), camera.height(), settings.hole_color_srgb);
                self.sprites.draw(sprite, camera, &mut self.frame);
                stats.samples = sprite.sample_count();
                (&self.frame, stats)
            }
            Backdrop::Cubes(cubes) => {
                let [nearest, second] = two_nearest(cubes, camera.eye());
                let Some(nearest) = nearest else {
                    self.frame
                        .reset(camera.width(), camera.height(), settings.hole_color_srgb);
                    return (&self.frame, stats);
                };
                let Some(second) = second else {
                    let (frame, warped) =
                        self.renderer.render_with_stats(nearest, camera, settings);
                    stats.add(nearest, warped);
                    return (frame, stats);
                };
                let (frame, warped) = self.renderer.render_with_stats(second, camera, settings);
                stats.add(second, warped);
                self.frame.clone_from(frame);
                let (frame, warped) = self.renderer.render_with_stats(nearest, camera, settings);
                stats.add(nearest, warped);
                for (i, coverage) in frame.coverage.iter().enumerate() {
                    // The nearer image goes over the farther one wherever it has something (R9).
                    if coverage.splat_share() >= 128 || self.frame.coverage[i].is_hole() {
                        (self.frame.color[i], self.frame.coverage[i]) = (frame.color[i], *coverage);
                    }
                }
                (&self.frame, stats)
            }
        }
    }
}

impl BackdropStats {
    fn add(&mut self, cube: &CubeLdi, warped: &FrameStats) {
        self.samples += cube.depth_pixel_count() as u64;
        self.depth_pixels_in += warped.depth_pixels_in;
        self.splatted += warped.splatted;
    }
}

/// Returns the cubes nearest and second nearest to the eye; the only one if there is one.
fn two_nearest(cubes: &[CubeLdi], eye: DVec3) -> [Option<&CubeLdi>; 2] {
    let distance = |cube: &CubeLdi| (cube.info.centre - eye).length_squared();
    let mut sorted: Vec<&CubeLdi> = cubes.iter().collect();
    sorted.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    [sorted.first().copied(), sorted.get(1).copied()]
}
