//! Variations of an LDI: some of its segments, or false colours. The renderer draws a variation
//! like any LDI, so these overlays need no support in it, and show exactly what it blends.

use crate::pack::{
    CubeLdi, PackedDepthPixel, PackedSegment, Plane, PlaneSet, PlaneTile, SegmentSide,
};
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
    /// Index of the layer in its segment, from the centre outward.
    Layer,
    /// Face.
    Face,
    /// Near or far segment.
    Segment,
    /// Primitive; for plane textures, the plane.
    Primitive,
}

impl Meaning {
    /// Builds the legend of the colours.
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
    /// Plane textures.
    pub(super) planes: bool,
    pub(super) meaning: Meaning,
}

impl Variation {
    /// The unchanged LDI.
    const PLAIN: Self = Self {
        faces: [true; 6],
        near: true,
        far: true,
        planes: true,
        meaning: Meaning::Captured,
    };

    fn contains(&self, segment: &PackedSegment) -> bool {
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
            .filter(|s| self.contains(s))
            .cloned()
            .collect();
        segments
            .iter_mut()
            .for_each(|segment| recolor_segment(segment, self.meaning, cube.info.half_size_m));
        CubeLdi {
            info: cube.info.clone(),
            face_size_px: cube.face_size_px,
            layout: cube.layout,
            segments,
            environment: cube.environment.clone(),
            planes: self.plane_set(cube),
        }
    }

    /// Collects the plane textures of the variation.
    fn plane_set(&self, cube: &CubeLdi) -> PlaneSet {
        let source = &cube.planes;
        let mut set = PlaneSet {
            planes: source.planes.clone(),
            samples: source.samples,
            ..PlaneSet::default()
        };
        let is_shown = |tile: &&PlaneTile| {
            self.planes && self.faces.get(usize::from(tile.face)) == Some(&true)
        };
        for tile in source.tiles.iter().filter(is_shown) {
            let first_texel = set.texels.len() as u32;
            set.texels.extend(recolor_tile(cube, tile, self.meaning));
            set.tiles.push(PlaneTile {
                first_texel,
                ..*tile
            });
        }
        if !set.tiles.is_empty() {
            set.error_px = source.error_px;
        }
        set
    }
}

/// Cache of the last two variations of an LDI: one for each side of a comparison.
#[derive(Default)]
pub(super) struct Variations(Vec<(Variation, Arc<CubeLdi>)>);

impl Variations {
    /// Empties the cache, for another LDI.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Returns a variation of `cube`, from the cache if possible.
    pub(super) fn get(&mut self, cube: &Arc<CubeLdi>, wanted: &Variation) -> Arc<CubeLdi> {
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

/// Colour of plane textures at infinity in [`Meaning::Primitive`].
const INFINITY: [u8; 3] = [40, 70, 130];

/// Colour of layered depth pixels in [`Meaning::Primitive`].
const SAMPLES: [u8; 3] = [235, 235, 235];

/// Recolours the texels of a plane texture; alpha stays.
fn recolor_tile(cube: &CubeLdi, tile: &PlaneTile, meaning: Meaning) -> Vec<[u8; 4]> {
    let set = &cube.planes;
    let texels = set.texels.get(tile.texel_range()).unwrap_or(&[]);
    let plane = set.planes.get(tile.plane as usize).copied();
    let plane = plane.unwrap_or_default();
    let face = Face::ALL[usize::from(tile.face)];
    let [q, along_x, along_y] = plane.inverse_depth(face, cube.face_size_px);
    let width = usize::from(tile.width.max(1));
    let recolor = |(i, texel): (usize, &[u8; 4])| {
        let [r, g, b] = match meaning {
            Meaning::Captured => return *texel,
            Meaning::Face => DISTINCT[face.index()],
            Meaning::Primitive if plane == Plane::default() => INFINITY,
            Meaning::Primitive => distinct_color(tile.plane),
            Meaning::Depth => {
                let x = f64::from(tile.x0) + (i % width) as f64;
                let y = f64::from(tile.y0) + (i / width) as f64;
                let inverse_depth = q + along_x * (x + 0.5) + along_y * (y + 0.5);
                depth_color(inverse_depth * cube.info.half_size_m)
            }
            // Plane textures have neither segments nor layers.
            Meaning::Segment | Meaning::Layer => SAMPLES,
        };
        PlaneSet::covered([r, g, b, texel[3]])
    };
    texels.iter().enumerate().map(recolor).collect()
}

/// Recolours the depth pixels of a segment; alpha stays.
fn recolor_segment(segment: &mut PackedSegment, meaning: Meaning, half_size_m: f64) {
    let count = segment.depth_pixels.len();
    let colors = match meaning {
        Meaning::Captured => return,
        Meaning::Face => vec![DISTINCT[segment.face.index()]; count],
        Meaning::Segment => vec![DISTINCT[usize::from(segment.side == SegmentSide::Near)]; count],
        Meaning::Primitive => vec![SAMPLES; count],
        Meaning::Depth => {
            let nearness = |pixel: &PackedDepthPixel| {
                segment.inverse_depth(pixel.inverse_depth_code()) * half_size_m
            };
            let pixels = segment.depth_pixels.iter();
            pixels.map(|pixel| depth_color(nearness(pixel))).collect()
        }
        Meaning::Layer => layer_colors(segment),
    };
    for (pixel, [r, g, b]) in segment.depth_pixels.iter_mut().zip(colors) {
        pixel.color_srgb = [r, g, b, pixel.color_srgb[3]];
    }
}

/// Computes the colour of the layer of each depth pixel; layer 0 is the nearest of a pixel.
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

/// Maps half size over depth, 0 to 1, to a colour from blue (infinity) through green to red (at the
/// headbox). The fourth root expands the range of depths that most scenes contain.
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
    fn nearest_depth_pixel_is_layer_0() {
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
            Arc::ptr_eq(&cube, &variations.get(&cube, &Variation::PLAIN)),
            "nothing is copied for nothing"
        );
        let a = variations.get(&cube, &without(5));
        assert!(
            a.segments.iter().all(|s| s.face != Face::NegZ)
                && a.segments.len() < cube.segments.len()
        );
        let b = variations.get(
            &cube,
            &Variation {
                near: false,
                far: false,
                ..Variation::PLAIN
            },
        );
        assert!(b.segments.is_empty());
        assert!(Arc::ptr_eq(&a, &variations.get(&cube, &without(5))));
        variations.clear();
        assert!(!Arc::ptr_eq(&a, &variations.get(&cube, &without(5))));
    }
}
