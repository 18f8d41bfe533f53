//! Stage 1: plans rays ([`ray_plan`]) and traces them ([`mod@trace`]).

pub mod ray_plan;
pub mod trace;
