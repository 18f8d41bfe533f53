//! One scene of a report: its contenders, their measurement, truth that is good enough, rows and facts.

use super::field::Field;
use super::growth::grow;
use super::measure;
use super::plan::{Eye, Plan};
use super::row::{EyeRecord, Row, SceneFacts};
use super::stats::{mean, mse_of_psnr, pooled_psnr_db};
use super::truths::Truths;
use crate::capture::light::Lighting;
use crate::capture::trace::Tracer;
use crate::packed::{PackedCube, SegmentSide};
use crate::progress::Progress;
use crate::sprite::SpriteSet;
use crate::truth::TruthFrame;
use std::path::PathBuf;
use std::sync::Arc;

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// Threads could not be started.
    #[error("threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A camera could not be made.
    #[error(transparent)]
    Camera(#[from] crate::capture::CameraError),
    /// A capture failed.
    #[error("a capture failed: {0}")]
    Capture(#[from] std::io::Error),
    /// A capture could not be packed.
    #[error(transparent)]
    Pack(#[from] crate::packed::PackError),
    /// Sprites could not be made.
    #[error(transparent)]
    Sprite(#[from] crate::sprite::SpriteError),
    /// A frame is no picture.
    #[error(transparent)]
    Frame(#[from] crate::frame::FrameError),
    /// Pictures could not be compared.
    #[error(transparent)]
    Metric(#[from] crate::metrics::MetricError),
}

/// What is compared in a scene.
pub struct Subject {
    /// How rows call it.
    pub name: String,
    /// The scene, its origin at the centre of the headbox.
    pub tracer: Arc<Tracer>,
    /// Its light.
    pub lighting: Lighting,
    /// Whether truth is lit.
    pub lit: bool,
    /// A capture that is given instead of made.
    pub cube: Option<PackedCube>,
    /// Sprites that are given instead of made.
    pub sprites: Option<SpriteSet>,
}

/// Measures one scene.
///
/// # Errors
/// See [`ReportError`].
pub fn run(
    subject: &Subject,
    plan: &Plan,
    cache: Option<PathBuf>,
    progress: &dyn Progress,
) -> Result<(SceneFacts, Vec<Row>), ReportError> {
    let mut field = Field::new(subject, plan)?;
    let default = field.add_all(progress)?;
    let mut contenders = field.contenders;
    let measured = measure::draw_in_turns(&mut contenders, &plan.eyes, plan.quality.rounds, progress);
    let truths = Truths::new(&subject.tracer, &subject.lighting, subject.lit, cache);
    let grown = grow(&truths, &contenders, &measured, plan, progress)?;
    let records: Vec<EyeRecord> = plan.eyes.iter().zip(&grown).map(|(eye, truth)| eye_record(eye, truth)).collect();
    let (frames, _): (Vec<TruthFrame>, Vec<u32>) = grown.into_iter().unzip();
    let rows = measure::rows(&subject.name, &contenders, &measured, &plan.eyes, &frames)?;
    let margin_db = margin_db(&rows, &plan.eyes, &records);
    Ok((SceneFacts { margin_db, ..facts(subject, plan, &default, records) }, rows))
}

fn eye_record(eye: &Eye, (truth, truth_samples): &(TruthFrame, u32)) -> EyeRecord {
    EyeRecord {
        place: eye.place.name().into(),
        offset: eye.offset.to_array(),
        forward: eye.camera.forward().to_array(),
        truth_samples: *truth_samples,
        truth_psnr_db: truth.standard_error_psnr_db,
    }
}

/// The least margin of truth over any row that does not trace, dB.
fn margin_db(rows: &[Row], eyes: &[Eye], records: &[EyeRecord]) -> f64 {
    let of_row = |row: &Row| {
        let belong = eyes.iter().zip(records).filter(|(eye, _)| eye.belongs_to(row.eyes));
        pooled_psnr_db(belong.map(|(_, record)| record.truth_psnr_db)) - row.psnr_db
    };
    rows.iter().filter(|row| !row.traces).map(of_row).fold(f64::INFINITY, f64::min)
}

/// The default capture, as far as facts need it.
pub(super) struct DefaultCapture {
    pub(super) cube: Arc<PackedCube>,
}

fn facts(subject: &Subject, plan: &Plan, default: &DefaultCapture, eyes: Vec<EyeRecord>) -> SceneFacts {
    let cube = &default.cube;
    let mut layers = [0u64; 4];
    let mut counts = vec![0u32; 6 * (cube.face_size_px as usize).pow(2)];
    for segment in &cube.segments {
        for (x, y) in (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y))) {
            let row = segment.face.index() * cube.face_size_px as usize + (segment.y0 + y) as usize;
            counts[row * cube.face_size_px as usize + (segment.x0 + x) as usize] += segment.pixel(x, y).len() as u32;
        }
    }
    for count in counts {
        (0..count).for_each(|layer| layers[(layer as usize).min(3)] += 1);
    }
    let near =
        cube.segments.iter().filter(|s| s.side == SegmentSide::Near).map(|s| s.depth_pixels.len()).sum::<usize>();
    let scene = subject.tracer.scene();
    let path: Vec<f64> = eyes.iter().filter(|e| e.place == "path").map(|e| mse_of_psnr(e.truth_psnr_db)).collect();
    let changes = path.windows(2).map(|pair| pair[0] + pair[1]);
    let truth_flicker = if path.len() > 1 { mean(changes).sqrt() } else { 0.0 };
    SceneFacts {
        scene: subject.name.clone(),
        triangles: scene.triangles.len(),
        scene_bytes: scene_bytes(scene),
        half_size_m: plan.half_size_m,
        face_size_px: cube.face_size_px,
        frame_px: plan.quality.frame_px,
        layers,
        near_share: near as f64 / cube.depth_pixel_count().max(1) as f64,
        rays_per_depth_pixel: cube.info.rays_traced as f64 / cube.depth_pixel_count().max(1) as f64,
        eyes,
        margin_db: f64::INFINITY,
        truth_flicker,
    }
}

/// Bytes of vertices, triangles and texels.
pub(super) fn scene_bytes(scene: &crate::capture::Scene) -> u64 {
    let arrays = [
        size_of_val(&scene.positions[..]),
        size_of_val(&scene.normals[..]),
        size_of_val(&scene.texcoords[..]),
        size_of_val(&scene.colors[..]),
        size_of_val(&scene.triangles[..]),
    ];
    let texels: usize = scene.textures.iter().map(|texture| size_of_val(texture.texels())).sum();
    (arrays.iter().sum::<usize>() + texels) as u64
}
