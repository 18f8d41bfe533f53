//! Rasterised polygons of a frame: at twice the frame's resolution inside their bounding rectangle,
//! so that silhouettes have partial coverage, and with a depth per pixel ([`DepthLayer`]).

use super::MIN_PIXELS_PER_THREAD;
use super::polygons::Polygons;
use headbox_core::camera::{Camera, CameraError};
use headbox_core::color::linear_from_srgb8;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_cube::render::DepthLayer;
use headbox_cube::render::canvas::linear::LinearLight;
use headbox_raster::{GroupWindow, RasterView, Rasterizer};
use rayon::prelude::*;
use std::ops::Range;

/// Number of subpixels along each axis; 1 if the frame is too large for a camera of that
/// resolution.
const SUBPIXELS: u32 = 2;

/// Raster of all polygons of a frame.
#[derive(Default)]
pub(super) struct PolygonRaster {
    rasterizer: Rasterizer,
    /// Bounding rectangle of the polygons: columns and rows of the frame.
    window: [Range<u32>; 2],
    /// Subpixels of the window.
    subpixels: SubpixelImage,
    /// Pixels of the window.
    pixels: SubpixelImage,
}

/// Colours and inverse depths (1/m, 0 for none), row-major.
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
    /// Draws all polygons with a depth test.
    pub(super) fn draw(&mut self, polygons: &[Polygons], camera: &Camera) {
        self.window = window(polygons, camera);
        let [columns, rows] = self.window.each_ref().map(|range| range.len());
        self.pixels.resize(columns * rows);
        if columns * rows == 0 {
            return;
        }
        let camera = subpixel_camera(camera, &self.window, SUBPIXELS)
            .or_else(|_| subpixel_camera(camera, &self.window, 1));
        match &camera {
            Ok(camera) => self.draw_subpixels(polygons, camera),
            Err(_) => self.subpixels.resize(0),
        }
        self.resolve(
            columns,
            camera.map_or(1, |camera| camera.width() as usize / columns),
        );
    }

    fn draw_subpixels(&mut self, polygons: &[Polygons], camera: &Camera) {
        let groups = [GroupWindow {
            group: 0,
            window: None,
        }];
        let view = RasterView {
            groups: &groups,
            markers: &[],
            exposure: 1.0,
            tone: ToneMap::SrgbClipped,
            hole_color_srgb: [0; 3],
        };
        for (number, polygons) in polygons.iter().enumerate() {
            self.rasterizer
                .draw(&polygons.mesh, camera, &view, &Environment::default());
            let drawn = self.rasterizer.output_mut();
            convert_tone(polygons.tone, &mut drawn.frame.color);
            if number == 0 {
                std::mem::swap(&mut self.subpixels.colors, &mut drawn.frame.color);
                std::mem::swap(&mut self.subpixels.inverse_depth, &mut drawn.inverse_depth);
                continue;
            }
            let theirs = drawn.frame.color.par_iter().zip(&drawn.inverse_depth);
            let ours = self
                .subpixels
                .colors
                .par_iter_mut()
                .zip(&mut self.subpixels.inverse_depth);
            ours.zip(theirs)
                .with_min_len(MIN_PIXELS_PER_THREAD)
                .for_each(|((color, depth), (their_color, their_depth))| {
                    if their_depth > depth {
                        (*color, *depth) = (*their_color, *their_depth);
                    }
                });
        }
    }

    /// Resolves subpixels to pixels: the mean colour of the covered ones in linear light, their
    /// number as coverage, and the depth of the nearest.
    fn resolve(&mut self, columns: usize, factor: usize) {
        let light = LinearLight::tables();
        let SubpixelImage {
            colors,
            inverse_depth,
        } = &self.subpixels;
        let stride = columns * factor;
        let rows = self
            .pixels
            .colors
            .par_chunks_mut(columns)
            .zip(self.pixels.inverse_depth.par_chunks_mut(columns));
        rows.enumerate()
            .with_min_len(MIN_PIXELS_PER_THREAD / columns + 1)
            .for_each(|(row, (to_colors, to_depths))| {
                for (column, (color, depth)) in to_colors.iter_mut().zip(to_depths).enumerate() {
                    let first = (row * stride + column) * factor;
                    let [right, below] = [factor - 1, (factor - 1) * stride];
                    let subpixel = |i: usize| Some((*colors.get(i)?, *inverse_depth.get(i)?));
                    let four = [first, first + right, first + below, first + below + right]
                        .map(|i| subpixel(i).unwrap_or_default());
                    (*color, *depth) = resolve_pixel(light, four);
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

/// Resolves the four subpixels of a pixel.
fn resolve_pixel(light: &LinearLight, subpixels: [([u8; 4], f32); 4]) -> ([u8; 4], f32) {
    let weights = subpixels.map(|(_, depth)| u32::from(depth > 0.0));
    let count: u32 = weights.iter().sum();
    if count == 0 {
        return ([0; 4], 0.0);
    }
    let [r, g, b] = light.mix(subpixels.map(|([r, g, b, _], _)| [r, g, b]), weights);
    let nearest = subpixels
        .iter()
        .fold(0.0, |nearest, (_, depth)| f32::max(nearest, *depth));
    (
        [r, g, b, (count * 255 / (SUBPIXELS * SUBPIXELS)) as u8],
        nearest,
    )
}

/// Returns the camera of a window with `factor` subpixels per pixel along each axis.
fn subpixel_camera(
    camera: &Camera,
    [columns, rows]: &[Range<u32>; 2],
    factor: u32,
) -> Result<Camera, CameraError> {
    let finer = |range: &Range<u32>| range.start * factor..range.end * factor;
    let focal_px = camera.focal_px() * f64::from(factor);
    // The size is that of the window; the principal point is relative to the corner of the frame.
    let whole = Camera::from_parts(camera.eye(), camera.world_from_eye(), focal_px, 1, 1)?;
    whole
        .with_principal_px(camera.principal_px().map(|px| px * f64::from(factor)))
        .cropped(finer(columns), finer(rows))
}

/// Returns the bounding rectangle of the polygons in a frame: columns and rows.
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
        // The conversion saturates; the margin covers the rasteriser's snapping of corners to
        // subpixels.
        let (start, end) = ((low[axis] - 1.0) as u32, (high[axis] + 2.0) as u32);
        start.min(sides[axis])..end.clamp(start.min(sides[axis]), sides[axis])
    })
}

/// Converts colours from clipped sRGB to a tone curve.
fn convert_tone(tone: ToneMap, colors: &mut [[u8; 4]]) {
    if tone == ToneMap::SrgbClipped {
        return;
    }
    let stored: [u8; 256] = std::array::from_fn(|level| tone.level(linear_from_srgb8(level as u8)));
    let colors = colors.par_iter_mut().with_min_len(MIN_PIXELS_PER_THREAD);
    colors.for_each(|[r, g, b, _]| {
        for c in [r, g, b] {
            *c = stored[usize::from(*c)];
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn frames_too_large_for_subpixels_show_polygons_too() {
        let scene = headbox_scenes::build("bump", 0).expect("built in");
        let [low, high] = scene.bounds();
        let (middle, away) = ((low + high) / 2.0, (high - low).length());
        let polygons = [Polygons::new(scene).expect("valid")];
        let shown = [[64, 4], [Camera::MAX_SIDE_PX, 4]].map(|size| {
            // The frame is as wide as it is far away, and the model fills it.
            let (eye, focal_px) = (middle + DVec3::Z * (away * 0.3), f64::from(size[0]));
            let camera = Camera::from_parts(eye, DMat3::IDENTITY, focal_px, size[0], size[1])
                .expect("valid");
            let mut raster = PolygonRaster::default();
            raster.draw(&polygons, &camera);
            assert!(
                raster.window[0].len() > size[0] as usize / 2,
                "{:?}",
                raster.window
            );
            let (layer, [width, height]) = (raster.layer(), size.map(|side| side as usize));
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
        assert_eq!(resolve_pixel(light, [nothing; 4]), ([0; 4], 0.0));
        assert_eq!(
            resolve_pixel(light, [white, nothing, nothing, white]),
            ([255, 255, 255, 127], 2.0)
        );
        assert_eq!(resolve_pixel(light, [black; 4]), ([0, 0, 0, 255], 3.0));
        let ([half, ..], nearest) = resolve_pixel(light, [white, black, black, white]);
        // Half of white's light is 188.
        assert!(half.abs_diff(188) <= 1 && nearest == 3.0, "{half}");
    }
}
