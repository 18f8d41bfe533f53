//! Truth that is good enough for what is measured with it.

use super::contender::Contender;
use super::judge::Measurement;
use super::subject::ReportError;
use crate::plan::EyeSet;
use crate::plan::{Place, Plan};
use crate::stats::{mean, mse_of_psnr, psnr_of_mse};
use crate::truths::{Truths, samples_for};
use headbox_core::metrics;
use headbox_core::progress::Progress;
use headbox_trace::truth::Truth;

/// Truth should lie so far below the error that is measured with it, dB.
pub const MARGIN_DB: f64 = 10.0;
/// Growing ends after so many rounds.
const TRUTH_ROUNDS: u32 = 5;

/// Truth for every eye: as many rays per pixel as it takes until its standard error, over the eyes
/// of a row, lies [`MARGIN_DB`] below the row's error, for all rows that do not trace; or as many
/// as the plan allows.
pub(super) fn grow(
    truths: &Truths,
    contenders: &[Contender],
    measured: &[Measurement],
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Vec<(Truth, u32)>, ReportError> {
    let most = plan.quality.most_samples;
    let judged = plan.eyes.iter().filter(|eye| eye.place != Place::Path);
    let mut grown: Vec<(Truth, u32)> = judged
        .map(|eye| {
            (
                truths.frame(&eye.camera, plan.quality.first_samples, progress),
                plan.quality.first_samples,
            )
        })
        .collect();
    for _ in 0..TRUTH_ROUNDS {
        let mut wanted: Vec<u32> = grown.iter().map(|(_, samples)| *samples).collect();
        for set in [EyeSet::All, EyeSet::Ahead, EyeSet::Wall] {
            let numbers: Vec<usize> = (0..grown.len())
                .filter(|&i| plan.eyes[i].belongs_to(set))
                .collect();
            let reached = mean(
                numbers
                    .iter()
                    .map(|&i| mse_of_psnr(grown[i].0.standard_error_psnr_db)),
            );
            let seen = least_error(contenders, measured, &grown, &numbers, set)?;
            // What is seen is the sum of both errors; at least a tenth of it is the contender's
            // own.
            let own_db = psnr_of_mse((seen - reached).max(0.1 * seen));
            if psnr_of_mse(reached) < psnr_of_mse(seen) + MARGIN_DB {
                for &i in &numbers {
                    let more =
                        samples_for(own_db + MARGIN_DB, psnr_of_mse(reached), grown[i].1, most);
                    wanted[i] = wanted[i].max(more);
                }
            }
        }
        let missing: Vec<usize> = (0..grown.len())
            .filter(|&i| wanted[i] > grown[i].1)
            .collect();
        if missing.is_empty() {
            break;
        }
        for i in missing {
            grown[i] = (
                truths.frame(&plan.eyes[i].camera, wanted[i], progress),
                wanted[i],
            );
        }
    }
    // Eyes of the path get half as many rays as the dearest other: nothing is judged by them but
    // how the error changes.
    let most = grown.iter().map(|(_, samples)| *samples).max().unwrap_or(0);
    let samples = (most / 2).max(plan.quality.first_samples);
    let path = plan.eyes.iter().filter(|eye| eye.place == Place::Path);
    grown.extend(path.map(|eye| (truths.frame(&eye.camera, samples, progress), samples)));
    Ok(grown)
}

/// The least mean squared error (0..=1) of any contender that does not trace, over some eyes.
fn least_error(
    contenders: &[Contender],
    measured: &[Measurement],
    truths: &[(Truth, u32)],
    numbers: &[usize],
    set: EyeSet,
) -> Result<f64, ReportError> {
    let mut least = f64::INFINITY;
    for (_, found) in contenders
        .iter()
        .zip(measured)
        .filter(|(c, _)| !c.traces && c.eyes.holds(set))
    {
        let mut errors = Vec::with_capacity(numbers.len());
        for &i in numbers {
            if let Some(picture) = &found.pictures[i] {
                errors.push(mse_of_psnr(metrics::psnr_db(
                    &truths[i].0.rgb(),
                    &picture.color,
                )?));
            }
        }
        least = least.min(mean(errors));
    }
    Ok(least)
}
