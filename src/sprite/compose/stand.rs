//! Rasterised polygons of a frame: at twice the frame's resolution where they may be visible, so
//! that silhouettes have partial coverage, and with a depth for each pixel ([`DepthLayer`]).

use super::AT_LEAST;
use super::polygons::Polygons;
use headbox_core::camera::{Camera, CameraError};
use headbox_core::color::linear_from_srgb8;
use headbox_core::environment::Environment;
use headbox_core::tone::ToneMap;
use headbox_cube::render::DepthLayer;
use headbox_cube::render::canvas::linear::LinearLight;
use headbox_raster::{GroupWindow, RasterView, Rasterizer};
use rayon::prelude::*;
use std::ops::Range;

/// Parts of a pixel along each axis; of frames so large that no camera has as many pixels, one.
const PARTS: u32 = 2;

/// All polygons of a frame, nearest first.
#[derive(Default)]
pub(super) struct PolygonRaster {
    rasterizer: Rasterizer,
    /// Columns and rows of the frame that may show polygons.
    window: [Range<u32>; 2],
    /// Colour and inverse depth (1/m, 0 for none) of each subpixel of the window.
    parts: SubpixelImage,
    /// Pixels of the window.
    pixels: SubpixelImage,
}

/// Row-major.
#[derive(Default)]
struct SubpixelImage {
    colors: Vec<[u8; 4]>,
    inverse_depth: Vec<f32>,
}

impl SubpixelImage {
    fn resize(&mut self, count: usize) {
        self.colors.resize(count, [0; 4]);
        self.inverse_depth.resize(count, 0.0);
    }
}

impl PolygonRaster {
    /// Draws polygons, each where it is nearer than the others.
    pub(super) fn draw(&mut self, polygons: &[Polygons], camera: &Camera) {
        self.window = window(polygons, camera);
        let [columns, rows] = self.window.each_ref().map(|range| range.len());
        self.pixels.resize(columns * rows);
        if columns * rows == 0 {
            return;
        }
        let finer =
            parts_of(camera, &self.window, PARTS).or_else(|_| parts_of(camera, &self.window, 1));
        match &finer {
            Ok(finer) => self.draw_parts(polygons, finer),
            Err(_) => self.parts.resize(0),
        }
        self.join_parts(
            columns,
            finer.map_or(1, |finer| finer.width() as usize / columns),
        );
    }

    fn draw_parts(&mut self, polygons: &[Polygons], camera: &Camera) {
        let groups = [GroupWindow {
            group: 0,
            window: None,
        }];
        let view = RasterView {
            groups: &groups,
            markers: &[],
            exposure: 1.0,
            hole_color_srgb: [0; 3],
        };
        for (number, polygons) in polygons.iter().enumerate() {
            self.rasterizer
                .draw(polygons.mesh(), camera, &view, &Environment::default());
            let drawn = self.rasterizer.output_mut();
            store_as(polygons.tone(), &mut drawn.frame.color);
            if number == 0 {
                std::mem::swap(&mut self.parts.colors, &mut drawn.frame.color);
                std::mem::swap(&mut self.parts.inverse_depth, &mut drawn.inverse_depth);
                continue;
            }
            let theirs = drawn.frame.color.par_iter().zip(&drawn.inverse_depth);
            let ours = self
                .parts
                .colors
                .par_iter_mut()
                .zip(&mut self.parts.inverse_depth);
            ours.zip(theirs).with_min_len(AT_LEAST).for_each(
                |((color, depth), (their_color, their_depth))| {
                    if their_depth > depth {
                        (*color, *depth) = (*their_color, *their_depth);
                    }
                },
            );
        }
    }

    /// Pixels from their parts: the mean colour of those that show something, as light adds up, how
    /// many these are as a share of 255, and the depth of the nearest.
    fn join_parts(&mut self, columns: usize, parts: usize) {
        let light = LinearLight::tables();
        let (colors, depths) = (
            self.parts.colors.as_slice(),
            self.parts.inverse_depth.as_slice(),
        );
        let stride = columns * parts;
        let rows = self
            .pixels
            .colors
            .par_chunks_mut(columns)
            .zip(self.pixels.inverse_depth.par_chunks_mut(columns));
        rows.enumerate()
            .with_min_len(AT_LEAST / columns + 1)
            .for_each(|(row, (to_colors, to_depths))| {
                for (column, (color, depth)) in to_colors.iter_mut().zip(to_depths).enumerate() {
                    let first = (row * stride + column) * parts;
                    let [beside, below] = [parts - 1, (parts - 1) * stride];
                    let part = |i: usize| Some((*colors.get(i)?, *depths.get(i)?));
                    let four = [first, first + beside, first + below, first + below + beside];
                    (*color, *depth) = joined(light, four.map(|i| part(i).unwrap_or_default()));
                }
            });
    }

    /// Returns the polygons drawn last.
    pub(super) fn layer(&self) -> DepthLayer<'_> {
        let SubpixelImage {
            colors,
            inverse_depth,
        } = &self.pixels;
        DepthLayer {
            window: self
                .window
                .each_ref()
                .map(|range| range.start as usize..range.end as usize),
            colors,
            inverse_depth,
        }
    }
}

/// Four parts of a pixel.
fn joined(light: &LinearLight, parts: [([u8; 4], f32); 4]) -> ([u8; 4], f32) {
    let weights = parts.map(|(_, depth)| u32::from(depth > 0.0));
    let count: u32 = weights.iter().sum();
    if count == 0 {
        return ([0; 4], 0.0);
    }
    let [r, g, b] = light.mix(parts.map(|([r, g, b, _], _)| [r, g, b]), weights);
    let nearest = parts
        .iter()
        .fold(0.0, |nearest, (_, depth)| f32::max(nearest, *depth));
    ([r, g, b, (count * 255 / (PARTS * PARTS)) as u8], nearest)
}

/// The camera of the parts, so many along each axis, of all pixels of a window.
fn parts_of(
    camera: &Camera,
    [columns, rows]: &[Range<u32>; 2],
    parts: u32,
) -> Result<Camera, CameraError> {
    let finer = |range: &Range<u32>| range.start * parts..range.end * parts;
    let focal_px = camera.focal_px() * f64::from(parts);
    // Its size is that of the window; the principal point counts from the whole frame's corner.
    let whole = Camera::from_parts(camera.eye(), camera.world_from_eye(), focal_px, 1, 1)?;
    whole
        .with_principal_px(camera.principal_px().map(|px| px * f64::from(parts)))
        .cropped(finer(columns), finer(rows))
}

/// The columns and rows of a frame that may show polygons.
fn window(polygons: &[Polygons], camera: &Camera) -> [Range<u32>; 2] {
    let sides = [camera.width(), camera.height()];
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in polygons.iter().flat_map(Polygons::corners) {
        let Some([x, y, _]) = camera.project(corner) else {
            return sides.map(|side| 0..side);
        };
        for (axis, at) in [x, y].into_iter().enumerate() {
            (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
        }
    }
    std::array::from_fn(|axis| {
        // Conversion saturates, and corners are snapped to parts of a pixel.
        let (start, end) = ((low[axis] - 1.0) as u32, (high[axis] + 2.0) as u32);
        start.min(sides[axis])..end.clamp(start.min(sides[axis]), sides[axis])
    })
}

/// Stores clipped colours by a tone curve.
fn store_as(tone: ToneMap, colors: &mut [[u8; 4]]) {
    if tone == ToneMap::SrgbClipped {
        return;
    }
    let stored: [u8; 256] = std::array::from_fn(|level| tone.level(linear_from_srgb8(level as u8)));
    let colors = colors.par_iter_mut().with_min_len(AT_LEAST);
    colors.for_each(|[r, g, b, _]| {
        [r, g, b]
            .into_iter()
            .for_each(|c| *c = stored[usize::from(*c)]);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn frames_too_large_for_parts_show_polygons_too() {
        let scene = headbox_scenes::build("bump", 0).expect("built in");
        let [low, high] = scene.bounds();
        let (middle, away) = ((low + high) / 2.0, (high - low).length());
        let polygons = [Polygons::new(scene).expect("valid")];
        let shown = [[64, 4], [Camera::MAX_SIDE_PX, 4]].map(|size| {
            // The frame is as wide as it is far away, and the model fills it.
            let (eye, focal_px) = (middle + DVec3::Z * (away * 0.3), f64::from(size[0]));
            let camera = Camera::from_parts(eye, DMat3::IDENTITY, focal_px, size[0], size[1])
                .expect("valid");
            let mut stand = PolygonRaster::default();
            stand.draw(&polygons, &camera);
            assert!(
                stand.window[0].len() > size[0] as usize / 2,
                "{:?}",
                stand.window
            );
            let (layer, [width, height]) = (stand.layer(), size.map(|side| side as usize));
            layer.pixel(width / 2, height / 2)
        });
        assert!(
            shown
                .iter()
                .all(|(color, depth)| color[3] == 255 && *depth > 0.0),
            "{shown:?}"
        );
    }

    #[test]
    fn pixel_is_mean_light_of_subpixels() {
        let light = LinearLight::tables();
        let (white, black, nothing) = (([255; 4], 2.0), ([0, 0, 0, 255], 3.0), ([77; 4], 0.0));
        assert_eq!(joined(light, [nothing; 4]), ([0; 4], 0.0));
        assert_eq!(
            joined(light, [white, nothing, nothing, white]),
            ([255, 255, 255, 127], 2.0)
        );
        assert_eq!(joined(light, [black; 4]), ([0, 0, 0, 255], 3.0));
        let ([half, ..], nearest) = joined(light, [white, black, black, white]);
        // Half of white's light is 188.
        assert!(half.abs_diff(188) <= 1 && nearest == 3.0, "{half}");
    }
}
