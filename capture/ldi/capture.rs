//! The capture of a scene, from rays to cube LDI.

use crate::merge::finish;
use crate::rays::trace_and_accumulate::{TracedRays, trace};
use crate::refine;
use crate::spec::{CaptureSpec, RunOptions};
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::CubeSamples;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::io;
use std::time::{Duration, Instant};

/// Names of the stages that a capture reports to its progress, in order. A capture skips stages
/// that it does not need; the search for holes begins once for each of its rounds.
pub mod stage {
    /// The pilot round of rays.
    pub const PILOT: &str = "pilot";
    /// The planned rays.
    pub const TRACE: &str = "trace";
    /// A round of the search for holes.
    pub const HOLES: &str = "look for holes";
    /// Light, merging and coverage.
    pub const LIGHT: &str = "light and merge";
    /// All stages.
    pub const ALL: [&str; 4] = [PILOT, TRACE, HOLES, LIGHT];
}

/// A capture of a scene: what to capture, the scene with its light, and how to run.
///
/// The result is a pure function of the spec and the scene: the same bytes on any number of
/// threads, within any memory budget, in one run or merged from shards.
#[derive(Clone, Copy)]
pub struct SceneCapture<'a> {
    pub(crate) spec: &'a CaptureSpec,
    /// The scene; its local origin is the centre of the headbox.
    pub(crate) tracer: &'a Tracer,
    pub(crate) lighting: &'a Lighting,
    pub(crate) options: &'a RunOptions<'a>,
}

impl<'a> SceneCapture<'a> {
    /// A capture of the scene in `tracer`, whose origin must be the spec's centre.
    pub fn new(
        spec: &'a CaptureSpec,
        tracer: &'a Tracer,
        lighting: &'a Lighting,
        options: &'a RunOptions<'a>,
    ) -> Self {
        Self {
            spec,
            tracer,
            lighting,
            options,
        }
    }

    /// Runs all stages. Also returns the time that tracing took.
    ///
    /// # Errors
    /// If accumulators cannot be spilled, or if the capture was cancelled.
    pub fn run(&self) -> io::Result<(CubeSamples, Duration)> {
        let start = Instant::now();
        let mut tracing = self.trace()?;
        let trace_time = start.elapsed();
        self.fill_holes(&mut tracing)?;
        Ok((self.light_and_merge(&tracing)?, trace_time))
    }

    /// Traces the rays of the spec, or those of the shard.
    ///
    /// # Errors
    /// If accumulators cannot be spilled, or if the capture was cancelled.
    pub fn trace(&self) -> io::Result<TracedRays> {
        trace(self)
    }

    /// Aims rays at holes in test views, until the spec's share of holes is reached.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read, or if the capture was cancelled.
    pub fn fill_holes(&self, tracing: &mut TracedRays) -> io::Result<()> {
        refine::fill_holes(self, tracing)
    }

    /// Lights the surface samples of a whole capture and merges them into depth pixels.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read, or if the capture was cancelled.
    pub fn light_and_merge(&self, tracing: &TracedRays) -> io::Result<CubeSamples> {
        finish::light_and_merge(self, tracing)
    }

    /// Header fields that are known before any ray is traced.
    pub(crate) fn info(&self) -> CaptureInfo {
        CaptureInfo {
            scene: self.spec.scene.name.clone(),
            centre: self.spec.centre,
            half_size_m: self.spec.half_size_m,
            frame: self.tracer.scene().frame,
            exposure: self.lighting.exposure,
            tone: self.lighting.tone,
            light: self.spec.scene.light.clone(),
            parameters: self.spec.parameters,
            ..CaptureInfo::default()
        }
    }
}
