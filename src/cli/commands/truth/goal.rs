//! Goal of a traced frame (rays, noise, time), and progress toward it.

use crate::interrupt;
use crate::progress::{Bar, duration};
use headbox_core::progress::Progress;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Conditions under which tracing ends; the first that holds ends it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// Maximum number of rays per pixel.
    pub(super) samples: u32,
    /// Standard error as PSNR, dB.
    pub(super) noise_db: Option<f64>,
    /// Time from the first ray on, seconds.
    pub(super) time_s: Option<f64>,
}

impl Goal {
    /// Returns the number of rays per pixel that the goal needs, estimated from the standard error,
    /// dB, of the first `samples`: the mean squared error is inversely proportional to their
    /// number.
    pub(super) fn expected_samples(&self, samples: u32, error_db: f64) -> f64 {
        let most = f64::from(self.samples);
        match self.noise_db {
            Some(noise_db) if samples > 0 => {
                let factor = 10f64.powf((noise_db - error_db) / 10.0);
                (f64::from(samples) * factor).clamp(1.0, most)
            }
            _ => most,
        }
    }

    /// Returns the number of rays per pixel of the next round, after `samples` in `seconds`: as
    /// many again, but few enough for steady progress and for the rest of the time. 0 if the goal
    /// is reached or no time is left.
    pub(super) fn round(&self, samples: u32, seconds: f64) -> u32 {
        const MAX_ROUND: u32 = 16;
        let in_time = match self.time_s {
            Some(time_s) if samples > 0 => (time_s - seconds) / seconds * f64::from(samples),
            _ => f64::from(MAX_ROUND),
        };
        // Rays are traced in pairs, one for each half of the samples.
        let in_time = in_time as u32 / 2 * 2;
        let rest = self.samples.saturating_sub(samples);
        samples.clamp(2, MAX_ROUND).min(in_time).min(rest)
    }

    /// Returns a note on the time that the goal takes, once it can be estimated: after `samples`
    /// rays per pixel of `expected_samples`, each `ray_s` seconds. Another if that is more than
    /// twice the number that was `announced`: bright light on rare paths is met late. `None` if the
    /// time is short, and if it is given.
    pub(super) fn note(
        &self,
        samples: u32,
        expected_samples: f64,
        ray_s: f64,
        announced: Option<f64>,
    ) -> Option<String> {
        /// Rays per pixel of the first round.
        const FIRST_ROUND: u32 = 2;
        /// Rays per pixel whose standard error is a fair estimate: the sum of three rounds.
        const FAIR: u32 = 8;
        /// Time that is not worth announcing, seconds.
        const SHORT_S: f64 = 5.0;
        let after = self.noise_db.map_or(FIRST_ROUND, |_| FAIR);
        let all_s = ray_s * expected_samples;
        let most = self.samples;
        let is_done = samples >= most;
        let is_due = announced.map_or(samples >= after, |announced| {
            self.noise_db.is_some() && expected_samples > 2.0 * announced
        });
        if !is_due || is_done || self.time_s.is_some() || all_s <= SHORT_S {
            return None;
        }
        let time = duration(all_s);
        let note = match self.noise_db {
            None => format!("{most} rays per pixel take about {time}"),
            Some(noise_db) if expected_samples < f64::from(most) => format!(
                "a standard error of {noise_db} dB takes about {expected_samples:.0} rays per pixel, {time}"
            ),
            Some(noise_db) => format!(
                "{most} rays per pixel take about {time}, and are too few for a standard error of {noise_db} dB"
            ),
        };
        Some(match announced {
            None => note,
            Some(_) => format!("some paths are rare and bright, so that {note}"),
        })
    }

    /// Returns the share of the work that is done after `samples` rays per pixel of
    /// `expected_samples`, and `seconds`: that of the condition which will hold first.
    pub(super) fn share(&self, samples: f64, expected_samples: f64, seconds: f64) -> f64 {
        let of_time = self.time_s.map_or(0.0, |time_s| seconds / time_s);
        (samples / expected_samples).max(of_time).min(1.0)
    }
}

/// Progress of a round of rays toward a goal; an interrupt cancels it.
pub(super) struct RoundProgress<'a> {
    pub(super) bar: &'a Bar,
    pub(super) goal: &'a Goal,
    /// Time of the first ray.
    pub(super) start: Instant,
    /// Rays per pixel before the round, and in it.
    pub(super) samples: [u32; 2],
    /// Expected number of rays per pixel.
    pub(super) expected_samples: f64,
    /// Number of rows of the frame.
    pub(super) rows: u32,
    /// Number of rows traced in the round.
    pub(super) rows_done: AtomicU64,
}

impl Progress for RoundProgress<'_> {
    fn begin(&self, _stage: &str, _unit: &str, _total: u64) {}

    fn advance(&self, rows: u64) {
        let rows = self.rows_done.fetch_add(rows, Ordering::Relaxed) + rows;
        let [before, round] = self.samples.map(f64::from);
        let samples = before + round * rows as f64 / f64::from(self.rows.max(1));
        let seconds = self.start.elapsed().as_secs_f64();
        let share = self.goal.share(samples, self.expected_samples, seconds);
        self.bar.set_share(share);
    }

    fn is_cancelled(&self) -> bool {
        interrupt::is_requested()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_follows_the_condition_that_holds_first() {
        let goal = Goal {
            samples: 1 << 20,
            noise_db: Some(40.0),
            time_s: Some(100.0),
        };
        // Noise falls by 3 dB per doubling: from 30 dB, ten times the rays.
        let expected = goal.expected_samples(32, 30.0);
        assert!((expected - 320.0).abs() < 1e-9, "{expected}");
        assert!((goal.share(32.0, expected, 5.0) - 0.1).abs() < 1e-9);
        assert!((goal.share(32.0, expected, 50.0) - 0.5).abs() < 1e-9);
        assert_eq!(goal.share(400.0, expected, 5.0), 1.0);
        assert_eq!(goal.expected_samples(0, 0.0), f64::from(1 << 20));
        assert_eq!(goal.expected_samples(8, f64::INFINITY), 1.0);
    }

    #[test]
    fn rounds_use_the_rest_of_the_time() {
        let goal = |samples, time_s| Goal {
            samples,
            noise_db: None,
            time_s,
        };
        let timed = goal(1 << 20, Some(45.0));
        // A ray takes a second: 2, 2, 4, 8 and 16 rays, then the 13 s that are left.
        assert_eq!(timed.round(0, 0.0), 2, "the first round, however late");
        assert_eq!(timed.round(4, 4.0), 4);
        assert_eq!(timed.round(16, 16.0), 16);
        assert_eq!(timed.round(32, 32.0), 12, "an even number");
        assert_eq!(timed.round(44, 44.0), 0);
        assert_eq!(timed.round(44, 60.0), 0, "late");
        assert_eq!(goal(40, None).round(32, 1e6), 8);
        assert_eq!(goal(40, None).round(40, 1.0), 0);
    }

    #[test]
    fn time_is_noted_once_it_can_be_estimated() {
        let goal = |samples, noise_db, time_s| Goal {
            samples,
            noise_db,
            time_s,
        };
        let note = |goal: Goal, samples: u32, ray_s: f64| {
            let expected_samples = goal.expected_samples(samples, 30.0);
            goal.note(samples, expected_samples, ray_s, None)
        };
        let fixed = goal(256, None, None);
        assert_eq!(
            note(fixed, 2, 0.5).as_deref(),
            Some("256 rays per pixel take about 2 min 8 s")
        );
        assert_eq!(note(fixed, 2, 0.01), None, "a short time");
        assert_eq!(fixed.note(4, 256.0, 0.5, Some(256.0)), None, "only once");
        assert_eq!(note(goal(2, None, None), 2, 9.0), None, "all are traced");
        let noise = goal(1 << 20, Some(40.0), None);
        assert_eq!(note(noise, 4, 0.5), None, "too early");
        assert_eq!(
            note(noise, 8, 0.5).as_deref(),
            Some("a standard error of 40 dB takes about 80 rays per pixel, 40 s")
        );
        assert_eq!(
            note(goal(64, Some(40.0), None), 8, 0.5).as_deref(),
            Some(
                "64 rays per pixel take about 32 s, and are too few for a standard error of 40 dB"
            )
        );
        assert_eq!(noise.note(64, 150.0, 0.5, Some(80.0)), None);
        assert_eq!(
            noise.note(64, 170.0, 0.5, Some(80.0)).as_deref(),
            Some(
                "some paths are rare and bright, so that a standard error of 40 dB takes about 170 rays per pixel, 85 s"
            )
        );
        for noise_db in [None, Some(40.0)] {
            for samples in [2, 8] {
                assert_eq!(
                    note(goal(1 << 20, noise_db, Some(60.0)), samples, 0.5),
                    None
                );
            }
        }
    }

    #[test]
    fn bar_shows_the_share_of_the_goal() {
        let bar = Bar::new();
        bar.begin("tracing", "steps", 1000);
        let goal = Goal {
            samples: 1 << 20,
            noise_db: Some(40.0),
            time_s: None,
        };
        let progress = RoundProgress {
            bar: &bar,
            goal: &goal,
            start: Instant::now(),
            samples: [32, 16],
            expected_samples: goal.expected_samples(32, 37.0),
            rows: 10,
            rows_done: AtomicU64::new(0),
        };
        (0..5).for_each(|_| progress.advance(1));
        // 40 of 64 rays.
        let share = bar.share();
        assert!((share - 0.626).abs() < 0.01, "{share}");
    }
}
