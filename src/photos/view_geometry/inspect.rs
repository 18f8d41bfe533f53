//! Inspection of the last frame, for overlays: the cameras that colour its pixels, its triangles,
//! and the number of cameras that see each point.

use super::{GeometryRenderer, ViewGeometry};
use crate::view_geometry::render::scan::{
    BAND_ROWS, BandBuffers, LANES, MOST_CAMERAS, OWNER_BITS, Pixels, Scanner, UNCOVERED,
};
use crate::view_geometry::render::texture_camera::TextureCamera;
use rayon::prelude::*;

/// Triangle in a pixel of the last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelTriangle {
    /// Index of the camera whose corners have the largest weight there.
    pub camera: u32,
    /// Number of cameras that own the triangle's corners.
    pub owners: u32,
    /// True on the rim of the triangle: the pixel to the right or below shows another one.
    pub on_rim: bool,
}

impl GeometryRenderer {
    /// Returns the triangle of each pixel of the last frame; `None` where there is none, which is
    /// everywhere in a frame of [`super::Texturing::Nearest`].
    pub fn shown(&self) -> Vec<Option<PixelTriangle>> {
        // Without images, the corners decide the side of a depth edge.
        let pixels = self.map_pixels(&[], |pixels, lane, _| self.triangle_at(pixels, lane));
        let triangle = |i: usize| pixels.get(i).map(|(triangle, _)| *triangle);
        let width = self.frame.width as usize;
        let on_rim = |i: usize| {
            let is_last = (i + 1).is_multiple_of(width);
            (!is_last && triangle(i + 1) != triangle(i))
                || triangle(i + width).is_some_and(|below| Some(below) != triangle(i))
        };
        (0..pixels.len())
            .map(|i| {
                pixels[i].1.map(|shown| PixelTriangle {
                    on_rim: on_rim(i),
                    ..shown
                })
            })
            .collect()
    }

    /// Returns, for each pixel, the number of the last frame's cameras that see the same point at
    /// the same depth; `None` where there is no triangle.
    pub fn seen_by(&self, geometry: &ViewGeometry) -> Vec<Option<u32>> {
        let textured = |&number: &u32| {
            let real = geometry.cameras.get(number as usize)?;
            let picture = geometry.pictures.peek(number)?;
            Some(TextureCamera::new(
                real,
                picture,
                self.camera.as_ref()?,
                &self.edge,
            ))
        };
        let cameras: Vec<TextureCamera> = self.used.iter().filter_map(textured).collect();
        self.map_pixels(&cameras, |pixels, lane, [x, y]| {
            let at = [x, y].map(|at| at as f32 + 0.5);
            let sees = |camera: &&TextureCamera| camera.agrees(at, pixels.inverse_depth[lane]);
            (pixels.owners[lane] != UNCOVERED).then(|| cameras.iter().filter(sees).count() as u32)
        })
    }

    /// Maps each pixel of the last frame, given the group of pixels that contains it, its lane in
    /// that group, and its column and row.
    fn map_pixels<T: Send>(
        &self,
        cameras: &[TextureCamera],
        map: impl Fn(&Pixels, usize, [u32; 2]) -> T + Sync,
    ) -> Vec<T> {
        let (width, height) = (self.frame.width, self.frame.height);
        let scanner = Scanner {
            grid: &self.grid,
            triangles: self.mesh.triangles(),
            bins: &self.bins,
            cameras,
            edge: &self.edge,
        };
        let band = |number: u32| {
            let rows = number * BAND_ROWS..((number + 1) * BAND_ROWS).min(height);
            let mut buffers = BandBuffers::default();
            scanner.rasterise(number, width, &rows, &mut buffers);
            let row = |(pixels, y): (&[Pixels], u32)| -> Vec<T> {
                (0..width)
                    .map(|x| map(&pixels[x as usize / LANES], x as usize % LANES, [x, y]))
                    .collect()
            };
            buffers
                .pixels
                .chunks(buffers.per_row.max(1))
                .zip(rows)
                .flat_map(row)
                .collect::<Vec<T>>()
        };
        let bands: Vec<Vec<T>> = (0..height.div_ceil(BAND_ROWS))
            .into_par_iter()
            .map(band)
            .collect();
        bands.into_iter().flatten().collect()
    }

    /// Returns the number of a pixel's triangle, and the triangle without its rim.
    fn triangle_at(&self, pixels: &Pixels, lane: usize) -> (u32, Option<PixelTriangle>) {
        let owners = pixels.owners[lane];
        if owners == UNCOVERED {
            return (UNCOVERED, None);
        }
        let ranks =
            [0, 1, 2].map(|corner| (owners >> (corner * OWNER_BITS)) as usize & MOST_CAMERAS);
        let weight = |rank: usize| -> f32 {
            (0..3)
                .filter(|k| ranks[*k] == rank)
                .map(|k| pixels.weights[k][lane])
                .sum()
        };
        let most = ranks
            .into_iter()
            .max_by(|a, b| weight(*a).total_cmp(&weight(*b)).then(b.cmp(a)));
        let count = 1
            + u32::from(ranks[1] != ranks[0])
            + u32::from(ranks[2] != ranks[0] && ranks[2] != ranks[1]);
        let camera = most.and_then(|rank| self.used.get(rank)).copied();
        (
            pixels.triangles[lane],
            camera.map(|camera| PixelTriangle {
                camera,
                owners: count,
                on_rim: false,
            }),
        )
    }
}

#[cfg(test)]
mod tests {
    pub(crate) use super::super::tests::{frame_at, grid, make_view, opened, plane_view};
    use super::super::{GeometrySettings, SampleGrid, Texturing, WaitPolicy};
    use super::*;
    use glam::DVec3;

    #[test]
    fn inspection_matches_frame() {
        let eyes = [-0.4, 0.0, 0.4].map(|x| DVec3::new(x, 0.0, 0.0));
        let views = eyes.map(|eye| plane_view(eye, 3.0, [96, 72]));
        let (_folder, mut geometry) = opened(&views, &SampleGrid::default());
        geometry.leave_out(&[1]);
        let camera = frame_at(DVec3::ZERO, [101, 71]);
        let mut renderer = GeometryRenderer::new();
        let settings = GeometrySettings {
            margin: 0.0,
            by_sight: false,
            ..GeometrySettings::default()
        };
        renderer.render(&geometry, &camera, &settings, WaitPolicy::Wait);
        let shown = renderer.shown();
        let covered = renderer
            .frame()
            .coverage
            .iter()
            .map(|coverage| !coverage.is_hole());
        assert!(
            shown.iter().map(Option::is_some).eq(covered),
            "the same pixels"
        );
        let count = |of: &dyn Fn(&PixelTriangle) -> bool| {
            shown.iter().flatten().filter(|shown| of(shown)).count()
        };
        assert_eq!(count(&|shown| shown.camera == 1), 0, "it was left out");
        assert!(
            [0, 2]
                .iter()
                .all(|camera| count(&|shown| shown.camera == *camera) > 500)
        );
        assert!(
            count(&|shown| shown.owners == 2) > 50
                && count(&|shown| !(1..=2).contains(&shown.owners)) == 0
        );
        let rims = count(&|shown| shown.on_rim);
        assert!(
            rims > 1000 && rims < shown.len() - 500,
            "{rims} of {}",
            shown.len()
        );
        assert_eq!(renderer.used().len(), 2);
        let pasted = GeometrySettings {
            texturing: Texturing::Nearest,
            ..settings
        };
        renderer.render(&geometry, &camera, &pasted, WaitPolicy::Wait);
        assert!(
            renderer.shown().iter().all(Option::is_none),
            "no triangle was drawn"
        );
    }

    #[test]
    fn visibility_counts_match_cameras() {
        let views = [-0.4, 0.4].map(|x| plane_view(DVec3::new(x, 0.0, 0.0), 3.0, [96, 72]));
        let (_folder, geometry) = opened(&views, &SampleGrid::default());
        let frame = frame_at(DVec3::ZERO, [101, 71]);
        let mut renderer = GeometryRenderer::new();
        assert!(renderer.seen_by(&geometry).is_empty(), "nothing was drawn");
        renderer.render(
            &geometry,
            &frame,
            &GeometrySettings::default(),
            WaitPolicy::Wait,
        );
        let seen = renderer.seen_by(&geometry);
        // Of the wall, 3 m away, each camera sees half of its width to either side of itself.
        let half_m = 1.5 * 96.0 / (0.8 * 96.0);
        let both = (half_m - 0.4) / 3.0 * frame.focal_px();
        for (x, count) in (0..101).zip(&seen[35 * 101..36 * 101]) {
            let off = (f64::from(x) + 0.5 - 50.5).abs();
            // At a picture's rim a texel more or less.
            if (off - both).abs() > 2.0 && off < 49.0 {
                assert_eq!(*count, Some(if off < both { 2 } else { 1 }), "{x}");
            }
        }
        let pasted = GeometrySettings {
            texturing: Texturing::Nearest,
            ..GeometrySettings::default()
        };
        renderer.render(&geometry, &frame, &pasted, WaitPolicy::Wait);
        assert!(
            renderer.seen_by(&geometry).iter().all(Option::is_none),
            "no triangle was drawn"
        );
    }

    #[test]
    fn cameras_whose_view_is_hidden_are_not_counted() {
        // A post a metre away hides a part of a wall three metres away from the left camera that
        // the right one sees.
        let size = [96, 72];
        let views = [-0.6, 0.0].map(|eye: f64| {
            let ray = |column: u32| {
                (f64::from(column) + 0.5 - 48.0) / frame_at(DVec3::ZERO, size).focal_px()
            };
            let depth = move |column: u32, _: u32| {
                if (eye + ray(column)).abs() < 0.12 {
                    1.0
                } else {
                    3.0
                }
            };
            make_view(DVec3::new(eye, 0.0, 0.0), depth, |_, _| [90; 3], size)
        });
        let (_folder, geometry) = opened(&views, &grid(2, 3));
        let frame = frame_at(DVec3::ZERO, size);
        let mut renderer = GeometryRenderer::new();
        renderer.render(
            &geometry,
            &frame,
            &GeometrySettings::default(),
            WaitPolicy::Wait,
        );
        let seen = renderer.seen_by(&geometry);
        // From the left the post hides the wall from 0.84 to 1.56 m right of the middle.
        let column = |x_m: f64| (48.0 + x_m / 3.0 * frame.focal_px()) as usize;
        let row = &seen[36 * 96..37 * 96];
        assert!(
            (column(0.84) + 2..column(1.56) - 1).all(|x| row[x] == Some(1)),
            "{row:?}"
        );
        assert!(
            (column(0.45) + 2..column(0.84) - 2).all(|x| row[x] == Some(2)),
            "{row:?}"
        );
    }
}
