//! Stage 1: plans rays ([`ray_plan`]) and traces them ([`trace_and_accumulate`]).

pub mod ray_plan;
pub mod trace_and_accumulate;
