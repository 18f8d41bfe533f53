//! Assignment of the grid's nodes to cameras (E9): each to the best ranked camera that sees it.
//!
//! Where samples are dense, a sample's own camera is a good owner. But a camera's samples reach
//! only part of the nodes, and those of the next camera others, so that most triangles would be
//! textured by several cameras although the best one sees all of them. In the paper the best camera
//! supplies most of the texture (C27); here it does so wherever its own depth agrees.

use super::fuse::{Grid, NO_OWNER};
use super::texture_camera::TextureCamera;
use headbox_core::image::triangle_scan::SUBPIXELS;
use rayon::prelude::*;

/// Minimum number of nodes per parallel task.
const NODES: usize = 1024;

/// Assigns each node with a sample to the best ranked camera that sees it. Only cameras better than
/// the sample's own are tested.
pub(super) fn assign(grid: &mut Grid, cameras: &[TextureCamera]) {
    let positions = grid.x.par_iter().zip(&grid.y);
    let nodes = grid.owner.par_iter_mut().zip(positions);
    nodes
        .zip(&grid.inverse_depth)
        .with_min_len(NODES)
        .filter(|((owner, _), _)| **owner != NO_OWNER)
        .for_each(|((owner, (&x, &y)), &inverse_depth)| {
            let at = [x, y].map(|subpixels| subpixels as f32 / SUBPIXELS as f32);
            let better = cameras
                .iter()
                .zip(0..*owner)
                .find(|(camera, _)| camera.agrees(at, inverse_depth));
            if let Some((_, rank)) = better {
                *owner = rank;
            }
        });
}

#[cfg(test)]
mod tests {
    pub(crate) use crate::view_geometry::tests::{frame_at, grid, make_view, opened, plane_view};
    use crate::view_geometry::{
        GeometryRenderer, GeometrySettings, PixelTriangle, SampleGrid, ViewGeometry, WaitPolicy,
    };
    use glam::DVec3;

    fn shown(
        geometry: &ViewGeometry,
        settings: &GeometrySettings,
    ) -> (Vec<u32>, Vec<Option<PixelTriangle>>) {
        let mut renderer = GeometryRenderer::new();
        // Finer than samples are, so that nodes are filled by several cameras.
        let settings = GeometrySettings {
            grid_px: 2.0,
            ..*settings
        };
        renderer.render(
            geometry,
            &frame_at(DVec3::ZERO, [96, 72]),
            &settings,
            WaitPolicy::Wait,
        );
        (renderer.used().to_vec(), renderer.shown())
    }

    #[test]
    fn best_camera_owns_visible_nodes() {
        // Samples are three pixels apart, of other cameras one and two further on.
        let views = [[0.0, 0.0], [-0.04, 0.04], [0.08, -0.08]];
        let views = views.map(|[x, y]| plane_view(DVec3::new(x + 0.005, y, 0.0), 3.0, [96, 72]));
        let (_folder, geometry) = opened(&views, &SampleGrid::default());
        let by_sample = GeometrySettings {
            by_sight: false,
            ..GeometrySettings::default()
        };
        let share_of_best = |settings: &GeometrySettings| {
            let (used, shown) = shown(&geometry, settings);
            let is_best = |shown: &&PixelTriangle| shown.camera == used[0] && shown.owners == 1;
            shown.iter().flatten().filter(is_best).count() as f64
                / shown.iter().flatten().count() as f64
        };
        let [sampled, seen] =
            [by_sample, GeometrySettings::default()].map(|settings| share_of_best(&settings));
        assert!(sampled < 0.6 && seen > 0.93, "{sampled} {seen}");
    }

    #[test]
    fn best_camera_owns_no_occluded_nodes() {
        // A post a metre away hides part of a wall three metres away, from each place another part.
        let eyes = [0.12, -0.6];
        let size = [96, 72];
        let views = eyes.map(|x| {
            let ray = |column: u32| {
                (f64::from(column) + 0.5 - 48.0) / frame_at(DVec3::ZERO, size).focal_px()
            };
            let depth = move |column: u32, _: u32| {
                if (x + ray(column)).abs() < 0.12 {
                    1.0
                } else {
                    3.0
                }
            };
            make_view(DVec3::new(x, 0.0, 0.0), depth, |_, _| [90; 3], size)
        });
        let (_folder, geometry) = opened(&views, &grid(2, 3));
        let (used, shown) = shown(&geometry, &GeometrySettings::default());
        assert_eq!(used[0], 0);
        let row = &shown[36 * 96..37 * 96];
        // Left of the post, which lies 0.12 m to each side of the middle, the wall is hidden from
        // an eye that is further right.
        let focal = frame_at(DVec3::ZERO, size).focal_px();
        let at = |x: f64, depth: f64| (48.0 + x / depth * focal) as usize;
        let hidden_until = at(-0.12, 1.0) - 2;
        let hidden_from = at(0.12 + (-0.12 - 0.12) * 3.0, 3.0) + 2;
        assert!(
            hidden_until > hidden_from + 1,
            "{hidden_from} {hidden_until}"
        );
        for column in hidden_from..hidden_until {
            assert!(
                row[column].is_none_or(|shown| shown.camera == 1),
                "{column}: {:?}",
                row[column]
            );
        }
        let of_best = row
            .iter()
            .flatten()
            .filter(|shown| shown.camera == 0)
            .count();
        assert!(of_best > 60, "{of_best}");
    }
}
