//! One scene of a report: contenders, measurement, truth, rows and facts.

use super::contender::contender_list::{ContenderList, DefaultCapture};
use super::contender::wall::Wall;
use super::row::{EyeRecord, Row, SceneFacts};
use super::subject::{ReportError, Subject};
use super::truth_samples::trace_truths;
use super::{measurement, rival};
use crate::plan::{Eye, Plan};
use crate::stats::{mean, mse_from_psnr, pooled_psnr_db};
use crate::truths::Truths;
use headbox_core::progress::Progress;
use headbox_cube::pack::SegmentSide;
use headbox_trace::truth::Truth;
use std::path::PathBuf;

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
    let wall = Wall::new(subject, plan);
    let plan = &match &wall {
        Some(wall) => plan.with_eyes(wall.eyes(&subject.tracer, plan)?),
        None => plan.clone(),
    };
    let mut list = ContenderList::new(subject, plan, wall)?;
    let default = list.add_all(progress)?;
    let rival = rival::measure(subject, plan, &default, &list.all)?;
    let mut contenders = list.contenders;
    let measured =
        measurement::draw_in_turns(&mut contenders, &plan.eyes, plan.quality.rounds, progress);
    let truths = Truths::new(&subject.tracer, &subject.lighting, subject.lit, cache);
    let traced = trace_truths(&truths, &contenders, &measured, plan, progress)?;
    let records = plan.eyes.iter().zip(&traced);
    let records: Vec<EyeRecord> = records
        .map(|(eye, (truth, truth_samples))| EyeRecord {
            place: eye.place.name().into(),
            offset: eye.offset.to_array(),
            forward: eye.camera.forward().to_array(),
            truth_samples: *truth_samples,
            truth_psnr_db: truth.standard_error_psnr_db,
        })
        .collect();
    let frames: Vec<Truth> = traced.into_iter().map(|(truth, _)| truth).collect();
    let rows = measurement::rows(&subject.name, &contenders, &measured, &plan.eyes, &frames)?;
    let margin_db = margin_db(&rows, &plan.eyes, &records);
    Ok((
        SceneFacts {
            margin_db,
            rival,
            ..facts(subject, plan, &default, records)
        },
        rows,
    ))
}

/// Returns the least distance of the standard error of truth below the error of any row that does
/// not trace, dB.
fn margin_db(rows: &[Row], eyes: &[Eye], records: &[EyeRecord]) -> f64 {
    let row_margin_db = |row: &Row| {
        let row_eyes = eyes
            .iter()
            .zip(records)
            .filter(|(eye, _)| eye.belongs_to(row.eyes));
        pooled_psnr_db(row_eyes.map(|(_, record)| record.truth_psnr_db)) - row.psnr_db
    };
    rows.iter()
        .filter(|row| !row.traces)
        .map(row_margin_db)
        .fold(f64::INFINITY, f64::min)
}

/// Collects the facts about a scene, without margin and comparison with Embree.
fn facts(
    subject: &Subject,
    plan: &Plan,
    default: &DefaultCapture,
    eyes: Vec<EyeRecord>,
) -> SceneFacts {
    let cube = &default.cube;
    let mut layers = [0u64; 4];
    let mut counts = vec![0u32; 6 * (cube.face_size_px as usize).pow(2)];
    for segment in &cube.segments {
        for (x, y) in (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y))) {
            let row = segment.face.index() * cube.face_size_px as usize + (segment.y0 + y) as usize;
            counts[row * cube.face_size_px as usize + (segment.x0 + x) as usize] +=
                segment.pixel(x, y).len() as u32;
        }
    }
    for count in counts {
        (0..count).for_each(|layer| layers[(layer as usize).min(3)] += 1);
    }
    let near = cube
        .segments
        .iter()
        .filter(|s| s.side == SegmentSide::Near)
        .map(|s| s.depth_pixels.len())
        .sum::<usize>();
    let scene = subject.tracer.scene();
    let path: Vec<f64> = eyes
        .iter()
        .filter(|e| e.place == "path")
        .map(|e| mse_from_psnr(e.truth_psnr_db))
        .collect();
    let truth_flicker = if path.len() > 1 {
        mean(path.windows(2).map(|pair| pair[0] + pair[1])).sqrt()
    } else {
        0.0
    };
    SceneFacts {
        scene: subject.name.clone(),
        triangles: scene.triangles.len(),
        scene_bytes: scene.bytes(),
        half_size_m: plan.half_size_m,
        face_size_px: cube.face_size_px,
        frame_px: plan.quality.frame_px,
        layers,
        near_share: near as f64 / cube.depth_pixel_count().max(1) as f64,
        rays_per_depth_pixel: cube.info.rays_traced as f64 / cube.depth_pixel_count().max(1) as f64,
        eyes,
        margin_db: f64::INFINITY,
        truth_flicker,
        rival: None,
    }
}
