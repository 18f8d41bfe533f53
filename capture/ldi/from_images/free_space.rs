//! Free space of depth images: where an image sees a surface farther away, there is none.
//!
//! Depth images of one sensor disagree by more than their noise here and there. Each such sample
//! would become a layer of its own, in front of the surface that most images show, and many images
//! have many of them. A layer is dropped if more images see through it than show it (the visibility
//! consensus of Merrell et al., *Real-time visibility-based fusion of depth maps*, ICCV 2007).

use glam::DVec3;
use headbox_images::{Lens, LoadedView, Pose};

/// Minimum edge of a block, pixels.
const MIN_BLOCK: u32 = 3;

/// Maximum number of blocks along the longer side of a view.
const MAX_BLOCKS: u32 = 320;

/// The free space in front of the surfaces of a view, in blocks of pixels: at most 0.4 MB.
pub(super) struct FreeSpace {
    lens: Lens,
    pose: Pose,
    size_px: [u32; 2],
    /// Edge of a block, pixels.
    block_px: u32,
    /// Inverse depth, 1/m, of the nearest surface in each block and in the pixels around it:
    /// silhouettes differ by a pixel from image to image. Infinite where any depth is unknown.
    nearest: Vec<f32>,
}

impl FreeSpace {
    /// The free space of a view.
    pub(super) fn new(view: &LoadedView) -> Self {
        let [width, height] = view.size_px;
        let block_px = width.max(height).div_ceil(MAX_BLOCKS).max(MIN_BLOCK);
        let block = |column: u32, row: u32| {
            let around = |i: u32, end: u32| {
                (i * block_px).saturating_sub(1)..((i + 1) * block_px + 1).min(end)
            };
            let pixels =
                around(row, height).flat_map(|y| around(column, width).map(move |x| (x, y)));
            let inverse_depths =
                pixels.map(|(x, y)| view.depth_at(x, y).map_or(f32::INFINITY, |z| 1.0 / z));
            inverse_depths.fold(0.0, f32::max)
        };
        let columns = width.div_ceil(block_px);
        let nearest = (0..height.div_ceil(block_px))
            .flat_map(|row| (0..columns).map(move |column| (column, row)))
            .map(|(column, row)| block(column, row))
            .collect();
        Self {
            lens: view.lens,
            pose: view.pose,
            size_px: view.size_px,
            block_px,
            nearest,
        }
    }

    /// Returns true if the view shows a surface behind a world point, farther by more than
    /// `tolerance` of inverse depth, 1/m.
    pub(super) fn contains(&self, point: DVec3, tolerance: f32) -> bool {
        let [width, height] = self.size_px;
        let projected = self.lens.project(self.pose.to_eye(point), self.size_px);
        let inside = |[x, y, _]: &[f64; 3]| {
            (0.0..f64::from(width)).contains(x) && (0.0..f64::from(height)).contains(y)
        };
        projected.filter(inside).is_some_and(|[x, y, depth]| {
            let [column, row] = [x, y].map(|c| c as u32 / self.block_px);
            let block = row * width.div_ceil(self.block_px) + column;
            let nearest = self.nearest.get(block as usize);
            nearest.is_some_and(|nearest| nearest + tolerance < (1.0 / depth) as f32)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use headbox_fixtures::plane_view;

    /// Tolerance, 1/m.
    const TOLERANCE: f32 = 0.01;

    #[test]
    fn free_space_ends_at_the_nearest_surface_around() {
        // A view from the origin along -Z of a plane at Z = -3, with one nearer pixel and one
        // without depth.
        let mut view = plane_view(DVec3::ZERO, 3.0, [48, 36]);
        let space = FreeSpace::new(&view);
        let at = |x: f64, y: f64, depth: f64| {
            view.pose.to_world(view.lens.ray([x, y], [48, 36]) * depth)
        };
        let near = at(24.5, 18.5, 1.0);
        assert!(space.contains(near, TOLERANCE));
        assert!(!space.contains(near, 0.7), "within the tolerance: 1 - 1/3");
        assert!(
            !space.contains(at(24.5, 18.5, 2.95), TOLERANCE),
            "on the plane"
        );
        assert!(
            !space.contains(at(24.5, 18.5, 4.0), TOLERANCE),
            "behind the plane"
        );
        assert!(
            !space.contains(at(-0.5, 18.5, 1.0), TOLERANCE),
            "beside the view"
        );
        assert!(
            !space.contains(dvec3(0.0, 0.0, 1.0), TOLERANCE),
            "behind the eye"
        );
        let corners = [at(0.0, 0.0, 1.0), at(47.9, 35.9, 1.0)];
        assert!(
            corners
                .iter()
                .all(|corner| space.contains(*corner, TOLERANCE))
        );
        for depth in [1.0, f32::NAN] {
            view.depth[18 * 48 + 26] = depth;
            let space = FreeSpace::new(&view);
            assert!(
                !space.contains(near, TOLERANCE),
                "{depth} two pixels away, at a block's rim"
            );
            assert!(space.contains(near * 0.5, TOLERANCE) != depth.is_nan());
            view.depth[18 * 48 + 26] = 3.0;
        }
    }

    #[test]
    fn large_views_have_larger_blocks() {
        let size_px = [1000, 4];
        let view = plane_view(DVec3::ZERO, 3.0, size_px);
        let space = FreeSpace::new(&view);
        assert_eq!((space.block_px, space.nearest.len()), (4, 250));
        for x in [0.5, 500.5, 999.5] {
            let ray = view.lens.ray([x, 3.5], size_px);
            assert!(space.contains(view.pose.to_world(ray), TOLERANCE), "{x}");
        }
    }
}
