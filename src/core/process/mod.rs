//! Running of the process: SIMD level, memory, background tasks, progress, processor time, and
//! panics of third-party code.

pub mod memory;
pub mod panics;
pub mod progress;
pub mod simd;
pub mod stopwatch;
pub mod task;
