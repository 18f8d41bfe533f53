//! Times of parallel work that do not depend on what else runs on the machine.

use std::time::{Duration, Instant};

/// A stopwatch for work on all threads of the current pool.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    start: Instant,
    processor: Option<Duration>,
}

impl Stopwatch {
    /// Starts a stopwatch.
    #[must_use]
    pub fn start() -> Self {
        Self {
            start: Instant::now(),
            processor: processor_time(),
        }
    }

    /// Processor time of the program since the start, seconds, divided by the number of threads:
    /// the time that evenly spread work takes while nothing else runs. Elapsed time where the
    /// system does not report processor time.
    #[must_use]
    pub fn seconds_per_thread(&self) -> f64 {
        match (self.processor, processor_time()) {
            (Some(start), Some(now)) => {
                now.saturating_sub(start).as_secs_f64() / rayon::current_num_threads() as f64
            }
            _ => self.start.elapsed().as_secs_f64(),
        }
    }
}

/// Processor time of all threads since the program started.
#[cfg(target_os = "linux")]
fn processor_time() -> Option<Duration> {
    rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime)
        .try_into()
        .ok()
}

#[cfg(not(target_os = "linux"))]
fn processor_time() -> Option<Duration> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn processor_time_is_divided_among_threads() {
        let on_threads = |count| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
            pool.expect("threads")
        };
        let [one, four] = [1, 4].map(on_threads);
        let watch = Stopwatch::start();
        let mut on_one = 0.0;
        while on_one < 0.06 {
            on_one = one.install(|| watch.seconds_per_thread());
        }
        // Other tests of the process take time between the two.
        let on_four = four.install(|| watch.seconds_per_thread());
        assert!(
            (on_one / 4.0..on_one).contains(&on_four),
            "{on_four} s of {on_one} s"
        );
    }
}
