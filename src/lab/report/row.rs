//! Data of a report: rows and the conditions of their measurement.

use super::rival::EmbreeComparison;
use crate::machine::Machine;
use crate::plan::EyeSet;
use headbox_core::metrics::infinite_as_null;
use serde::{Deserialize, Serialize};

/// Measured results of one setting of one representation of one scene. Rows of a `group` differ in
/// one parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the scene.
    pub scene: String,
    /// Name of the group: the compared parameter.
    pub group: String,
    /// Name of the setting.
    pub variant: String,
    /// True for the row that the others of the group are compared with.
    pub baseline: bool,
    /// True if the variant traces the scene itself, as truth does.
    pub traces: bool,
    /// Set of eyes.
    pub eyes: EyeSet,
    /// Number of threads of the renderer.
    pub threads: usize,
    /// Frame time, ms: median over eyes and rounds.
    pub ms_median: f64,
    /// First and third quartile of the frame time, ms.
    pub ms_quartiles: [f64; 2],
    /// Median over eyes of the ratio of this row's time to that of the group's baseline, each the
    /// least of the rounds, which were drawn in turns.
    pub time_ratio: f64,
    /// Mean number of depth pixels that a frame processes (after clipping against the whole frame),
    /// each counted once; 0 without depth pixels.
    pub depth_pixels_in: f64,
    /// Depth pixels processed, millions per second of the median frame.
    pub depth_pixels_m_per_s: f64,
    /// Memory that drawing needs, bytes.
    pub bytes: u64,
    /// Total number of depth pixels.
    pub depth_pixels: u64,
    /// Capture time, seconds; `None` for a given file.
    pub capture_s: Option<f64>,
    /// Number of rays traced by the capture.
    pub rays: Option<u64>,
    /// Mean FLIP.
    pub flip: f64,
    /// PSNR of the frames of all eyes taken as one, dB.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
    /// The same without the share of the noise of truth in the mean squared error (see
    /// [`headbox_core::metrics::own_error`]); `None` if the rest is not significant.
    #[serde(default)]
    pub own_psnr_db: Option<f64>,
    /// Mean SSIM.
    pub ssim: f64,
    /// Share of pixels that are holes, or show the environment where truth shows only geometry;
    /// `None` if the renderer does not report it.
    pub hole_fraction: Option<f64>,
    /// Frame with the largest FLIP.
    pub worst: WorstFrame,
    /// Root mean square change of the error between neighbouring frames of a smooth path, over
    /// channels 0..=1.
    pub flicker: Option<f64>,
    /// PSNR against the frames of the group's baseline, dB; infinite if they are equal.
    #[serde(with = "infinite_as_null")]
    pub psnr_to_baseline_db: f64,
    /// Errors on the line from the centre to a corner.
    pub displacement: Vec<DisplacementError>,
}

/// The frame with the largest error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WorstFrame {
    /// Index of the eye in [`SceneFacts::eyes`].
    pub eye: usize,
    /// FLIP of the frame.
    pub flip: f64,
    /// PSNR of the frame, dB.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
}

/// Error at one eye between the centre and a corner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisplacementError {
    /// Distance of the eye: 0 at the centre, 1 in the corner.
    pub share: f64,
    /// FLIP of the frame.
    pub flip: f64,
    /// PSNR of the frame, dB.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
}

/// One eye and its truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EyeRecord {
    /// Name of the place: `uniform`, `line`, `wall` or `path`.
    pub place: String,
    /// Offset from the centre, in half-sizes of the headbox.
    pub offset: [f64; 3],
    /// Viewing direction, world axes.
    pub forward: [f64; 3],
    /// Rays per pixel of truth.
    pub truth_samples: u32,
    /// Standard error of truth as a PSNR, dB.
    #[serde(with = "infinite_as_null")]
    pub truth_psnr_db: f64,
}

/// Facts about a scene and its default capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Name of the scene.
    pub scene: String,
    /// Number of triangles.
    pub triangles: usize,
    /// Size of vertices, triangles and texels, bytes: the least that drawing the geometry needs.
    pub scene_bytes: u64,
    /// Half of the headbox's edge, metres.
    pub half_size_m: f64,
    /// Edge of a face, px.
    pub face_size_px: u32,
    /// Size of the frames, px.
    pub frame_px: [u32; 2],
    /// Number of samples in layers 1, 2, 3, and 4 or more; layer 1 counts the occupied pixels.
    pub layers: [u64; 4],
    /// Share of depth pixels in near segments.
    pub near_share: f64,
    /// Rays traced per depth pixel.
    pub rays_per_depth_pixel: f64,
    /// Eyes in drawing order; those of the path are last.
    pub eyes: Vec<EyeRecord>,
    /// Distance of the standard error of truth, over the eyes of a row, below the row's error, dB:
    /// the least over all rows that do not trace.
    #[serde(with = "infinite_as_null")]
    pub margin_db: f64,
    /// Upper bound of the flicker caused by the noise of truth: a row's flicker is significant only
    /// well above it.
    pub truth_flicker: f64,
    /// Frame times against Embree's primary rays, if Embree is available.
    #[serde(default)]
    pub rival: Option<EmbreeComparison>,
}

impl SceneFacts {
    /// Iterates over the eyes at which errors are measured; those of the path serve flicker only.
    pub(super) fn error_eyes(&self) -> impl Iterator<Item = &EyeRecord> + Clone {
        self.eyes.iter().filter(|eye| eye.place != "path")
    }

    /// Formats the rays per pixel of truth as `least to most`, or as one number if they are equal.
    pub(super) fn truth_samples_range(&self) -> String {
        let samples = self.error_eyes().map(|eye| eye.truth_samples);
        let least = samples.clone().min().unwrap_or(0);
        let most = samples.max().unwrap_or(0);
        if least == most {
            most.to_string()
        } else {
            format!("{least} to {most}")
        }
    }

    /// Returns the share of samples in a layer.
    pub(super) fn layer_share(&self, layer: usize) -> f64 {
        self.layers[layer] as f64 / self.layers.iter().sum::<u64>().max(1) as f64
    }

    /// Returns the number of depth pixels per occupied pixel.
    pub fn depth_complexity(&self) -> f64 {
        self.layers.iter().sum::<u64>() as f64 / self.layers[0].max(1) as f64
    }
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of this format.
    pub version: u32,
    /// Machine of the measurement.
    pub machine: Machine,
    /// Commit of the program, see [`crate::machine::commit`].
    pub commit: String,
    /// Version of the program.
    pub program: String,
    /// Seed of eyes and captures.
    pub seed: u64,
    /// True for `--quick`.
    pub quick: bool,
    /// True for `--real`.
    #[serde(default)]
    pub real: bool,
    /// Facts about each scene.
    pub scenes: Vec<SceneFacts>,
    /// Rows by scene, then by group.
    pub rows: Vec<Row>,
}

impl Report {
    /// Version of the format that this program writes and reads.
    pub const VERSION: u32 = 1;

    /// Adopts the scenes of an earlier report, if it was made by the same commit with the same
    /// settings.
    pub fn resume(&mut self, earlier: Option<Self>) {
        let Some(earlier) = earlier else {
            return;
        };
        if earlier.commit == self.commit
            && earlier.seed == self.seed
            && earlier.quick == self.quick
            && earlier.real == self.real
            && earlier.machine.threads == self.machine.threads
            && earlier.machine.simd == self.machine.simd
            && !earlier.commit.ends_with('+')
            && earlier.commit != "unknown"
        {
            self.scenes = earlier.scenes;
            self.rows = earlier.rows;
        }
    }

    /// Returns the flag of the sizes on the command line, with a leading space, or "".
    pub(super) fn size_flag(&self) -> &'static str {
        if self.quick {
            " --quick"
        } else if self.real {
            " --real"
        } else {
            ""
        }
    }

    /// Iterates over the rows of a scene's group.
    pub fn group<'a>(&'a self, scene: &'a str, group: &'a str) -> impl Iterator<Item = &'a Row> {
        self.rows
            .iter()
            .filter(move |row| row.scene == scene && row.group == group)
    }

    /// Finds the first row of a scene's group that is its baseline, or that is not.
    pub(super) fn first(&self, scene: &str, group: &str, baseline: bool) -> Option<&Row> {
        self.rows
            .iter()
            .find(|row| row.scene == scene && row.group == group && row.baseline == baseline)
    }

    /// Returns the FLIP of a representation at the centre of the headbox and in a corner.
    pub(super) fn displacement_flip(&self, scene: &str, variant: &str) -> Option<[f64; 2]> {
        let line = &self.find(scene, "representation", variant)?.displacement;
        Some([line.first()?.flip, line.last()?.flip])
    }

    /// Finds a row.
    pub fn find(&self, scene: &str, group: &str, variant: &str) -> Option<&Row> {
        self.rows
            .iter()
            .find(|row| row.scene == scene && row.group == group && row.variant == variant)
    }

    /// Returns the groups of a scene in order.
    pub fn groups(&self, scene: &str) -> Vec<&str> {
        let mut groups: Vec<&str> = Vec::new();
        for row in self.rows.iter().filter(|row| row.scene == scene) {
            if !groups.contains(&row.group.as_str()) {
                groups.push(&row.group);
            }
        }
        groups
    }

    /// Formats the rows as comma-separated values with a header.
    pub fn to_csv(&self) -> String {
        let mut text = String::from(
            "scene,group,variant,baseline,eyes,threads,ms_median,ms_q1,ms_q3,time_ratio,depth_pixels_m_per_s,bytes,\
             depth_pixels,capture_s,rays,flip,psnr_db,own_psnr_db,ssim,hole_fraction,worst_eye,worst_flip,flicker,psnr_to_baseline_db\n",
        );
        let optional = |value: Option<f64>| value.map_or(String::new(), |v| v.to_string());
        for r in &self.rows {
            let cells = [
                quoted(&r.scene),
                quoted(&r.group),
                quoted(&r.variant),
                r.baseline.to_string(),
                r.eyes.name().into(),
                r.threads.to_string(),
                format!("{:.4}", r.ms_median),
                format!("{:.4}", r.ms_quartiles[0]),
                format!("{:.4}", r.ms_quartiles[1]),
                format!("{:.4}", r.time_ratio),
                format!("{:.3}", r.depth_pixels_m_per_s),
                r.bytes.to_string(),
                r.depth_pixels.to_string(),
                optional(r.capture_s),
                r.rays.map_or(String::new(), |v| v.to_string()),
                r.flip.to_string(),
                r.psnr_db.to_string(),
                optional(r.own_psnr_db),
                r.ssim.to_string(),
                optional(r.hole_fraction),
                r.worst.eye.to_string(),
                r.worst.flip.to_string(),
                optional(r.flicker),
                r.psnr_to_baseline_db.to_string(),
            ];
            text += &cells.join(",");
            text.push('\n');
        }
        text
    }
}

/// Quotes a CSV cell if necessary.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// Selects the exact rows: those that do not trace and are within 10 % of the least error of such.
fn exact<'a>(rows: &[&'a Row]) -> impl Iterator<Item = &'a Row> {
    let drawn = || rows.iter().copied().filter(|row| !row.traces);
    let least = drawn().map(|row| row.flip).fold(f64::INFINITY, f64::min);
    drawn().filter(move |row| row.flip <= least * 1.1)
}

/// Selects the recommended row: the fastest of the exact rows.
pub(super) fn chosen<'a>(rows: &[&'a Row]) -> Option<&'a Row> {
    exact(rows).min_by(|a, b| a.ms_median.total_cmp(&b.ms_median))
}

/// Selects the recommended row where memory is scarce: the smallest of the exact rows, of equals
/// the fastest.
pub(super) fn smallest<'a>(rows: &[&'a Row]) -> Option<&'a Row> {
    exact(rows).min_by(|a, b| {
        a.bytes
            .cmp(&b.bytes)
            .then(a.ms_median.total_cmp(&b.ms_median))
    })
}
