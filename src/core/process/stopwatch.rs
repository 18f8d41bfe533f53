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
    fn waiting_takes_no_processor_time() {
        let on_one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let [waited, worked] = on_one_thread.expect("a thread").install(|| {
            let watch = Stopwatch::start();
            std::thread::sleep(Duration::from_millis(60));
            let waited = watch.seconds_per_thread();
            let watch = Stopwatch::start();
            let mut numbers = 0_u64;
            while watch.processor.is_some_and(|start| {
                processor_time().is_some_and(|now| now < start + Duration::from_millis(60))
            }) {
                numbers = std::hint::black_box(numbers + 1);
            }
            [waited, watch.seconds_per_thread()]
        });
        assert!(worked >= 0.06, "{worked}");
        assert!(waited < worked, "{waited} s while asleep");
    }
}
