//! Rendering of backdrops.

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
    /// Number of depth pixels (or texels) of the backdrop.
    pub samples: u64,
    /// Number of depth pixels that reached the inner loop, once per band.
    pub depth_pixels_in: u64,
    /// Number of splats drawn.
    pub splatted: u64,
}

/// Renderer of backdrops; reuses its buffers from frame to frame.
#[derive(Default)]
pub struct Drawer {
    renderer: Renderer,
    sprites: SpriteDrawer,
    frame: Frame,
}

impl Drawer {
    /// Renders a backdrop for a camera, which may be cropped to the portal. Uncovered pixels are
    /// holes.
    pub fn draw(
        &mut self,
        backdrop: &Backdrop,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, BackdropStats) {
        let mut stats = BackdropStats::default();
        let (size, hole) = ([camera.width(), camera.height()], settings.hole_color_srgb);
        match backdrop {
            Backdrop::Textures(set) => {
                self.frame.reset(size[0], size[1], hole);
                set.draw(camera, &mut self.frame);
                stats.samples = u64::from(set.size[0]) * u64::from(set.size[1]);
            }
            Backdrop::Sprite(sprite) => {
                self.frame.reset(size[0], size[1], hole);
                self.sprites.draw(sprite, camera, &mut self.frame);
                stats.samples = sprite.sample_count();
            }
            Backdrop::Cubes(cubes) => match by_distance(cubes, camera.eye())[..] {
                [] => self.frame.reset(size[0], size[1], hole),
                [cube] => {
                    let (frame, warped) = self.renderer.render_with_stats(cube, camera, settings);
                    stats.add(cube, warped);
                    return (frame, stats);
                }
                [nearest, second, ..] => {
                    let (frame, warped) = self.renderer.render_with_stats(second, camera, settings);
                    stats.add(second, warped);
                    self.frame.clone_from(frame);
                    let (frame, warped) =
                        self.renderer.render_with_stats(nearest, camera, settings);
                    stats.add(nearest, warped);
                    for (i, coverage) in frame.coverage.iter().enumerate() {
                        // The nearer image covers the farther one wherever it has a sample (R9).
                        if coverage.splat_share() >= 128 || self.frame.coverage[i].is_hole() {
                            self.frame.color[i] = frame.color[i];
                            self.frame.coverage[i] = *coverage;
                        }
                    }
                }
            },
        }
        (&self.frame, stats)
    }
}

impl BackdropStats {
    fn add(&mut self, cube: &CubeLdi, warped: &FrameStats) {
        self.samples += cube.depth_pixel_count() as u64;
        self.depth_pixels_in += warped.depth_pixels_in;
        self.splatted += warped.splatted;
    }
}

/// Sorts cubes by the distance of their centres from the eye.
fn by_distance(cubes: &[CubeLdi], eye: DVec3) -> Vec<&CubeLdi> {
    let distance = |cube: &CubeLdi| (cube.info.centre - eye).length_squared();
    let mut sorted: Vec<&CubeLdi> = cubes.iter().collect();
    sorted.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    sorted
}
