//! The same LDI with some of its segments, or with colours that tell something other than what was
//! captured. The renderer draws such an LDI like any other, so these overlays need nothing of it,
//! and show exactly what it would blend.

use crate::pack::{CubeLdi, PackedSegment, Plane, PlaneSet, PlaneTile, SegmentSide};
use headbox_core::cube_face::Face;
use headbox_core::view::Swatch;
use headbox_core::view::paint::{DISTINCT, distinct_color, swatch};
use std::sync::Arc;

/// Meaning of the colours of depth pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Captured colours.
    #[default]
    Captured,
    /// Distance from the centre of the headbox along the face's axis: red at the headbox to blue at
    /// infinity.
    Depth,
    /// Number of the layer in its segment, counted from the centre outward.
    Layer,
    /// Face.
    Face,
    /// Near or far segment.
    Segment,
    /// Primitive; for plane textures, the plane.
    Primitive,
}

impl Meaning {
    /// Legend of its colours.
    pub(super) fn legend(self) -> Vec<Swatch> {
        match self {
            Self::Captured => Vec::new(),
            Self::Depth => [1.0, 2.0, 8.0, 64.0, 1024.0]
                .map(|halves: f64| match halves {
                    1.0 => swatch(depth_color(1.0), "at the side of the headbox"),
                    _ => swatch(
                        depth_color(1.0 / halves),
                        &format!("{halves} times as far from its centre"),
                    ),
                })
                .to_vec(),
            Self::Layer => {
                let layers = DISTINCT
                    .into_iter()
                    .zip(0..)
                    .map(|(color, layer)| match layer {
                        0 => swatch(color, "layer 1, the nearest"),
                        7 => swatch(color, "layer 8; then again from the first"),
                        _ => swatch(color, &format!("layer {}", layer + 1)),
                    });
                layers.collect()
            }
            Self::Face => Face::ALL
                .map(|face| swatch(DISTINCT[face.index()], &format!("face {}", face.name())))
                .to_vec(),
            Self::Primitive => {
                let planes = ["pictures on planes,", "a colour", "for each", "plane"];
                let planes = planes
                    .into_iter()
                    .zip(0..)
                    .map(|(text, plane)| swatch(distinct_color(plane), text));
                [
                    swatch(INFINITY, "picture at infinity"),
                    swatch(SAMPLES, "layered depth pixels"),
                ]
                .into_iter()
                .chain(planes)
                .collect()
            }
            Self::Segment => vec![
                swatch(DISTINCT[1], "near segment"),
                swatch(DISTINCT[0], "far segment"),
            ],
        }
    }
}

/// Selection of parts of an LDI, and the meaning of their colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Variation {
    /// In the order of [`Face::ALL`].
    pub(super) faces: [bool; 6],
    /// Near and far segments.
    pub(super) near: bool,
    pub(super) far: bool,
    /// Pictures on planes.
    pub(super) planes: bool,
    pub(super) meaning: Meaning,
}

impl Variation {
    /// The LDI as it is.
    const PLAIN: Self = Self {
        faces: [true; 6],
        near: true,
        far: true,
        planes: true,
        meaning: Meaning::Captured,
    };

    fn shows(&self, segment: &PackedSegment) -> bool {
        self.faces[segment.face.index()]
            && if segment.side == SegmentSide::Near {
                self.near
            } else {
                self.far
            }
    }

    fn apply(&self, cube: &CubeLdi) -> CubeLdi {
        let mut segments: Vec<_> = cube
            .segments
            .iter()
            .filter(|s| self.shows(s))
            .cloned()
            .collect();
        segments
            .iter_mut()
            .for_each(|segment| recolor(segment, self.meaning, cube.info.half_size_m));
        CubeLdi {
            info: cube.info.clone(),
            face_size_px: cube.face_size_px,
            layout: cube.layout,
            segments,
            environment: cube.environment.clone(),
            planes: self.pictures(cube),
        }
    }

    /// The pictures on planes that are shown.
    fn pictures(&self, cube: &CubeLdi) -> PlaneSet {
        let from = &cube.planes;
        let mut shown = PlaneSet {
            planes: from.planes.clone(),
            samples: from.samples,
            ..PlaneSet::default()
        };
        let is_shown = |tile: &&PlaneTile| {
            self.planes && self.faces.get(usize::from(tile.face)) == Some(&true)
        };
        for tile in from.tiles.iter().filter(is_shown) {
            let first_texel = shown.texels.len() as u32;
            let plane = from
                .planes
                .get(tile.plane as usize)
                .copied()
                .unwrap_or_default();
            let picture = PlaneImage {
                tile,
                plane,
                face_px: cube.face_size_px,
                half_size_m: cube.info.half_size_m,
            };
            let texels = from.texels.get(tile.texel_range()).unwrap_or(&[]);
            shown.texels.extend(
                texels
                    .iter()
                    .enumerate()
                    .map(|(i, texel)| picture.recolor(i, *texel, self.meaning)),
            );
            shown.tiles.push(PlaneTile {
                first_texel,
                ..*tile
            });
        }
        shown.error_px = if shown.tiles.is_empty() {
            0.0
        } else {
            from.error_px
        };
        shown
    }
}

/// Variations of the LDI on the screen that were made last: one each for A and B.
#[derive(Default)]
pub(super) struct Variations(Vec<(Variation, Arc<CubeLdi>)>);

impl Variations {
    /// The LDI on the screen is another now.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// `cube` as `wanted` has it.
    pub(super) fn of(&mut self, cube: &Arc<CubeLdi>, wanted: &Variation) -> Arc<CubeLdi> {
        if *wanted == Variation::PLAIN {
            return Arc::clone(cube);
        }
        if let Some(i) = self.0.iter().position(|(made, _)| made == wanted) {
            return Arc::clone(&self.0[i].1);
        }
        self.0.truncate(1);
        self.0.insert(0, (*wanted, Arc::new(wanted.apply(cube))));
        Arc::clone(&self.0[0].1)
    }
}

/// Colour of what is drawn as pictures at infinity, where it stands for a primitive.
const INFINITY: [u8; 3] = [40, 70, 130];

/// Colour of layered depth pixels, where it stands for a primitive.
const SAMPLES: [u8; 3] = [235, 235, 235];

/// A picture on a plane whose colours are to tell something else.
struct PlaneImage<'a> {
    tile: &'a PlaneTile,
    plane: Plane,
    face_px: u32,
    half_size_m: f64,
}

impl PlaneImage<'_> {
    fn recolor(&self, texel: usize, color: [u8; 4], meaning: Meaning) -> [u8; 4] {
        let [r, g, b] = match meaning {
            Meaning::Captured => return color,
            Meaning::Face => DISTINCT[usize::from(self.tile.face) % DISTINCT.len()],
            Meaning::Primitive if self.plane == Plane::default() => INFINITY,
            Meaning::Primitive => distinct_color(self.tile.plane),
            Meaning::Depth => depth_color(self.inverse_depth(texel) * self.half_size_m),
            // Pictures have neither segments nor layers.
            Meaning::Segment | Meaning::Layer => SAMPLES,
        };
        PlaneSet::covered([r, g, b, color[3]])
    }

    /// 1/m, in the middle of a texel.
    fn inverse_depth(&self, texel: usize) -> f64 {
        let Some(face) = Face::ALL.get(usize::from(self.tile.face)) else {
            return 0.0;
        };
        let [q, along_x, along_y] = self.plane.inverse_depth(*face, self.face_px);
        let width = usize::from(self.tile.width.max(1));
        let (x, y) = (
            f64::from(self.tile.x0) + (texel % width) as f64,
            f64::from(self.tile.y0) + (texel / width) as f64,
        );
        q + along_x * (x + 0.5) + along_y * (y + 0.5)
    }
}

/// Gives the depth pixels of a segment colours of another meaning; what shows through them is left
/// as it is.
fn recolor(segment: &mut PackedSegment, meaning: Meaning, half_size_m: f64) {
    match meaning {
        Meaning::Captured => {}
        Meaning::Face => {
            let color = DISTINCT[segment.face.index()];
            segment
                .depth_pixels
                .iter_mut()
                .for_each(|p| paint(&mut p.color_srgb, color));
        }
        Meaning::Segment => {
            let color = DISTINCT[usize::from(segment.side == SegmentSide::Near)];
            segment
                .depth_pixels
                .iter_mut()
                .for_each(|p| paint(&mut p.color_srgb, color));
        }
        Meaning::Primitive => segment
            .depth_pixels
            .iter_mut()
            .for_each(|p| paint(&mut p.color_srgb, SAMPLES)),
        Meaning::Depth => {
            let (start, step) = (segment.inverse_depth(0), segment.inverse_depth_step());
            for pixel in &mut segment.depth_pixels {
                let inverse_depth = start + f64::from(pixel.inverse_depth_code()) * step;
                paint(
                    &mut pixel.color_srgb,
                    depth_color(inverse_depth * half_size_m),
                );
            }
        }
        Meaning::Layer => {
            let colors = layer_colors(segment);
            segment
                .depth_pixels
                .iter_mut()
                .zip(colors)
                .for_each(|(p, color)| paint(&mut p.color_srgb, color));
        }
    }
}

fn paint(color_srgb: &mut [u8; 4], [r, g, b]: [u8; 3]) {
    *color_srgb = [r, g, b, color_srgb[3]];
}

/// The colour of the layer of each depth pixel, the nearest of a pixel being layer 0.
fn layer_colors(segment: &PackedSegment) -> Vec<[u8; 3]> {
    let mut colors = Vec::with_capacity(segment.depth_pixels.len());
    for y in 0..segment.height {
        for ends in segment.row(y).1.windows(2) {
            let layers = ends[1].saturating_sub(ends[0]);
            // Farthest first in memory.
            colors.extend(
                (0..layers)
                    .rev()
                    .map(|layer| DISTINCT[layer as usize % DISTINCT.len()]),
            );
        }
    }
    colors
}

/// Half size over depth, 0 to 1, as a colour from blue (infinity) by green to red (at the headbox).
/// The fourth root spreads out the distances that fill most scenes.
fn depth_color(nearness: f64) -> [u8; 3] {
    let t = nearness.clamp(0.0, 1.0).sqrt().sqrt();
    // Peaks at 1/4, 1/2 and 3/4 as in the "jet" map, but never darker than a third, so that shapes
    // stay visible.
    let channel = |peak: f64| ((1.5 - (4.0 * t - 4.0 * peak).abs()).clamp(0.12, 1.0) * 255.0) as u8;
    [channel(0.75), channel(0.5), channel(0.25)]
}

/// Names of the faces for controls, in the order of [`Face::ALL`].
pub(super) const FACE_NAMES: [(&str, &str); 6] = [
    ("face+x", "+X"),
    ("face-x", "-X"),
    ("face+y", "+Y"),
    ("face-y", "-Y"),
    ("face+z", "+Z"),
    ("face-z", "-Z"),
];

const _: () = assert!(FACE_NAMES.len() == Face::ALL.len(), "a name each");

#[cfg(test)]
mod tests {
    use super::super::tests::cube;
    use super::*;

    #[test]
    fn variations_are_valid_ldis() {
        let cube = cube();
        for meaning in [
            Meaning::Depth,
            Meaning::Layer,
            Meaning::Face,
            Meaning::Segment,
            Meaning::Primitive,
        ] {
            let other = Variation {
                meaning,
                ..Variation::PLAIN
            }
            .apply(&cube);
            other.validate().unwrap();
            assert_eq!(other.depth_pixel_count(), cube.depth_pixel_count());
            for (a, b) in cube.segments.iter().zip(&other.segments) {
                for (a, b) in a.depth_pixels.iter().zip(&b.depth_pixels) {
                    assert_eq!(
                        (a.geometry, a.color_srgb[3]),
                        (b.geometry, b.color_srgb[3]),
                        "{meaning:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_nearest_depth_pixel_of_a_pixel_is_layer_0() {
        let cube = cube();
        let layers = Variation {
            meaning: Meaning::Layer,
            ..Variation::PLAIN
        }
        .apply(&cube);
        let mut deepest = 0;
        for segment in &layers.segments {
            for (x, y) in (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y)))
            {
                for (layer, depth_pixel) in segment.pixel(x, y).iter().rev().enumerate() {
                    assert_eq!(
                        depth_pixel.color_srgb[..3],
                        DISTINCT[layer % DISTINCT.len()]
                    );
                    deepest = deepest.max(layer);
                }
            }
        }
        assert!(deepest > 0, "the scene has more than one layer");
    }

    #[test]
    fn variations_omit_parts_and_cache_two() {
        let cube = cube();
        let mut variations = Variations::default();
        let without = |face: usize| {
            let mut faces = [true; 6];
            faces[face] = false;
            Variation {
                faces,
                ..Variation::PLAIN
            }
        };
        assert!(
            Arc::ptr_eq(&cube, &variations.of(&cube, &Variation::PLAIN)),
            "nothing is copied for nothing"
        );
        let a = variations.of(&cube, &without(5));
        assert!(
            a.segments.iter().all(|s| s.face != Face::NegZ)
                && a.segments.len() < cube.segments.len()
        );
        let b = variations.of(
            &cube,
            &Variation {
                near: false,
                far: false,
                ..Variation::PLAIN
            },
        );
        assert!(b.segments.is_empty());
        assert!(Arc::ptr_eq(&a, &variations.of(&cube, &without(5))));
        variations.clear();
        assert!(!Arc::ptr_eq(&a, &variations.of(&cube, &without(5))));
    }
}
