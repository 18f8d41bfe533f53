//! Time budget of frames (E11): a preview from fewer cameras on a coarser grid while the eye moves,
//! full quality when it stands still.

use super::GeometrySettings;

/// Steps of quality, from the requested one to the coarsest that is still usable for orientation:
/// share of the cameras, factor of the grid's spacing, and additional levels of detail. Each costs
/// about two thirds of the one before.
const STEPS: [(f32, f32, u32); 7] = [
    (1.0, 1.0, 0),
    (0.8, 1.25, 0),
    (0.6, 1.5, 0),
    (0.5, 2.0, 1),
    (0.4, 2.5, 1),
    (0.3, 3.0, 1),
    (0.2, 4.0, 2),
];

/// Assumed cost of a step relative to the one before.
const STEP_COST: f64 = 0.7;

/// Chooses the quality of frames in motion by the time that earlier frames took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeBudget {
    /// Time for a frame, ms.
    pub ms: f64,
    /// Index into [`STEPS`] for the next frame.
    step: usize,
}

impl TimeBudget {
    /// Starts with the requested quality.
    pub fn new(ms: f64) -> Self {
        Self { ms, step: 0 }
    }

    /// Returns the settings of the next frame in motion.
    pub fn settings(&self, full: &GeometrySettings) -> GeometrySettings {
        let (cameras, spacing, levels) = STEPS[self.step.min(STEPS.len() - 1)];
        GeometrySettings {
            cameras: ((full.cameras as f32 * cameras).round() as usize).max(1),
            grid_px: full.grid_px * spacing,
            level: full.level.saturating_add(levels),
            ..*full
        }
    }

    /// Records the time that a frame with [`Self::settings`] took. A late frame advances as many
    /// steps as its delay calls for; a frame after which the previous step would also have been in
    /// time goes back one step.
    pub fn took(&mut self, frame_ms: f64) {
        if frame_ms > self.ms {
            let steps = ((self.ms / frame_ms).ln() / STEP_COST.ln()).ceil();
            // NaN or infinite: no such time exists.
            let steps = if steps.is_finite() {
                steps as usize
            } else {
                STEPS.len()
            };
            self.step = (self.step + steps.max(1)).min(STEPS.len() - 1);
        } else if frame_ms < self.ms * STEP_COST * STEP_COST {
            self.step = self.step.saturating_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Milliseconds of a frame, if a camera and a node cost so much.
    fn cost(settings: &GeometrySettings, of_full_ms: f64) -> f64 {
        let full = GeometrySettings::default();
        let nodes = f64::from(full.grid_px / settings.grid_px).powi(2);
        let samples = settings.cameras as f64
            / full.cameras as f64
            / 4f64.powi((settings.level - full.level) as i32);
        of_full_ms * (0.5 + 0.3 * nodes + 0.2 * samples)
    }

    #[test]
    fn budget_is_met_at_highest_quality() {
        let full = GeometrySettings::default();
        // What is asked for is in time, or some step is.
        for (of_full_ms, is_full) in [(10.0, true), (19.0, true), (26.0, false), (33.0, false)] {
            let mut budget = TimeBudget::new(20.0);
            let mut late = 0;
            for _ in 0..50 {
                let frame_ms = cost(&budget.settings(&full), of_full_ms);
                late += u32::from(frame_ms > budget.ms);
                budget.took(frame_ms);
            }
            assert!(late <= 2, "{of_full_ms}: {late} late frames");
            assert_eq!(budget.settings(&full) == full, is_full, "{of_full_ms}");
        }
    }

    #[test]
    fn slow_frames_reduce_effort_and_recover() {
        let full = GeometrySettings {
            cameras: 10,
            grid_px: 4.0,
            ..GeometrySettings::default()
        };
        let mut budget = TimeBudget::new(16.0);
        for frame_ms in [1e9, f64::INFINITY, f64::NAN, 500.0] {
            budget.took(frame_ms);
        }
        let least = budget.settings(&full);
        assert_eq!((least.cameras, least.grid_px, least.level), (2, 16.0, 2));
        assert_eq!(
            budget
                .settings(&GeometrySettings { cameras: 1, ..full })
                .cameras,
            1
        );
        (0..STEPS.len()).for_each(|_| budget.took(1.0));
        assert_eq!(budget.settings(&full), full);
        let mut none = TimeBudget::new(0.0);
        none.took(5.0);
        assert_eq!(none.settings(&full).cameras, 2, "no time at all");
    }
}
