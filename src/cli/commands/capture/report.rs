//! The report of a capture on standard output.

use super::CaptureCommand;
use crate::messages::{format_count, shell_quote};
use crate::output::{output_name, peak_rss_mb, print_json};
use crate::packing::describe_cube;
use crate::progress::duration;
use headbox_core::files;
use headbox_core::read_note::ReadNote;
use headbox_cube::model::info::Holes;
use headbox_cube::pack::CubeLdi;
use serde_json::json;

/// Times of a capture, seconds.
pub(super) struct CaptureTimes {
    pub(super) trace_s: f64,
    pub(super) total_s: f64,
    pub(super) estimated_s: f64,
    /// Times of the stages, as text.
    pub(super) stages: String,
}

impl CaptureCommand {
    /// Prints the result of a capture.
    pub(super) fn report(&self, cube: &CubeLdi, times: &CaptureTimes, notes: &[ReadNote]) {
        let rays = cube.info.rays_traced;
        let rays_per_s = rays as f64 / times.trace_s;
        let missing: Vec<f64> = cube
            .info
            .missing_estimate
            .iter()
            .flatten()
            .copied()
            .collect();
        let mean_missing =
            (!missing.is_empty()).then(|| missing.iter().sum::<f64>() / missing.len() as f64);
        if self.json {
            print_json(&json!({
                "rays": rays,
                "rays_per_s": rays_per_s,
                "trace_s": times.trace_s,
                "total_s": times.total_s,
                "peak_rss_mb": peak_rss_mb(),
                "depth_pixels": cube.depth_pixel_count(),
                "samples_on_planes": cube.planes.samples,
                "missing_estimate": mean_missing,
                "missing_estimate_per_face": cube.info.missing_estimate,
                "center": cube.info.frame.file_from_world(cube.info.centre),
                "half_size": cube.info.half_size_m / cube.info.frame.unit_m,
                "bytes": cube.bytes(),
                "blocked_share": cube.info.blocked_share,
                "estimated_s": times.estimated_s,
                "holes": cube.info.holes,
                "notes": notes,
            }));
            return;
        }
        println!(
            "{}: {} from {rays} rays",
            output_name(&self.output),
            describe_cube(cube)
        );
        let stages = if times.stages.is_empty() {
            String::new()
        } else {
            format!(": {}", times.stages)
        };
        println!(
            "  {} in all{stages}; {:.1} Mrays/s while tracing",
            duration(times.total_s),
            rays_per_s / 1e6
        );
        if let Some(missing) = mean_missing {
            println!(
                "  probability that the next ray finds a new sample: {:.1} %",
                missing * 100.0
            );
        }
        if let Some(holes) = cube.info.holes {
            println!(
                "  holes: {}",
                describe_search(&holes, self.quality.parameters.holes)
            );
        }
        if self.output.as_os_str() != files::STANDARD_OUTPUT {
            println!(
                "look at it: headbox render {} -o frame.png",
                shell_quote(&self.output)
            );
        }
    }
}

/// Describes the share of holes before rays were aimed at them, and the number of these rays.
pub(crate) fn describe_aimed_rays(holes: &Holes) -> String {
    let before = holes.share_before * 100.0;
    match holes.aimed_rays {
        0 => "no rays were aimed at holes".into(),
        1 => format!("{before:.3} % before 1 ray was aimed"),
        rays => format!("{before:.3} % before {rays} rays were aimed"),
    }
}

/// Describes the result of the search for holes.
fn describe_search(holes: &Holes, limit: f64) -> String {
    let [share, error] = [holes.share, holes.standard_error].map(|share| share * 100.0);
    let result = format!(
        "{share:.4} % of frame pixels (+- {error:.4} %), {}",
        describe_aimed_rays(holes)
    );
    if holes.share + holes.standard_error <= limit {
        result
    } else {
        let above = if holes.share > limit {
            "still above"
        } else {
            "with its uncertainty above"
        };
        format!(
            "{result}; {above} the limit of {} % after {}: more --rays or a smaller --half-size leave fewer",
            limit * 100.0,
            format_count(holes.rounds, "round")
        )
    }
}
