//! Points of one view that another view sees.

use crate::views::view::{LoadedView, MAX_DEPTH_M};

/// A point of a view where another view sees it.
pub(crate) struct SeenPoint {
    /// Column and row in the first view.
    pub(crate) pixel: [u32; 2],
    /// Position in the other view, pixels.
    pub(crate) position: [f64; 2],
    /// Depth of the surface that the other view has there, over the depth of the point.
    pub(crate) depth_ratio: f64,
}

/// Points of a view, and those of them that another view sees.
pub(crate) struct SeenPoints {
    /// Number of sampled points with known depth.
    pub(crate) points: usize,
    pub(crate) seen: Vec<SeenPoint>,
}

impl SeenPoints {
    /// Projects the pixels of `a` with known depth that lie `step` pixels apart into `b`, with the
    /// depth of both multiplied by `factor`. The background has no depth to multiply: it is left
    /// out unless `has_background`.
    pub(crate) fn new(
        a: &LoadedView,
        b: &LoadedView,
        step: [u32; 2],
        factor: f64,
        has_background: bool,
    ) -> Self {
        let mut points = 0;
        let mut seen = Vec::new();
        let is_used = |depth: &f32| has_background || *depth < MAX_DEPTH_M;
        let [columns, rows] = b.size_px.map(f64::from);
        for [x, y] in sampled_pixels(a.size_px, step) {
            let Some(depth) = a.depth_at(x, y).filter(is_used) else {
                continue;
            };
            points += 1;
            let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let ray = a.lens.ray(centre, a.size_px);
            let point = a.pose.to_world(ray * f64::from(depth) * factor);
            let Some([bx, by, expected]) = b.lens.project(b.pose.to_eye(point), b.size_px) else {
                continue;
            };
            if !(bx >= 0.0 && by >= 0.0 && bx < columns && by < rows) {
                continue;
            }
            if let Some(actual) = b.depth_at(bx as u32, by as u32).filter(is_used) {
                seen.push(SeenPoint {
                    pixel: [x, y],
                    position: [bx, by],
                    depth_ratio: f64::from(actual) * factor / expected,
                });
            }
        }
        Self { points, seen }
    }

    /// Returns the share of the points that the other view sees.
    pub(crate) fn overlap(&self) -> f64 {
        self.seen.len() as f64 / self.points.max(1) as f64
    }
}

impl SeenPoint {
    /// Returns the mean difference of the three colours, levels of 255; `None` where the other view
    /// is masked out.
    pub(crate) fn color_levels(&self, a: &LoadedView, b: &LoadedView) -> Option<f64> {
        let color = b.color_at(self.position)?;
        let [x, y] = self.pixel.map(|i| i as usize);
        let own = a.color[y * a.size_px[0] as usize + x];
        let differences = (0..3).map(|c| (color[c] - f64::from(own[c])).abs());
        Some(differences.sum::<f64>() / 3.0)
    }
}

/// Returns the pixels that lie `step` columns and rows apart, row by row.
pub(crate) fn sampled_pixels(
    [width, height]: [u32; 2],
    step: [u32; 2],
) -> impl Iterator<Item = [u32; 2]> {
    let rows = (step[1] / 2..height).step_by(step[1] as usize);
    rows.flat_map(move |y| {
        let columns = (step[0] / 2..width).step_by(step[0] as usize);
        columns.map(move |x| [x, y])
    })
}

/// Returns the distance of pixels of which an image has about `samples` columns and rows.
pub(crate) fn sampling_step(size_px: [u32; 2], samples: u32) -> [u32; 2] {
    size_px.map(|side| side.div_ceil(samples).max(1))
}
