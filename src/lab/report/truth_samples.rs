//! Adaptive number of rays per pixel of truth.

use super::contender::Contender;
use super::measurement::Measurement;
use super::subject::ReportError;
use crate::plan::{Eye, EyeSet, Place, Plan};
use crate::stats::{mean, mse_from_psnr, psnr_from_mse};
use crate::truths::{Truths, samples_for};
use headbox_core::metrics;
use headbox_core::progress::Progress;
use headbox_trace::truth::Truth;

/// Required distance of the standard error of truth below the measured error, dB.
pub const MARGIN_DB: f64 = 10.0;
/// Maximum number of rounds of refinement.
const TRUTH_ROUNDS: u32 = 5;

/// Traces truth for every eye, with increasing numbers of rays per pixel, until its standard error
/// over the eyes of a row is [`MARGIN_DB`] below the row's error, for all rows that do not trace,
/// or the limit of the plan is reached. Returns frames and rays per pixel.
pub(super) fn trace_truths(
    truths: &Truths,
    contenders: &[Contender],
    measured: &[Measurement],
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Vec<(Truth, u32)>, ReportError> {
    let most = plan.quality.most_samples;
    let trace = |eye: &Eye, samples| (truths.frame(&eye.camera, samples, progress), samples);
    let error_eyes = plan.eyes.iter().filter(|eye| eye.place != Place::Path);
    let mut traced: Vec<(Truth, u32)> = error_eyes
        .map(|eye| trace(eye, plan.quality.first_samples))
        .collect();
    for _ in 0..TRUTH_ROUNDS {
        let mut required: Vec<u32> = traced.iter().map(|(_, samples)| *samples).collect();
        for set in [EyeSet::All, EyeSet::Ahead, EyeSet::Wall] {
            let indices: Vec<usize> = (0..traced.len())
                .filter(|&i| plan.eyes[i].belongs_to(set))
                .collect();
            let reached = mean(
                indices
                    .iter()
                    .map(|&i| mse_from_psnr(traced[i].0.standard_error_psnr_db)),
            );
            let measured = least_error(contenders, measured, &traced, &indices, set)?;
            // The measured error is the sum of both errors; at least a tenth of it is attributed to
            // the contender.
            let own_db = psnr_from_mse((measured - reached).max(0.1 * measured));
            if psnr_from_mse(reached) < psnr_from_mse(measured) + MARGIN_DB {
                for &i in &indices {
                    let more = samples_for(
                        own_db + MARGIN_DB,
                        psnr_from_mse(reached),
                        traced[i].1,
                        most,
                    );
                    required[i] = required[i].max(more);
                }
            }
        }
        let mut is_complete = true;
        for (i, &samples) in required.iter().enumerate() {
            if samples > traced[i].1 {
                traced[i] = trace(&plan.eyes[i], samples);
                is_complete = false;
            }
        }
        if is_complete {
            break;
        }
    }
    // The eyes of the path get half of the largest number of rays: they serve flicker only.
    let most = traced
        .iter()
        .map(|(_, samples)| *samples)
        .max()
        .unwrap_or(0);
    let samples = (most / 2).max(plan.quality.first_samples);
    let path = plan.eyes.iter().filter(|eye| eye.place == Place::Path);
    traced.extend(path.map(|eye| trace(eye, samples)));
    Ok(traced)
}

/// Returns the least mean squared error (0..=1) of any contender that does not trace, over the eyes
/// with these indices.
fn least_error(
    contenders: &[Contender],
    measured: &[Measurement],
    truths: &[(Truth, u32)],
    indices: &[usize],
    set: EyeSet,
) -> Result<f64, ReportError> {
    let mut least = f64::INFINITY;
    for (_, measurement) in contenders
        .iter()
        .zip(measured)
        .filter(|(c, _)| !c.traces && c.eyes.contains(set))
    {
        let mut errors = Vec::with_capacity(indices.len());
        for &i in indices {
            if let Some(picture) = &measurement.pictures[i] {
                errors.push(mse_from_psnr(metrics::psnr_db(
                    &truths[i].0.rgb(),
                    &picture.color,
                )?));
            }
        }
        least = least.min(mean(errors));
    }
    Ok(least)
}
