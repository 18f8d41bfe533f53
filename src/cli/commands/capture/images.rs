//! `headbox capture FOLDER`: cube LDIs from image sets.

use crate::args::{refuse_given, refuse_misplaced};
use crate::commands::capture::{CaptureCommand, Preset};
use crate::commands::images::SetJob;
use crate::output::{CUBE, Outputs, peak_rss_mb, print_json};
use crate::packing::describe_cube;
use crate::progress::Bar;
use anyhow::bail;
use headbox_images::View;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Name of image sets with depth in messages.
pub(super) const DEPTH: &str = "folders of images with depth";

/// Name of image sets without depth in messages.
pub(super) const PHOTOGRAPHS: &str = "folders of photographs without depth";

impl CaptureCommand {
    /// Warps the depth images of a set into one cube, or colours it by the photo-consistency of its
    /// photographs.
    pub(super) fn run_images(&self) -> anyhow::Result<()> {
        let start = Instant::now();
        self.refuse_scene_flags("images", self.deep_flags())?;
        Outputs::new(self.json, [self.scene.name()]).file(&self.output, &CUBE)?;
        let set = self.images.open_registered(Path::new(self.scene.name()))?;
        let mut job = SetJob::suggest(&set);
        if let Some(center) = self.headbox.center {
            *job.centre() = set.frame.world_from_file(center);
        }
        if let Some(half_size) = self.headbox.half_size {
            *job.half_size_m() = half_size * set.frame.unit_m;
        }
        match &mut job {
            SetJob::Depth(job) => {
                self.refuse_photograph_flags()?;
                let quality = self.quality.preset.quality;
                refuse_given(DEPTH, [("--quality", quality.is_some())])?;
                job.merge_rule = self.quality.parameters.merge_rule;
                job.depth_noise = self.depth_noise.unwrap_or(job.depth_noise);
            }
            SetJob::Photographs { job, reduction } => {
                refuse_misplaced(DEPTH, [self.depth_flag()])?;
                job.agreement = self.agreement.unwrap_or(job.agreement);
                job.backdrop = self.backdrop;
                let preset = self.quality.preset.quality.unwrap_or(Preset::Best);
                *reduction = preset.reduction();
            }
        }
        let bar = Bar::new();
        let views = job.views(&set);
        let ldi = job.run(&set, &bar)?;
        let mut packed = self.packing.pack(ldi)?;
        if packed.depth_pixel_count() == 0 && packed.planes.tiles.is_empty() {
            let why = match job {
                SetJob::Depth(_) => "no image has depth: all values are zero or not numbers",
                SetJob::Photographs { .. } => {
                    "the photographs agree on no surface; give a larger --agreement, or another --center"
                }
            };
            bail!("{}: {why}", set.folder.display());
        }
        packed.info.fov_y_deg = narrowest_fov(&views);
        packed.write(&self.output)?;
        bar.finish();
        let total_s = start.elapsed().as_secs_f64();
        let pixels: u64 = views
            .iter()
            .map(|view| u64::from(view.size_px[0]) * u64::from(view.size_px[1]))
            .sum();
        if self.json {
            print_json(&json!({
                "images": views.len(),
                "pixels": pixels,
                "total_s": total_s,
                "peak_rss_mb": peak_rss_mb(),
                "depth_pixels": packed.depth_pixel_count(),
                "center": packed.info.frame.file_from_world(packed.info.centre),
                "half_size": packed.info.half_size_m / packed.info.frame.unit_m,
                "bytes": packed.bytes(),
                "face_size": packed.face_size_px,
                "notes": set.notes,
            }));
            return Ok(());
        }
        let output = self.output.display();
        let content = describe_cube(&packed);
        println!(
            "{output}: {content} from {} images, {total_s:.2} s",
            views.len()
        );
        println!("look at it: headbox render {output} -o frame.png");
        Ok(())
    }
}

/// Returns the smallest vertical field of view of the images, degrees, if it is narrower than that
/// of frames by default, which would show what no image does; `None` otherwise.
fn narrowest_fov(views: &[&View]) -> Option<f64> {
    const DEFAULT_DEG: f64 = 60.0;
    let fovs = views.iter().filter_map(|view| view.camera());
    let narrowest = fovs
        .map(|camera| camera.fov_y_deg())
        .reduce(f64::min)
        .filter(|fov| *fov < DEFAULT_DEG)?;
    Some(narrowest.floor().max(1.0))
}
