//! Stage 1: which rays are traced ([`ray_plan`]), and tracing them ([`mod@trace`]).

pub mod ray_plan;
pub mod trace;
