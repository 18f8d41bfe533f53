//! Sprites with depth and cube LDIs in one frame (S25): each layer is drawn by its own renderer, and the layers are
//! laid over each other back to front, over the environment.
//!
//! A layer is drawn whole: layers that reach through each other come out in the order of their larger parts.

mod order;

use crate::capture::Camera;
use crate::environment::Environment;
use crate::frame::Frame;
use crate::packed::PackedCube;
use crate::render::{RenderSettings, Renderer};
use crate::sprite::{Outcome, RenderOptions, SpriteLayer, SpriteRenderer, SpriteSet};
use glam::DVec3;
use order::CubePoints;
use serde::Serialize;
use std::time::Instant;

/// A layer of a [`Composition`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
pub enum Layer {
    /// A sprite, by its number in [`Composition::sprites`].
    Sprite(usize),
    /// A cube LDI, by its number in [`Composition::cubes`].
    Cube(usize),
}

/// Sprites and cube LDIs of one world.
pub struct Composition {
    sprites: SpriteSet,
    cubes: Vec<PackedCube>,
    points: Vec<CubePoints>,
    environment: Environment,
}

/// How the layers are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ComposeSettings {
    /// The sprites.
    pub sprites: RenderOptions,
    /// The cube LDIs.
    pub cubes: RenderSettings,
}

/// What a frame took.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ComposeStats {
    /// How each sprite came out, in the order of [`Composition::sprites`].
    pub outcomes: Vec<Outcome>,
    /// The layers from back to front.
    pub order: Vec<Layer>,
    /// Drawing the sprites, ms.
    pub sprites_ms: f64,
    /// Drawing the cube LDIs, ms.
    pub cubes_ms: f64,
    /// Finding the order, laying the layers over each other and over the environment, ms.
    pub compose_ms: f64,
    /// Depth pixels of the cube LDIs that reached the inner loop.
    pub depth_pixels_in: u64,
    /// Of these, drawn.
    pub splatted: u64,
    /// Pixels of which nothing is known.
    pub hole_pixels: u64,
}

/// What drawing needs from frame to frame.
#[derive(Default)]
pub struct Composer {
    sprites: SpriteRenderer,
    cubes: Renderer,
    /// One sprite.
    layer: SpriteLayer,
    /// The layers drawn so far, over each other.
    composed: SpriteLayer,
}

impl Composition {
    /// Puts layers together. The environment is that of the first cube LDI that has one, else that of the sprites.
    pub fn new(sprites: SpriteSet, mut cubes: Vec<PackedCube>) -> Self {
        let mut environment = Environment::default();
        // Each cube's own environment would hide what lies behind the cube.
        for cube in &mut cubes {
            let own = std::mem::take(&mut cube.environment);
            if environment.size_px == 0 {
                environment = own;
            }
        }
        if environment.size_px == 0 {
            environment = sprites.environment.clone();
        }
        let points = cubes.iter().map(CubePoints::new).collect();
        Self { sprites, cubes, points, environment }
    }

    /// The sprites.
    pub fn sprites(&self) -> &SpriteSet {
        &self.sprites
    }

    /// The cube LDIs, without their environments.
    pub fn cubes(&self) -> &[PackedCube] {
        &self.cubes
    }

    /// The layers in the order in which to draw them for an eye. Sprites keep the order that their planes give
    /// ([`SpriteSet::back_to_front`]). A cube LDI comes before the first sprite that covers it, as the sight lines to
    /// its samples say by majority, and after all others that it covers; of several cube LDIs the farther comes first.
    pub fn back_to_front(&self, eye: DVec3) -> Vec<Layer> {
        order::back_to_front(&self.sprites, &self.points, eye)
    }

    /// Draws what `camera` sees into `frame`, which takes the camera's size.
    pub fn render(
        &self,
        composer: &mut Composer,
        camera: &Camera,
        settings: &ComposeSettings,
        frame: &mut Frame,
    ) -> ComposeStats {
        let started = Instant::now();
        composer.composed.reset(camera.width(), camera.height());
        let mut stats = ComposeStats {
            outcomes: vec![Outcome::Drawn; self.sprites.sprites().len()],
            order: self.back_to_front(camera.eye()),
            ..ComposeStats::default()
        };
        for layer in stats.order.clone() {
            let layer_started = Instant::now();
            match layer {
                Layer::Sprite(index) => {
                    let sprite = &self.sprites.sprites()[index];
                    let outcome = composer.sprites.render(sprite, camera, &settings.sprites, &mut composer.layer);
                    stats.outcomes[index] = outcome;
                    composer.composed.draw_over(&composer.layer);
                    stats.sprites_ms += layer_started.elapsed().as_secs_f64() * 1e3;
                }
                Layer::Cube(index) => {
                    draw_cube(composer, &self.cubes[index], camera, &settings.cubes, &mut stats);
                    stats.cubes_ms += layer_started.elapsed().as_secs_f64() * 1e3;
                }
            }
        }
        let environment = |x: u32, y: u32| {
            let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            self.environment.sample(direction.as_vec3())
        };
        composer.composed.finish(environment, settings.cubes.hole_color_srgb, frame);
        stats.hole_pixels = frame.hole_count();
        stats.compose_ms = started.elapsed().as_secs_f64() * 1e3 - stats.sprites_ms - stats.cubes_ms;
        stats
    }
}

/// Draws a cube LDI without an environment over the layers before it.
fn draw_cube(
    composer: &mut Composer,
    cube: &PackedCube,
    camera: &Camera,
    settings: &RenderSettings,
    stats: &mut ComposeStats,
) {
    let (drawn, cube_stats) = composer.cubes.render_with_stats(cube, camera, settings);
    composer.composed.draw_frame_over(drawn);
    stats.depth_pixels_in += cube_stats.depth_pixels_in;
    stats.splatted += cube_stats.splatted;
}
