//! Chart of the frame time along the path: figure 6 of R (R-N4), with primary rays for comparison.

use super::WalkReport;
use crate::chart::{Axis, Chart, ChartPoint, Series};
use headbox_core::statistics::median;

/// Names of the variants drawn as lines, if measured: geometry, then the figure's others, then the
/// default.
const LINES: [&str; 4] = ["geometry", "texture", "ldi", "window-ldi"];

/// Window of the running median, poses. It removes spikes from other work on the machine.
const SMOOTHED: usize = 5;

impl WalkReport {
    /// Charts frame time over the number of the pose.
    pub fn chart(&self) -> Chart {
        let rays = ("primary rays", self.primary_rays_along_path_ms.as_slice());
        let variants = LINES.iter().filter_map(|name| {
            let row = self.rows.iter().find(|row| row.name == *name)?;
            Some((row.name.as_str(), row.along_path_ms.as_slice()))
        });
        let lines = variants.chain([rays]).enumerate();
        let series = lines.map(|(color, (name, ms))| {
            let points = (0..ms.len()).map(|pose| smoothed_point(ms, pose));
            Series::line(name, points.collect(), color)
        });
        let [width, height] = self.size;
        Chart {
            title: format!("{}: frame time along the path", self.scene),
            note: format!(
                "Running median of {SMOOTHED} poses; {width}x{height}, {} threads",
                self.threads
            ),
            x: Axis::linear("pose"),
            y: Axis::logarithmic("time per frame, ms"),
            series: series.collect(),
            front: Vec::new(),
        }
    }
}

/// Returns the median of the times around a pose.
fn smoothed_point(ms: &[f64], pose: usize) -> ChartPoint {
    let around = &ms[pose.saturating_sub(SMOOTHED / 2)..ms.len().min(pose + SMOOTHED / 2 + 1)];
    let median = median(around.iter().copied()).unwrap_or(f64::NAN);
    ChartPoint::new([pose as f64, median])
}
