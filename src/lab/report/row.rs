//! Data of a report: rows, and the conditions under which they were measured.

use super::rival::RivalRows;
use crate::machine::Machine;
use crate::plan::EyeSet;
use headbox_core::metrics::infinite_as_null;
use serde::{Deserialize, Serialize};

/// One setting of one representation of one scene, measured. Rows of one `group` differ in one
/// thing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The scene.
    pub scene: String,
    /// Subject of the group's comparison.
    pub group: String,
    /// The setting.
    pub variant: String,
    /// True for the row that the others of the group are compared with.
    pub baseline: bool,
    /// True if the variant traces the scene itself, as truth does.
    pub traces: bool,
    /// Set of eyes.
    pub eyes: EyeSet,
    /// Threads that drew.
    pub threads: usize,
    /// Milliseconds per frame: median over eyes and rounds.
    pub ms_median: f64,
    /// First and third quartile.
    pub ms_quartiles: [f64; 2],
    /// Median over eyes of this row's time over the group's baseline's, each the least of the
    /// rounds that were drawn in turns.
    pub time_ratio: f64,
    /// Depth pixels that a frame has to look at (of a clipped LDI, those that clipping against the
    /// whole frame leaves), each counted once, mean per frame; 0 where there are none.
    pub depth_pixels_in: f64,
    /// Depth pixels in, millions per second of the median frame.
    pub depth_pixels_m_per_s: f64,
    /// Bytes in memory that drawing needs.
    pub bytes: u64,
    /// Depth pixels in all.
    pub depth_pixels: u64,
    /// Seconds to make it, if it had to be made.
    pub capture_s: Option<f64>,
    /// Rays traced to make it.
    pub rays: Option<u64>,
    /// Mean FLIP.
    pub flip: f64,
    /// PSNR of all eyes' frames taken as one, dB.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
    /// The same without what the noise of truth adds to the mean squared error (see
    /// [`headbox_core::metrics::own_error`]); `None` where nothing is left that is more than
    /// chance.
    #[serde(default)]
    pub own_psnr_db: Option<f64>,
    /// Mean SSIM.
    pub ssim: f64,
    /// Share of pixels that show nothing, or the environment where truth shows geometry alone;
    /// `None` where the renderer does not tell.
    pub hole_fraction: Option<f64>,
    /// The eye with the largest FLIP.
    pub worst: WorstFrame,
    /// Root mean square, over channels 0..=1, of how the error changes between neighbouring frames
    /// of a smooth path.
    pub flicker: Option<f64>,
    /// PSNR of this row's frames against those of the group's baseline, dB; infinite if they are
    /// equal.
    #[serde(with = "infinite_as_null")]
    pub psnr_to_baseline_db: f64,
    /// Error as the eye goes from the centre to a corner.
    pub displacement: Vec<DisplacementError>,
}

/// The frame with the largest error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorstFrame {
    /// Number of the eye in [`SceneFacts::eyes`].
    pub eye: usize,
    /// Its FLIP.
    pub flip: f64,
    /// Its PSNR, dB.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
}

/// Error at one place between the centre and a corner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisplacementError {
    /// Distance of the eye: 0 at the centre, 1 in the corner.
    pub share: f64,
    /// FLIP there.
    pub flip: f64,
    /// PSNR there, dB.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
}

/// One eye and its truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EyeRecord {
    /// `uniform`, `line` or `path`.
    pub place: String,
    /// Offset from the centre, in half-sizes of the headbox.
    pub offset: [f64; 3],
    /// Viewing direction, world axes.
    pub forward: [f64; 3],
    /// Rays per pixel of its truth.
    pub truth_samples: u32,
    /// Standard error of its truth as a PSNR, dB.
    #[serde(with = "infinite_as_null")]
    pub truth_psnr_db: f64,
}

/// Further facts about a scene and its default capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// The scene.
    pub scene: String,
    /// Triangles.
    pub triangles: usize,
    /// Bytes of vertices, triangles and texels: what drawing the geometry itself needs at least.
    pub scene_bytes: u64,
    /// Half of the headbox's edge, metres.
    pub half_size_m: f64,
    /// Pixels a side of a face.
    pub face_size_px: u32,
    /// Frames' size, pixels.
    pub frame_px: [u32; 2],
    /// Occupied pixels, and samples behind the first, second and third: layers 1, 2, 3 and 4 and
    /// more.
    pub layers: [u64; 4],
    /// Share of depth pixels in near segments.
    pub near_share: f64,
    /// Rays traced for each depth pixel kept.
    pub rays_per_depth_pixel: f64,
    /// The eyes, in the order in which they were drawn; a path's last.
    pub eyes: Vec<EyeRecord>,
    /// By how much the standard error of truth, over the eyes of a row, lies below the row's error:
    /// the least of all rows that do not trace, dB.
    #[serde(with = "infinite_as_null")]
    pub margin_db: f64,
    /// Flicker that the noise of truth alone may cause, at most: where a row's is not well above
    /// it, it says nothing.
    pub truth_flicker: f64,
    /// Frames beside Embree's primary rays, where it was there.
    #[serde(default)]
    pub rival: Option<RivalRows>,
}

impl SceneFacts {
    /// The eyes that errors are measured from; those of a path are for how frames change along it.
    pub(super) fn judged_eyes(&self) -> impl Iterator<Item = &EyeRecord> + Clone {
        self.eyes.iter().filter(|eye| eye.place != "path")
    }

    /// Depth pixels over occupied pixels.
    pub fn depth_complexity(&self) -> f64 {
        self.layers.iter().sum::<u64>() as f64 / self.layers[0].max(1) as f64
    }
}

/// All of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of this format.
    pub version: u32,
    /// Machine of the measurement.
    pub machine: Machine,
    /// The commit of the program, with `+` if its sources had been changed; `unknown` if there is
    /// no telling.
    pub commit: String,
    /// Version of the program.
    pub program: String,
    /// The seed of eyes and captures.
    pub seed: u64,
    /// True for small sizes.
    pub quick: bool,
    /// True for real sizes.
    #[serde(default)]
    pub real: bool,
    /// One entry for each scene.
    pub scenes: Vec<SceneFacts>,
    /// The rows, scene after scene, group after group.
    pub rows: Vec<Row>,
}

impl Report {
    /// The version that this program writes and reads.
    pub const VERSION: u32 = 1;

    /// Takes over the scenes of an earlier report, if that was made alike.
    pub fn resume(&mut self, earlier: Option<Self>) {
        let same = |earlier: &Self| {
            let about = |r: &Self| {
                (
                    r.commit.clone(),
                    r.seed,
                    r.quick,
                    r.real,
                    r.machine.threads,
                    r.machine.simd.clone(),
                )
            };
            about(earlier) == about(self)
                && !earlier.commit.ends_with('+')
                && earlier.commit != "unknown"
        };
        if let Some(earlier) = earlier.filter(same) {
            (self.scenes, self.rows) = (earlier.scenes, earlier.rows);
        }
    }

    /// The rows of a scene's group.
    pub fn group<'a>(&'a self, scene: &'a str, group: &'a str) -> impl Iterator<Item = &'a Row> {
        self.rows
            .iter()
            .filter(move |row| row.scene == scene && row.group == group)
    }

    /// A row.
    pub fn find(&self, scene: &str, group: &str, variant: &str) -> Option<&Row> {
        self.rows
            .iter()
            .find(|row| row.scene == scene && row.group == group && row.variant == variant)
    }

    /// The groups of a scene, in order.
    pub fn groups(&self, scene: &str) -> Vec<&str> {
        let mut groups: Vec<&str> = Vec::new();
        for row in self.rows.iter().filter(|row| row.scene == scene) {
            if !groups.contains(&row.group.as_str()) {
                groups.push(&row.group);
            }
        }
        groups
    }

    /// The rows as comma-separated values, a header first.
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

/// A cell that may hold commas.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// The rows that do not trace and are within 10 % of the least error of such.
fn exact<'a>(rows: &[&'a Row]) -> impl Iterator<Item = &'a Row> {
    let drawn = || rows.iter().copied().filter(|row| !row.traces);
    let least = drawn().map(|row| row.flip).fold(f64::INFINITY, f64::min);
    drawn().filter(move |row| row.flip <= least * 1.1)
}

/// Recommended row: the fastest of the exact rows.
pub(super) fn chosen<'a>(rows: &[&'a Row]) -> Option<&'a Row> {
    exact(rows).min_by(|a, b| a.ms_median.total_cmp(&b.ms_median))
}

/// Recommended row where memory is scarce: the smallest of the exact rows, of equals the fastest.
pub(super) fn smallest<'a>(rows: &[&'a Row]) -> Option<&'a Row> {
    exact(rows).min_by(|a, b| {
        a.bytes
            .cmp(&b.bytes)
            .then(a.ms_median.total_cmp(&b.ms_median))
    })
}
