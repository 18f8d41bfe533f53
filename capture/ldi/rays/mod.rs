//! Step 1: which rays are traced, and tracing them.

pub mod ray_plan;
pub mod trace;
