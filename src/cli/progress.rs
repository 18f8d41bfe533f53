//! How far long work is: a bar with its stages and the time left on a terminal, a line every ten seconds elsewhere.

use crate::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines where there is no terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Progress on standard error, one stage after the other.
pub(super) struct Bar {
    bar: ProgressBar,
    started: Instant,
    stage: Mutex<Stage>,
    /// Whether nobody would see a bar move.
    in_lines: bool,
}

/// The stage that is under way.
struct Stage {
    /// How many there have been, with this one.
    number: u32,
    name: String,
    total: u64,
    done: u64,
    began: Instant,
    told: Instant,
    /// Seconds of those that have ended, by their names.
    ended: Vec<(String, f64)>,
}

impl Bar {
    pub(super) fn new() -> Self {
        let bar = ProgressBar::new(0);
        let template = "{msg:>28} [{bar:30}] {percent:>3} %  {elapsed} so far, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        let now = Instant::now();
        let stage =
            Stage { number: 0, name: String::new(), total: 0, done: 0, began: now, told: now, ended: Vec::new() };
        Self { bar, started: now, stage: Mutex::new(stage), in_lines: !std::io::stderr().is_terminal() }
    }

    pub(super) fn finish(&self) {
        self.stage().end();
        self.bar.finish_and_clear();
    }

    /// Where the time went: stages that took at least a tenth of a second, in their order.
    pub(super) fn times(&self) -> String {
        let stage = self.stage();
        let long = stage.ended.iter().filter(|(_, seconds)| *seconds >= 0.1);
        let parts: Vec<String> = long.map(|(name, seconds)| format!("{name} {}", duration(*seconds))).collect();
        parts.join(", ")
    }

    fn stage(&self) -> std::sync::MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stage {
    /// Books the time of the stage that ends.
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

    /// Time left, from what has been done of this stage.
    fn left(&self) -> Option<f64> {
        let done = self.done as f64 / self.total.max(1) as f64;
        (done > 0.0).then(|| self.began.elapsed().as_secs_f64() * (1.0 - done).max(0.0) / done)
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &str, _unit: &str, total: u64) {
        let mut current = self.stage();
        current.end();
        current.number += 1;
        let began = Instant::now();
        (current.name, current.total, current.done, current.began) = (stage.to_owned(), total, 0, began);
        self.bar.reset_eta();
        self.bar.set_length(total);
        self.bar.set_position(0);
        self.bar.set_message(format!("{}. {stage}", current.number));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
        if !self.in_lines {
            return;
        }
        let mut stage = self.stage();
        stage.done += steps;
        if stage.told.elapsed() >= BETWEEN_LINES {
            stage.told = Instant::now();
            let percent = 100 * stage.done / stage.total.max(1);
            let left = stage.left().map_or(String::new(), |left| format!(", {} left in it", duration(left)));
            let so_far = duration(self.started.elapsed().as_secs_f64());
            eprintln!("{so_far}: stage {}, {}, {percent} %{left}", stage.number, stage.name);
        }
    }
}

/// A time in words that suit its length: `0.4 s`, `12 s`, `3 min 20 s`, `2 h 5 min`.
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
    fn times_read_like_times() {
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
    fn stages_add_up_by_name() {
        let bar = Bar::new();
        for _ in 0..2 {
            bar.begin("rays", "rays", 2);
            std::thread::sleep(Duration::from_millis(60));
            bar.advance(2);
        }
        bar.finish();
        let times = bar.times();
        assert!(times.starts_with("rays 0.") && !times.contains(','), "{times}");
    }
}
