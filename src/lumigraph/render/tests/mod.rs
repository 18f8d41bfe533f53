//! Tests of frames: against rays one by one, and against the scene.

mod appearance;
mod exactness;
