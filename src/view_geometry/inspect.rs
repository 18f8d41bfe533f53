//! How the last frame came about, for overlays: whose pictures its pixels show, where its triangles meet, how old its textures are.

use super::GeometryRenderer;
use super::scan::{BAND_ROWS, Described, LANES, MOST_CAMERAS, OWNER_BITS, Pixels, Scanner, UNCOVERED};
use rayon::prelude::*;

/// What a pixel of the last frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// The camera, an index into the set's, of the corners that weigh most there.
    pub camera: u32,
    /// Of how many cameras the triangle's corners are.
    pub owners: u32,
    /// Whether it lies on the rim of its triangle: the pixel right of it or below shows another.
    pub on_rim: bool,
}

impl GeometryRenderer {
    /// What each pixel of the last frame shows; `None` where no triangle is, so everywhere in a frame of
    /// [`super::Texturing::Nearest`], which has none.
    pub fn shown(&self) -> Vec<Option<Shown>> {
        let (width, height) = (self.frame.width, self.frame.height);
        // Without pictures, sides of depth edges are told by their corners.
        let Self { grid, mesh, bins, edge, .. } = self;
        let scanner = Scanner { grid, triangles: mesh.triangles(), bins, cameras: &[], edge };
        let band = |number: u32| {
            let rows = number * BAND_ROWS..((number + 1) * BAND_ROWS).min(height);
            let mut described = Described::default();
            scanner.describe(number, width, &rows, &mut described);
            let row = |pixels: &[Pixels]| -> Vec<(u32, Option<Shown>)> {
                (0..width as usize).map(|x| self.at(&pixels[x / LANES], x % LANES)).collect()
            };
            described.pixels.chunks(described.per_row.max(1)).flat_map(row).collect::<Vec<_>>()
        };
        let bands: Vec<_> = (0..height.div_ceil(BAND_ROWS)).into_par_iter().map(band).collect();
        let pixels = bands.concat();
        let triangle = |i: usize| pixels.get(i).map(|(triangle, _)| *triangle);
        let width = width as usize;
        let on_rim = |i: usize| {
            let is_last = (i + 1).is_multiple_of(width);
            (!is_last && triangle(i + 1) != triangle(i))
                || triangle(i + width).is_some_and(|below| Some(below) != triangle(i))
        };
        (0..pixels.len()).map(|i| pixels[i].1.map(|shown| Shown { on_rim: on_rim(i), ..shown })).collect()
    }

    /// The triangle of a pixel, and what it shows but for its rim.
    fn at(&self, pixels: &Pixels, lane: usize) -> (u32, Option<Shown>) {
        let owners = pixels.owners[lane];
        if owners == UNCOVERED {
            return (UNCOVERED, None);
        }
        let ranks = [0, 1, 2].map(|corner| (owners >> (corner * OWNER_BITS)) as usize & MOST_CAMERAS);
        let weight =
            |rank: usize| -> f32 { (0..3).filter(|k| ranks[*k] == rank).map(|k| pixels.weights[k][lane]).sum() };
        let most = ranks.into_iter().max_by(|a, b| weight(*a).total_cmp(&weight(*b)).then(b.cmp(a)));
        let count = 1 + u32::from(ranks[1] != ranks[0]) + u32::from(ranks[2] != ranks[0] && ranks[2] != ranks[1]);
        let camera = most.and_then(|rank| self.used.get(rank)).copied();
        (pixels.triangles[lane], camera.map(|camera| Shown { camera, owners: count, on_rim: false }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{frame_at, opened, plane_view};
    use super::super::{GeometrySettings, Patience, SampleGrid, Texturing};
    use super::*;
    use glam::DVec3;

    #[test]
    fn what_is_shown_is_what_was_drawn() {
        let eyes = [-0.4, 0.0, 0.4].map(|x| DVec3::new(x, 0.0, 0.0));
        let views = eyes.map(|eye| plane_view(eye, 3.0, [96, 72]));
        let (_folder, mut geometry) = opened(&views, &SampleGrid::default());
        geometry.leave_out(&[1]);
        let camera = frame_at(DVec3::ZERO, [101, 71]);
        let mut renderer = GeometryRenderer::new();
        let settings = GeometrySettings { margin: 0.0, by_sight: false, ..GeometrySettings::default() };
        renderer.render(&geometry, &camera, &settings, Patience::Wait);
        let shown = renderer.shown();
        let covered = renderer.frame().coverage.iter().map(|coverage| !coverage.is_hole());
        assert!(shown.iter().map(Option::is_some).eq(covered), "the same pixels");
        let count = |of: &dyn Fn(&Shown) -> bool| shown.iter().flatten().filter(|shown| of(shown)).count();
        assert_eq!(count(&|shown| shown.camera == 1), 0, "it was left out");
        assert!([0, 2].iter().all(|camera| count(&|shown| shown.camera == *camera) > 500));
        assert!(count(&|shown| shown.owners == 2) > 50 && count(&|shown| !(1..=2).contains(&shown.owners)) == 0);
        let rims = count(&|shown| shown.on_rim);
        assert!(rims > 1000 && rims < shown.len() - 500, "{rims} of {}", shown.len());
        assert_eq!(renderer.used().len(), 2);
        let pasted = GeometrySettings { texturing: Texturing::Nearest, ..settings };
        renderer.render(&geometry, &camera, &pasted, Patience::Wait);
        assert!(renderer.shown().iter().all(Option::is_none), "no triangle was drawn");
    }
}
