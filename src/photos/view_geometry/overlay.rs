//! Overlays of view-dependent geometry: the cameras that colour pixels, the mesh, the number of
//! cameras that see a point, and the age of images.

use super::{GeometryRenderer, PixelTriangle, ViewGeometry};
use headbox_core::view::Swatch;
use headbox_core::view::paint::{
    HOLE_RGB, NOTHING, Tops, class_color, class_legend, distinct_color, hole_legend, opaque,
    paint_holes, swatch, tinted,
};

/// Kind of overlay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GeometryOverlay {
    None,
    Holes,
    Coverage,
    Camera,
    Owners,
    Mesh,
    Age,
}

headbox_core::named_variants!(GeometryOverlay {
    None => "none",
    Holes => "holes",
    Coverage => "coverage",
    Camera => "camera",
    Owners => "owners",
    Mesh => "mesh",
    Age => "age",
});

impl GeometryOverlay {
    /// Paints the overlay over a copy of a renderer's last frame; returns the legend.
    pub(super) fn paint(
        self,
        geometry: &ViewGeometry,
        renderer: &GeometryRenderer,
        pixels: &mut [[u8; 4]],
    ) -> Vec<Swatch> {
        let frame = &renderer.frame().color;
        let frame_color = |i: usize| frame[i].first_chunk::<3>().copied().unwrap_or_default();
        match self {
            Self::None => Vec::new(),
            Self::Holes => {
                paint_holes(renderer.frame(), pixels);
                hole_legend()
            }
            Self::Coverage => {
                let seen = renderer
                    .seen_by(geometry)
                    .into_iter()
                    .zip(&renderer.frame().coverage);
                for (pixel, (seen, coverage)) in pixels.iter_mut().zip(seen) {
                    *pixel = match seen.unwrap_or(0) {
                        _ if coverage.is_hole() => opaque(HOLE_RGB),
                        0 => opaque(NOTHING),
                        cameras => opaque(class_color(cameras as f32, &CAMERAS)),
                    };
                }
                let classes = class_legend("no camera shows it there", &CAMERAS, "cameras see it");
                [hole_legend(), classes].concat()
            }
            Self::Camera => {
                let cameras = renderer.used().iter();
                let legend = cameras
                    .map(|camera| swatch(distinct_color(*camera), &geometry.pictures.name(*camera)))
                    .collect();
                paint(renderer, pixels, |i, shown| {
                    tinted(distinct_color(shown.camera), frame_color(i))
                });
                legend
            }
            Self::Owners => {
                paint(renderer, pixels, |_, shown| {
                    class_color(shown.owners as f32, &OWNERS)
                });
                class_legend("no triangle", &OWNERS, "cameras in a triangle")
            }
            Self::Mesh => {
                paint(renderer, pixels, |i, shown| {
                    if shown.on_rim {
                        RIM
                    } else {
                        tinted([128; 3], frame_color(i))
                    }
                });
                vec![swatch(RIM, "where triangles meet")]
            }
            Self::Age => {
                paint(renderer, pixels, |_, shown| {
                    geometry.pictures.age_s(shown.camera).map_or([0; 3], |age| {
                        class_color(age.max(f32::MIN_POSITIVE), &AGES_S)
                    })
                });
                class_legend("no picture", &AGES_S, "s since it was read")
            }
        }
    }
}

const RIM: [u8; 3] = [255, 230, 60];

/// Class limits for the number of cameras that own corners of a triangle: at most three.
const OWNERS: Tops = [1.0, 2.0, 3.0, 3.0, 3.0, 3.0];

/// Class limits for the number of cameras that see a point.
const CAMERAS: Tops = [1.0, 2.0, 3.0, 4.0, 6.0, 9.0];

/// Class limits for the time since an image was loaded, seconds.
const AGES_S: Tops = [0.1, 0.5, 2.0, 10.0, 60.0, 600.0];

/// Paints the pixels that show a triangle, the others black.
fn paint(
    renderer: &GeometryRenderer,
    pixels: &mut [[u8; 4]],
    color: impl Fn(usize, PixelTriangle) -> [u8; 3],
) {
    for (i, (pixel, shown)) in pixels.iter_mut().zip(renderer.shown()).enumerate() {
        *pixel = opaque(shown.map_or([0; 3], |shown| color(i, shown)));
    }
}
