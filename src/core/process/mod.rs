//! Running of the process: SIMD level, memory, background tasks, progress, and panics of
//! third-party code.

pub mod memory;
pub mod panics;
pub mod progress;
pub mod simd;
pub mod task;
