//! Progress of long work: on a terminal one bar over all stages with the remaining time, elsewhere
//! a line every ten seconds.

use headbox_core::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines without a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);
/// Time between two updates of the bar.
const UPDATE_INTERVAL: Duration = Duration::from_millis(100);
/// Number of steps of the bar.
const LENGTH: u64 = 1000;
/// Share of the work below which the remaining time is not extrapolated.
const MIN_SHARE: f64 = 0.03;

/// Planned stage, or several stages that alternate.
pub(super) struct PlannedStage {
    pub(super) stages: &'static [&'static str],
    /// Number of times that the stages begin.
    pub(super) times: u32,
    /// Expected time, seconds, or a relative weight if only the shares are known.
    pub(super) weight: f64,
}

/// Progress on standard error: one bar over all stages that were planned, or one for each stage.
pub(super) struct Bar {
    bar: ProgressBar,
    started: Instant,
    plan: Vec<PlannedStage>,
    /// True if the weights of the plan are seconds.
    in_seconds: bool,
    /// Number of finished steps of the current stage.
    done: AtomicU64,
    /// Time of the next update, ms since the start.
    next_update_ms: AtomicU64,
    stage: Mutex<Stage>,
    /// True if standard error is not a terminal.
    in_lines: bool,
}

/// Progress of a stage.
struct Stage {
    name: String,
    total: u64,
    began: Instant,
    /// Time of the last line.
    last_line: Instant,
    /// Number of finished parts of the work, such as scenes, and their total number; the plan is
    /// for one part.
    parts: [usize; 2],
    /// Name of the current part.
    part: String,
    /// Index of the current entry of the plan, and the number of its stages that have ended.
    planned: Option<(usize, u32)>,
    /// Names and times of the stages that have ended, seconds.
    ended: Vec<(String, f64)>,
    /// Largest share reported so far: a bar never goes backwards.
    reported: f64,
}

impl Bar {
    /// Creates a bar for stages without a plan.
    pub(super) fn new() -> Self {
        Self::planned(Vec::new(), false)
    }

    /// Creates a bar over stages in the order of a plan.
    pub(super) fn planned(plan: Vec<PlannedStage>, in_seconds: bool) -> Self {
        let bar = ProgressBar::new(LENGTH);
        if let Ok(style) = ProgressStyle::with_template("{prefix} [{bar:30}] {percent:>3} %  {msg}")
        {
            bar.set_style(style.progress_chars("=> "));
        }
        let now = Instant::now();
        let stage = Stage {
            name: String::new(),
            total: 0,
            began: now,
            last_line: now,
            parts: [0, 1],
            part: String::new(),
            planned: None,
            ended: Vec::new(),
            reported: 0.0,
        };
        Self {
            bar,
            started: now,
            plan,
            in_seconds,
            done: AtomicU64::new(0),
            next_update_ms: AtomicU64::new(0),
            stage: Mutex::new(stage),
            in_lines: !std::io::stderr().is_terminal(),
        }
    }

    /// Begins part `number` (from 0) of `count`, for which the plan starts again.
    pub(super) fn begin_part(&self, name: &str, number: usize, count: usize) {
        let mut stage = self.stage();
        stage.end();
        (stage.part, stage.parts, stage.planned) = (format!("{name}: "), [number, count], None);
    }

    pub(super) fn finish(&self) {
        self.stage().end();
        self.bar.finish_and_clear();
    }

    /// Times of the stages that took at least a tenth of a second, in order.
    pub(super) fn times(&self) -> String {
        let stage = self.stage();
        let long = stage.ended.iter().filter(|(_, seconds)| *seconds >= 0.1);
        let parts: Vec<String> = long
            .map(|(name, seconds)| format!("{name} {}", duration(*seconds)))
            .collect();
        parts.join(", ")
    }

    fn stage(&self) -> std::sync::MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Share of the plan that is done, or of the stage if there is no plan.
    fn share_done(&self, stage: &Stage) -> f64 {
        let stage_share =
            (self.done.load(Ordering::Relaxed) as f64 / stage.total.max(1) as f64).min(1.0);
        if self.plan.is_empty() {
            return stage_share;
        }
        let total: f64 = self.plan.iter().map(|planned| planned.weight).sum();
        let in_part = stage.planned.map_or(0.0, |(i, ended)| {
            let before: f64 = self.plan[..i].iter().map(|planned| planned.weight).sum();
            let PlannedStage { times, weight, .. } = self.plan[i];
            before + weight * ((f64::from(ended) + stage_share) / f64::from(times.max(1))).min(1.0)
        });
        let [part, parts] = stage.parts;
        ((part as f64 + in_part / total.max(f64::MIN_POSITIVE)) / parts.max(1) as f64).min(1.0)
    }

    /// Remaining time of the plan, or of the stage if there is no plan, seconds.
    fn left(&self, stage: &Stage, share: f64) -> Option<f64> {
        let since = if self.plan.is_empty() {
            stage.began
        } else {
            self.started
        };
        if share >= MIN_SHARE {
            return Some(since.elapsed().as_secs_f64() * (1.0 - share) / share);
        }
        let planned = || self.plan.iter().map(|planned| planned.weight).sum::<f64>();
        self.in_seconds
            .then(|| (planned() - since.elapsed().as_secs_f64()).max(0.0))
    }

    /// Remaining time of the current stage by its own rate, seconds.
    fn stage_left(&self, stage: &Stage) -> f64 {
        let share = self.done.load(Ordering::Relaxed) as f64 / stage.total.max(1) as f64;
        match share {
            MIN_SHARE..1.0 => stage.began.elapsed().as_secs_f64() * (1.0 - share) / share,
            _ => 0.0,
        }
    }

    /// Share done and remaining time, seconds, as reported: corrected if a stage takes longer than
    /// planned, below 100 % until the end, and never less than before.
    fn report(&self, stage: &mut Stage) -> (f64, Option<f64>) {
        /// Maximum share before the end.
        const MAX_SHARE: f64 = 0.99;
        let share = self.share_done(stage).min(MAX_SHARE);
        let so_far = self.started.elapsed().as_secs_f64();
        let stage_left = self.stage_left(stage);
        let share = if self.plan.is_empty() {
            share
        } else {
            share.min(so_far / (so_far + stage_left))
        };
        let share = share.max(stage.reported);
        stage.reported = share;
        let left = self.left(stage, share);
        (share, left.map(|left| left.max(stage_left)))
    }

    /// Returns the share of the work that is done.
    #[cfg(test)]
    pub(super) fn share(&self) -> f64 {
        self.share_done(&self.stage())
    }

    /// Sets the share of the current stage that is done, for work whose total changes.
    pub(super) fn set_share(&self, share: f64) {
        let total = self.stage().total;
        let done = (share.clamp(0.0, 1.0) * total as f64) as u64;
        self.done.store(done, Ordering::Relaxed);
        self.show_if_due();
    }

    /// Updates the bar if an update is due.
    fn show_if_due(&self) {
        let now_ms = self.started.elapsed().as_millis() as u64;
        let due_ms = self.next_update_ms.load(Ordering::Relaxed);
        let next_ms = now_ms + UPDATE_INTERVAL.as_millis() as u64;
        // Only one of several threads shows an update that is due.
        let mine = now_ms >= due_ms
            && self
                .next_update_ms
                .compare_exchange(due_ms, next_ms, Ordering::Relaxed, Ordering::Relaxed)
                .is_ok();
        if mine {
            self.show(&mut self.stage());
        }
    }

    /// Updates the bar, or prints a line if it is time for one.
    fn show(&self, stage: &mut Stage) {
        let (share, left) = self.report(stage);
        let left = left.map_or(String::new(), |left| format!(", {} left", duration(left)));
        let so_far = duration(self.started.elapsed().as_secs_f64());
        if !self.in_lines {
            self.bar.set_prefix(so_far);
            self.bar.set_position((share * LENGTH as f64) as u64);
            self.bar
                .set_message(format!("{}{}{left}", stage.part, stage.name));
        } else if stage.last_line.elapsed() >= LINE_INTERVAL {
            stage.last_line = Instant::now();
            eprintln!(
                "{so_far}: {:.0} %, {}{}{left}",
                share * 100.0,
                stage.part,
                stage.name
            );
        }
    }
}

impl Stage {
    /// Ends the current stage and adds its time to that of its name.
    fn end(&mut self) {
        let seconds = self.began.elapsed().as_secs_f64();
        if self.name.is_empty() {
            return;
        }
        let name = std::mem::take(&mut self.name);
        match self.ended.iter_mut().find(|(ended, _)| *ended == name) {
            Some((_, sum)) => *sum += seconds,
            None => self.ended.push((name, seconds)),
        }
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &str, _unit: &str, total: u64) {
        let mut current = self.stage();
        current.end();
        (current.name, current.total, current.began) = (stage.to_owned(), total, Instant::now());
        self.done.store(0, Ordering::Relaxed);
        if self.plan.is_empty() {
            current.reported = 0.0; // each stage has a bar of its own
        }
        if let Some(i) = self
            .plan
            .iter()
            .position(|planned| planned.stages.contains(&stage))
        {
            current.planned = match current.planned {
                Some((before, ended)) if before == i => Some((i, ended + 1)),
                _ => Some((i, 0)),
            };
        }
        self.show(&mut current);
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
        self.show_if_due();
    }
}

/// Formats a duration: `0.4 s`, `12 s`, `3 min 20 s`, `2 h 5 min`.
pub(super) fn duration(seconds: f64) -> String {
    let whole = seconds.round().max(0.0) as u64;
    match whole {
        _ if seconds < 9.95 => format!("{seconds:.1} s"),
        0..=119 => format!("{whole} s"),
        120..=7199 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_formatted() {
        let cases = [
            (0.04, "0.0 s"),
            (9.94, "9.9 s"),
            (9.96, "10 s"),
            (119.4, "119 s"),
            (200.0, "3 min 20 s"),
            (7500.0, "2 h 5 min"),
        ];
        for (seconds, words) in cases {
            assert_eq!(duration(seconds), words);
        }
    }

    #[test]
    fn overlong_stage_never_completes_early() {
        let plan = vec![PlannedStage {
            stages: &["truth"],
            times: 1,
            weight: 1.0,
        }];
        let bar = Bar::planned(plan, false);
        for _ in 0..3 {
            bar.begin("truth", "rows", 10);
            std::thread::sleep(Duration::from_millis(20));
            bar.advance(1);
            let (share, left) = bar.report(&mut bar.stage());
            // One tenth of the stage took at least 20 ms, nine are left.
            assert!(
                share < 1.0 && left.is_some_and(|left| left >= 0.18),
                "{share} {left:?}"
            );
            bar.advance(9);
            assert!(bar.report(&mut bar.stage()).0 < 1.0);
        }
    }

    #[test]
    fn planned_bar_never_goes_backwards() {
        let plan = |stages, times| PlannedStage {
            stages,
            times,
            weight: 1.0,
        };
        let bar = Bar::planned(vec![plan(&["rays"], 1), plan(&["truth"], 2)], true);
        let mut shares = Vec::new();
        // A stage of no plan, a planned one too often, one of an earlier entry again, and a slow
        // end of each, which lowers the share that the times so far suggest.
        for stage in ["rays", "holes", "truth", "truth", "truth", "rays", "pack"] {
            bar.begin(stage, "steps", 4);
            for steps in [0, 2, 1, 1] {
                bar.advance(steps);
                shares.push(bar.report(&mut bar.stage()).0);
                std::thread::sleep(Duration::from_millis(2 * steps));
            }
        }
        assert!(shares.is_sorted(), "{shares:?}");
        assert!(shares.last().is_some_and(|last| *last < 1.0), "{shares:?}");
    }

    #[test]
    fn stages_add_up_by_name() {
        let bar = Bar::new();
        for _ in 0..2 {
            bar.begin("rays", "rays", 2);
            std::thread::sleep(Duration::from_millis(60));
            bar.advance(2);
        }
        bar.finish();
        let times = bar.times();
        assert!(
            times.starts_with("rays 0.") && !times.contains(','),
            "{times}"
        );
    }

    #[test]
    fn planned_bar_runs_from_start_to_end() {
        let plan = vec![
            PlannedStage {
                stages: &["pilot", "trace"],
                times: 2,
                weight: 1.0,
            },
            PlannedStage {
                stages: &["look"],
                times: 4,
                weight: 2.0,
            },
            PlannedStage {
                stages: &["light"],
                times: 1,
                weight: 1.0,
            },
        ];
        let bar = Bar::planned(plan, true);
        let share = || bar.share();
        let mut shares = vec![share()];
        for part in 0..2 {
            bar.begin_part("scene", part, 2);
            // Fewer rounds than planned: the bar continues with the next stage.
            for stage in ["pilot", "trace", "look", "light"] {
                bar.begin(stage, "steps", 4);
                shares.push(share());
                bar.advance(2);
                shares.push(share());
                bar.advance(2);
            }
        }
        shares.push(share());
        assert!(shares.is_sorted(), "{shares:?}");
        assert!(shares.contains(&0.5), "half of the parts: {shares:?}");
        assert_eq!(shares.last(), Some(&1.0));
    }
}
