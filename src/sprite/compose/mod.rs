//! Sprites with depth, cube LDIs and polygons in one frame (S25): each layer is drawn by its own
//! renderer, and the layers are laid over each other back to front, over the environment.
//!
//! Layers blend in linear light, as splats do: a cube LDI alone is, but for its thinnest rims, the
//! frame that it would be without the others. A layer is drawn whole, and layers that reach through
//! each other come out in the order of their larger parts; or, at extra cost, pixel by pixel
//! ([`ComposeSettings::by_depth`]). Polygons are compared with cube LDIs splat by splat: they stand
//! in the frame before it is drawn (`polygons.rs`).

mod by_depth;
mod order;
mod polygons;
mod stand;

pub use polygons::{Polygons, PolygonsError, place};

use crate::{Outcome, RenderOptions, SpriteLayer, SpriteRenderer, SpriteSet, straight};
use by_depth::{LayerPicture, lay_by_depth};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_core::frame::Frame;
use headbox_core::simd;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::canvas::linear::LinearLight;
use headbox_cube::render::resolve::composite::{EnvironmentBackground, Pixels};
use headbox_cube::render::{RenderSettings, Renderer};
use order::CubePoints;
use rayon::prelude::*;
use serde::Serialize;
use stand::PolygonRaster;
use std::time::Instant;

/// A layer of a [`Composition`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
pub enum Layer {
    /// A sprite, by its number in [`Composition::sprites`].
    Sprite(usize),
    /// A cube LDI, by its number in [`Composition::cubes`].
    Cube(usize),
    /// All polygons.
    Polygons,
}

/// Sprites, cube LDIs and polygons of one world.
pub struct Composition {
    sprites: SpriteSet,
    cubes: Vec<CubeLdi>,
    points: Vec<CubePoints>,
    polygons: Vec<Polygons>,
    environment: Environment,
}

/// Settings of a composed frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ComposeSettings {
    /// The sprites.
    pub sprites: RenderOptions,
    /// The cube LDIs.
    pub cubes: RenderSettings,
    /// Lays layers over each other pixel by pixel, by depth, instead of whole: slower, and right
    /// where they reach through each other. A sprite's depth is that of its plane. Always so where
    /// there are polygons.
    pub by_depth: bool,
}

/// Statistics of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ComposeStats {
    /// Outcome of each sprite, in the order of [`Composition::sprites`].
    pub outcomes: Vec<Outcome>,
    /// The layers from back to front.
    pub order: Vec<Layer>,
    /// Drawing the sprites, ms.
    pub sprites_ms: f64,
    /// Drawing the cube LDIs, ms.
    pub cubes_ms: f64,
    /// Drawing the polygons, ms.
    pub polygons_ms: f64,
    /// Finding the order, laying the layers over each other and over the environment, ms.
    pub compose_ms: f64,
    /// Depth pixels of the cube LDIs that reached the inner loop.
    pub depth_pixels_in: u64,
    /// Splats drawn.
    pub splatted: u64,
    /// Pixels of which nothing is known.
    pub hole_pixels: u64,
}

/// Buffers reused from frame to frame.
#[derive(Default)]
pub struct Composer {
    sprites: SpriteRenderer,
    cubes: Renderer,
    /// One sprite.
    layer: SpriteLayer,
    polygons: PolygonRaster,
    /// Image of each layer, where depths are compared.
    pictures: Vec<LayerPicture>,
}

impl Composition {
    /// Puts layers together. The environment is that of the first cube LDI that has one, else that
    /// of the sprites.
    pub fn new(sprites: SpriteSet, mut cubes: Vec<CubeLdi>) -> Self {
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
        Self {
            sprites,
            cubes,
            points,
            polygons: Vec::new(),
            environment,
        }
    }

    /// The same with polygons among the images.
    #[must_use]
    pub fn with_polygons(mut self, polygons: Vec<Polygons>) -> Self {
        self.polygons.extend(polygons);
        self
    }

    /// The polygons.
    pub fn polygons(&self) -> &[Polygons] {
        &self.polygons
    }

    /// The sprites.
    pub fn sprites(&self) -> &SpriteSet {
        &self.sprites
    }

    /// The cube LDIs, without their environments.
    pub fn cubes(&self) -> &[CubeLdi] {
        &self.cubes
    }

    /// The layers in the order in which to draw them for an eye. Sprites keep the order that their
    /// planes give ([`SpriteSet::back_to_front`]). A cube LDI comes before the first sprite that
    /// covers it, as the sight lines to its samples say by majority, and after all others that it
    /// covers; of several cube LDIs the farther comes first.
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
        frame.resize(camera.width(), camera.height(), false);
        // Until the environment is put under it: straight colours, with the share that layers cover
        // as their alpha.
        frame.color.fill([0; 4]);
        let mut stats = ComposeStats {
            outcomes: vec![Outcome::Drawn; self.sprites.sprites().len()],
            order: self.back_to_front(camera.eye()),
            ..ComposeStats::default()
        };
        if !self.polygons.is_empty() {
            composer.polygons.draw(&self.polygons, camera);
            stats.polygons_ms = started.elapsed().as_secs_f64() * 1e3;
            // A cube LDI alone is drawn among them: its picture shows them, too.
            if !matches!(stats.order[..], [Layer::Cube(_)]) {
                stats.order.push(Layer::Polygons);
            }
        }
        let by_depth = stats.order.len() > 1 && (settings.by_depth || !self.polygons.is_empty());
        composer.pictures.resize_with(
            if by_depth { stats.order.len() } else { 0 },
            LayerPicture::default,
        );
        for (number, layer) in stats.order.clone().into_iter().enumerate() {
            self.draw_layer(
                composer,
                (number, layer),
                camera,
                settings,
                frame,
                &mut stats,
            );
        }
        if by_depth {
            lay_by_depth(&composer.pictures, &mut frame.color);
        }
        let background = EnvironmentBackground {
            environment: &self.environment,
            camera,
            hole_color_srgb: settings.cubes.hole_color_srgb,
            level: simd::level(),
        };
        let width = (frame.width as usize).max(1);
        let rows = frame
            .color
            .par_chunks_mut(width)
            .zip(frame.coverage.par_chunks_mut(width))
            .enumerate();
        let composite_row = |(y, (colors, coverages)): (usize, (_, _))| {
            background.composite_row(
                y as u32,
                Pixels {
                    colors,
                    coverages,
                    depths_m: &mut [],
                    inverse_depths: &mut [],
                },
            )
        };
        stats.hole_pixels = rows.map(composite_row).sum();
        stats.compose_ms = started.elapsed().as_secs_f64() * 1e3
            - stats.sprites_ms
            - stats.cubes_ms
            - stats.polygons_ms;
        stats
    }

    /// Draws a layer over those before it, or, where depths are compared, into the picture of its
    /// number.
    fn draw_layer(
        &self,
        composer: &mut Composer,
        (number, layer): (usize, Layer),
        camera: &Camera,
        settings: &ComposeSettings,
        frame: &mut Frame,
        stats: &mut ComposeStats,
    ) {
        let started = Instant::now();
        let picture = composer.pictures.get_mut(number);
        match layer {
            Layer::Sprite(index) => {
                let sprite = &self.sprites.sprites()[index];
                stats.outcomes[index] =
                    composer
                        .sprites
                        .render(sprite, camera, &settings.sprites, &mut composer.layer);
                let colors = composer
                    .layer
                    .pixels()
                    .par_iter()
                    .map(|pixel| straight(*pixel));
                match picture {
                    Some(picture) => {
                        let (plane, width) =
                            (sprite.sprite().sprite().plane(), camera.width() as usize);
                        let depth = |i: usize| {
                            let [x, y] = [i % width, i / width].map(|at| at as f64 + 0.5);
                            plane.inverse_depth(camera, x, y) as f32
                        };
                        picture.set(colors, (0..frame.color.len()).into_par_iter().map(depth));
                    }
                    None => lay_over(&mut frame.color, colors),
                }
                stats.sprites_ms += started.elapsed().as_secs_f64() * 1e3;
            }
            Layer::Cube(index) => {
                let cube = &self.cubes[index];
                let cubes = RenderSettings {
                    depth: picture.is_some() || settings.cubes.depth,
                    ..settings.cubes
                };
                let (drawn, cube_stats) = match self.polygons.is_empty() {
                    true => composer.cubes.render_with_stats(cube, camera, &cubes),
                    false => composer.cubes.render_with_layer(
                        cube,
                        &composer.polygons.layer(),
                        camera,
                        &cubes,
                    ),
                };
                stats.depth_pixels_in += cube_stats.depth_pixels_in;
                stats.splatted += cube_stats.splatted;
                let colors = drawn.color.par_iter().zip(&drawn.coverage);
                let colors =
                    colors.map(|(&[r, g, b, _], coverage)| [r, g, b, coverage.splat_share()]);
                match picture {
                    Some(picture) => picture.set(
                        colors,
                        drawn.depth_m.par_iter().map(|depth_m| 1.0 / depth_m),
                    ),
                    None => lay_over(&mut frame.color, colors),
                }
                stats.cubes_ms += started.elapsed().as_secs_f64() * 1e3;
            }
            Layer::Polygons => {
                let (layer, width) = (composer.polygons.layer(), camera.width() as usize);
                let pixels = (0..frame.color.len())
                    .into_par_iter()
                    .map(|i| layer.pixel(i % width, i / width));
                let colors = pixels.clone().map(|(color, _)| color);
                match picture {
                    Some(picture) => {
                        picture.set(colors, pixels.map(|(_, inverse_depth)| inverse_depth));
                    }
                    None => lay_over(&mut frame.color, colors),
                }
                stats.polygons_ms += started.elapsed().as_secs_f64() * 1e3;
            }
        }
    }
}

/// Pixels that a thread takes at least.
const AT_LEAST: usize = 1 << 14;

/// Lays a layer over what is there: straight colours, each with the share of 255 that it covers.
fn lay_over(behind: &mut [[u8; 4]], front: impl IndexedParallelIterator<Item = [u8; 4]>) {
    let linear = LinearLight::tables();
    behind
        .par_iter_mut()
        .zip(front)
        .with_min_len(AT_LEAST)
        .for_each(|(behind, front)| {
            *behind = laid_over(linear, front, *behind);
        });
}

/// A straight colour over another, each with the share of 255 that it covers.
fn laid_over(light: &LinearLight, front: [u8; 4], behind: [u8; 4]) -> [u8; 4] {
    match (front[3], behind[3]) {
        (0, _) => behind,
        (255, _) | (_, 0) => front,
        _ => light.over(front, behind),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
    use headbox_core::random::Rng;

    /// Two roundings to 8 bits, each of half a level and, in the darkest colours, of 12 bits of
    /// linear light.
    const LAID_LEVELS: f32 = 2.0;

    #[test]
    fn layers_blend_as_light_does() {
        let mut random = Rng::keyed(5);
        for _ in 0..10_000 {
            let mut pixel = |share: u8| {
                [
                    random.below(256) as u8,
                    random.below(256) as u8,
                    random.below(256) as u8,
                    share,
                ]
            };
            let (front, middle, back) = (pixel(77), pixel(200), pixel(255));
            let mut two = [middle];
            lay_over(&mut two, [front].into_par_iter());
            let mut laid = [back];
            lay_over(&mut laid, two.into_par_iter());
            for c in 0..3 {
                let mix = |front: [u8; 4], behind: f32| {
                    let share = f32::from(front[3]) / 255.0;
                    linear_from_srgb8(front[c]) * share + behind * (1.0 - share)
                };
                let exact = srgb8_from_linear(mix(front, mix(middle, linear_from_srgb8(back[c]))));
                let off = f32::from(laid[0][c].abs_diff(exact));
                assert!(
                    off <= LAID_LEVELS,
                    "{front:?} over {middle:?} over {back:?}: {laid:?}, not {exact}"
                );
            }
            assert_eq!(laid[0][3], 255);
        }
        let (opaque, clear, thin) = ([1, 2, 3, 255], [9, 9, 9, 0], [40, 50, 60, 7]);
        let laid = |behind: [u8; 4], front: [u8; 4]| {
            let mut pixel = [behind];
            lay_over(&mut pixel, [front].into_par_iter());
            pixel[0]
        };
        assert_eq!(
            [laid(thin, opaque), laid(opaque, clear), laid(clear, thin)],
            [opaque, opaque, thin]
        );
    }
}
