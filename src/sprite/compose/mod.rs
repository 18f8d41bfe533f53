//! Composition of sprites with depth, cube LDIs and polygons in one frame (S25): each layer is
//! drawn by its own renderer, and the layers are composited back to front over the environment.
//!
//! Layers blend in linear light, as splats do: apart from its thinnest rims, a cube LDI alone gives
//! the same frame as its own renderer. By default layers are composited whole, and intersecting
//! layers in the order of their larger parts; optionally, at extra cost, pixel by pixel
//! ([`ComposeSettings::by_depth`]). Between polygons and cube LDIs the depth test is per splat:
//! polygons are in the frame before a cube LDI is drawn (`polygons.rs`).

mod by_depth;
mod order;
mod polygon_raster;
mod polygons;
mod seen_sky;

pub use polygons::{Polygons, PolygonsError, place};

use crate::{Outcome, RenderOptions, SpriteLayer, SpriteRenderer, SpriteSet, unpremultiply};
use by_depth::{LayerImage, composite_by_depth};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::simd;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::canvas::linear::LinearLight;
use headbox_cube::render::resolve::composite_environment::{EnvironmentBackground, Pixels};
use headbox_cube::render::{RenderSettings, Renderer};
use order::CubePoints;
use polygon_raster::PolygonRaster;
use rayon::prelude::*;
use seen_sky::SeenSky;
use serde::Serialize;
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
    /// Sky behind sprites without cube LDIs, whose environments know where it is seen.
    seen_sky: Option<SeenSky>,
}

/// Settings of a composed frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ComposeSettings {
    /// The sprites.
    pub sprites: RenderOptions,
    /// The cube LDIs.
    pub cubes: RenderSettings,
    /// Composites layers pixel by pixel, by depth, instead of whole: slower, but correct where
    /// layers intersect. A sprite's depth is that of its plane. Always on if there are polygons.
    pub by_depth: bool,
}

/// Statistics of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ComposeStats {
    /// Outcome of each sprite, in the order of [`Composition::sprites`].
    pub outcomes: Vec<Outcome>,
    /// The layers from back to front.
    pub order: Vec<Layer>,
    /// Time to draw the sprites, ms.
    pub sprites_ms: f64,
    /// Time to draw the cube LDIs, ms.
    pub cubes_ms: f64,
    /// Time to draw the polygons, ms.
    pub polygons_ms: f64,
    /// Time to sort the layers and to composite them over the environment, ms.
    pub compose_ms: f64,
    /// Number of depth pixels of the cube LDIs that reached the inner loop.
    pub depth_pixels_in: u64,
    /// Number of splats drawn.
    pub splatted: u64,
    /// Number of hole pixels: no layer covers them, and the environment is not known to be seen
    /// there.
    pub hole_pixels: u64,
}

/// Renderers and buffers, reused from frame to frame.
#[derive(Default)]
pub struct Composer {
    sprites: SpriteRenderer,
    cubes: Renderer,
    /// Output of one sprite.
    layer: SpriteLayer,
    polygons: PolygonRaster,
    /// Image of each layer, if layers are composited by depth.
    images: Vec<LayerImage>,
}

impl Composition {
    /// Creates a composition. The environment is that of the first cube LDI that has one, else that
    /// of the sprites.
    pub fn new(sprites: SpriteSet, mut cubes: Vec<CubeLdi>) -> Self {
        let mut environment = Environment::default();
        // With its own environment a cube would hide the layers behind it.
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
        let seen_sky =
            (cubes.is_empty() && !sprites.sprites().is_empty()).then(|| SeenSky::new(&sprites));
        Self {
            sprites,
            cubes,
            points,
            polygons: Vec::new(),
            environment,
            seen_sky,
        }
    }

    /// Adds polygons to the composition.
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

    /// Returns the layers in drawing order for an eye, back to front. Sprites keep the order of
    /// their planes ([`SpriteSet::back_to_front`]). A cube LDI comes before the first sprite that
    /// covers it, by the majority of sight lines to its samples, else after the last sprite that it
    /// covers; farther cube LDIs come before nearer ones.
    pub fn back_to_front(&self, eye: DVec3) -> Vec<Layer> {
        order::back_to_front(&self.sprites, &self.points, eye)
    }

    /// Renders the composition for `camera` into `frame`, which is resized to the camera.
    pub fn render(
        &self,
        composer: &mut Composer,
        camera: &Camera,
        settings: &ComposeSettings,
        frame: &mut Frame,
    ) -> ComposeStats {
        let started = Instant::now();
        frame.resize(camera.width(), camera.height(), false);
        // Straight colours with the coverage of the layers as alpha, until the environment is
        // composited behind them.
        frame.color.fill([0; 4]);
        let mut stats = ComposeStats {
            outcomes: vec![Outcome::Drawn; self.sprites.sprites().len()],
            order: self.back_to_front(camera.eye()),
            ..ComposeStats::default()
        };
        if !self.polygons.is_empty() {
            composer.polygons.draw(&self.polygons, camera);
            stats.polygons_ms = started.elapsed().as_secs_f64() * 1e3;
            // A single cube LDI is drawn together with them: its image contains them.
            if !matches!(stats.order[..], [Layer::Cube(_)]) {
                stats.order.push(Layer::Polygons);
            }
        }
        let by_depth = stats.order.len() > 1 && (settings.by_depth || !self.polygons.is_empty());
        composer.images.resize_with(
            if by_depth { stats.order.len() } else { 0 },
            LayerImage::default,
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
            composite_by_depth(&composer.images, &mut frame.color);
        }
        stats.hole_pixels =
            self.composite_environment(camera, settings.cubes.hole_color_srgb, frame);
        stats.compose_ms = started.elapsed().as_secs_f64() * 1e3
            - stats.sprites_ms
            - stats.cubes_ms
            - stats.polygons_ms;
        stats
    }

    /// Composites the environment behind the layers of `frame`. Returns the number of holes,
    /// including pixels that show the environment where no sprite's camera saw it.
    fn composite_environment(
        &self,
        camera: &Camera,
        hole_color_srgb: [u8; 3],
        frame: &mut Frame,
    ) -> u64 {
        let background = EnvironmentBackground {
            environment: &self.environment,
            camera,
            hole_color_srgb,
            level: simd::level(),
        };
        let width = (frame.width as usize).max(1);
        let rows = frame
            .color
            .par_chunks_mut(width)
            .zip(frame.coverage.par_chunks_mut(width))
            .enumerate();
        let composite_row = |(y, (colors, coverages)): (usize, (_, &mut [Coverage]))| {
            let holes = background.composite_row(
                y as u32,
                Pixels {
                    colors,
                    coverages: &mut *coverages,
                    depths_m: &mut [],
                    inverse_depths: &mut [],
                },
            );
            let unseen = |sky: &SeenSky| sky.mark_unseen(camera, y, coverages);
            holes + self.seen_sky.as_ref().map_or(0, unseen)
        };
        rows.map(composite_row).sum()
    }

    /// Draws a layer over those before it or, when layers are composited by depth, into the image
    /// of its number.
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
        let image = composer.images.get_mut(number);
        let pixels = (0..frame.color.len()).into_par_iter();
        let width = camera.width() as usize;
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
                    .map(|pixel| unpremultiply(*pixel));
                let plane = sprite.sprite().sprite().plane();
                let inverse_depths = pixels.map(|i| {
                    let [x, y] = [i % width, i / width].map(|at| at as f64 + 0.5);
                    plane.inverse_depth(camera, x, y) as f32
                });
                store_layer(image, &mut frame.color, colors, inverse_depths);
                stats.sprites_ms += started.elapsed().as_secs_f64() * 1e3;
            }
            Layer::Cube(index) => {
                let cube = &self.cubes[index];
                let cubes = RenderSettings {
                    depth: image.is_some() || settings.cubes.depth,
                    ..settings.cubes
                };
                let renderer = &mut composer.cubes;
                let (drawn, cube_stats) = if self.polygons.is_empty() {
                    renderer.render_with_stats(cube, camera, &cubes)
                } else {
                    renderer.render_with_layer(cube, &composer.polygons.layer(), camera, &cubes)
                };
                stats.depth_pixels_in += cube_stats.depth_pixels_in;
                stats.splatted += cube_stats.splatted;
                let colors = drawn.color.par_iter().zip(&drawn.coverage);
                let colors =
                    colors.map(|(&[r, g, b, _], coverage)| [r, g, b, coverage.splat_share()]);
                let inverse_depths = drawn.depth_m.par_iter().map(|depth_m| 1.0 / depth_m);
                store_layer(image, &mut frame.color, colors, inverse_depths);
                stats.cubes_ms += started.elapsed().as_secs_f64() * 1e3;
            }
            Layer::Polygons => {
                let layer = composer.polygons.layer();
                let samples = pixels.map(|i| layer.pixel(i % width, i / width));
                let colors = samples.clone().map(|(color, _)| color);
                let inverse_depths = samples.map(|(_, inverse_depth)| inverse_depth);
                store_layer(image, &mut frame.color, colors, inverse_depths);
                stats.polygons_ms += started.elapsed().as_secs_f64() * 1e3;
            }
        }
    }
}

/// Minimum number of pixels per thread.
const MIN_PIXELS_PER_THREAD: usize = 1 << 14;

/// Stores a drawn layer in `image` or, without one, composites it over `frame`.
fn store_layer(
    image: Option<&mut LayerImage>,
    frame: &mut [[u8; 4]],
    colors: impl IndexedParallelIterator<Item = [u8; 4]>,
    inverse_depths: impl IndexedParallelIterator<Item = f32>,
) {
    match image {
        Some(image) => image.set(colors, inverse_depths),
        None => blend_layer(frame, colors),
    }
}

/// Composites a layer over `behind`: straight colours with coverage as alpha.
fn blend_layer(behind: &mut [[u8; 4]], front: impl IndexedParallelIterator<Item = [u8; 4]>) {
    let linear = LinearLight::tables();
    behind
        .par_iter_mut()
        .zip(front)
        .with_min_len(MIN_PIXELS_PER_THREAD)
        .for_each(|(behind, front)| {
            *behind = blend_over(linear, front, *behind);
        });
}

/// Composites a straight colour with coverage over another.
fn blend_over(light: &LinearLight, front: [u8; 4], behind: [u8; 4]) -> [u8; 4] {
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
            blend_layer(&mut two, [front].into_par_iter());
            let mut laid = [back];
            blend_layer(&mut laid, two.into_par_iter());
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
            blend_layer(&mut pixel, [front].into_par_iter());
            pixel[0]
        };
        assert_eq!(
            [laid(thin, opaque), laid(opaque, clear), laid(clear, thin)],
            [opaque, opaque, thin]
        );
    }
}
