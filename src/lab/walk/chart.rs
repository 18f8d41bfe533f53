//! Frame time along the path: figure 6 of R (R-N4), with primary rays beside it.

use super::WalkReport;
use crate::chart::{Axis, Chart, ChartPoint, Series};
use headbox_core::statistics::median;

/// Lines of the chart, where the ways are among those measured: geometry, then the figure's others,
/// then the default.
const LINES: [&str; 4] = ["geometry", "texture", "ldi", "window-ldi"];

/// Poses whose median is drawn, so that lines stay lines where other work disturbs a clock.
const SMOOTHED: usize = 5;

impl WalkReport {
    /// Frame time over the number of the pose.
    pub fn chart(&self) -> Chart {
        let rays = ("primary rays", self.primary_rays_along_path_ms.as_slice());
        let of_ways = LINES.iter().filter_map(|name| {
            let row = self.rows.iter().find(|row| row.name == *name)?;
            Some((row.name.as_str(), row.along_path_ms.as_slice()))
        });
        let lines = of_ways.chain([rays]).enumerate();
        let series = lines.map(|(color, (name, ms))| Series {
            name: name.into(),
            points: ms
                .iter()
                .enumerate()
                .map(|(pose, _)| point(ms, pose))
                .collect(),
            joined: true,
            hollow: false,
            color,
        });
        let [width, height] = self.size;
        Chart {
            title: format!("{}: frame time along the path", self.scene),
            note: format!(
                "Running median of {SMOOTHED} poses; {width}x{height}, {} threads",
                self.threads
            ),
            x: Axis {
                name: "pose".into(),
                is_logarithmic: false,
            },
            y: Axis {
                name: "time per frame, ms".into(),
                is_logarithmic: true,
            },
            series: series.collect(),
            front: Vec::new(),
        }
    }
}

/// The median about a pose.
fn point(ms: &[f64], pose: usize) -> ChartPoint {
    let around = &ms[pose.saturating_sub(SMOOTHED / 2)..ms.len().min(pose + SMOOTHED / 2 + 1)];
    let median = median(around.iter().copied()).unwrap_or(f64::NAN);
    ChartPoint {
        at: [pose as f64, median],
        name: String::new(),
        spread: None,
    }
}
