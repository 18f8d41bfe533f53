//! A time for frames, and how much is done within it (E11): a preview of fewer cameras on a coarser
//! grid while the eye moves, all when it stands still.

use super::GeometrySettings;

/// Cameras over those asked for, growth of the grid's spacing, and levels of detail more, from all
/// that was asked for to the least that still shows where one is. Each costs about two thirds of
/// the one before.
const STEPS: [(f32, f32, u32); 7] = [
    (1.0, 1.0, 0),
    (0.8, 1.25, 0),
    (0.6, 1.5, 0),
    (0.5, 2.0, 1),
    (0.4, 2.5, 1),
    (0.3, 3.0, 1),
    (0.2, 4.0, 2),
];

/// The cost of a step over that of the one before, as far as is known before it was tried.
const CHEAPER: f64 = 0.7;

/// Chooses what moving frames are made of by how long those before took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeBudget {
    /// For a frame, ms.
    pub ms: f64,
    /// Index into [`STEPS`] for the next frame.
    step: usize,
}

impl TimeBudget {
    /// Begins with all that is asked for.
    pub fn new(ms: f64) -> Self {
        Self { ms, step: 0 }
    }

    /// Settings of the next frame in motion.
    pub fn settings(&self, full: &GeometrySettings) -> GeometrySettings {
        let (cameras, spacing, levels) = STEPS[self.step.min(STEPS.len() - 1)];
        GeometrySettings {
            cameras: ((full.cameras as f32 * cameras).round() as usize).max(1),
            grid_px: full.grid_px * spacing,
            level: full.level.saturating_add(levels),
            ..*full
        }
    }

    /// Takes note of how long a frame of [`Self::settings`] took. As many steps further at once as
    /// a late frame calls for; one step back where the frame before would have been in time too.
    pub fn took(&mut self, frame_ms: f64) {
        if frame_ms > self.ms {
            let steps = ((self.ms / frame_ms).ln() / CHEAPER.ln()).ceil();
            // Not a number: there is no such time.
            let steps = if steps.is_finite() {
                steps as usize
            } else {
                STEPS.len()
            };
            self.step = (self.step + steps.max(1)).min(STEPS.len() - 1);
        } else if frame_ms < self.ms * CHEAPER * CHEAPER {
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
    fn frames_come_in_time_and_no_worse_than_that() {
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
