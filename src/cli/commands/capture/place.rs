//! Placement of the headbox, in the axes and unit of its scene's file.

use crate::args::{parse_length, parse_vector};
use crate::messages::UsageError;
use clap::Args;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, figure, triple};
use headbox_core::headbox::Headbox;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::viewpoint::{self, HeadboxError};
use std::sync::Arc;

/// Place and size of the headbox.
#[derive(Args, Clone, Copy)]
pub(crate) struct HeadboxArgs {
    /// Centre of the headbox, in the file's axes and unit; the scene's own, or a place in free
    /// space, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(crate) center: Option<DVec3>,
    /// Half of the headbox's edge length, in the file's unit; the scene's own, or the largest that
    /// fits into free space, by default
    #[arg(long, value_name = "LENGTH", value_parser = parse_length, allow_hyphen_values = true)]
    pub(crate) half_size: Option<f64>,
}

impl HeadboxArgs {
    /// Flags of the headbox, each with true if it is given.
    #[cfg(feature = "viewer")]
    pub(crate) fn given_flags(&self) -> [(&'static str, bool); 2] {
        [
            ("--center", self.center.is_some()),
            ("--half-size", self.half_size.is_some()),
        ]
    }

    /// Warns if the user requested a headbox in a bad place or of a bad size, or if only a small
    /// one fits there.
    pub(crate) fn warn_if_bad(&self, tracer: &Tracer, headbox: &Headbox) {
        /// Half-size relative to that at the suggested place below which a fitting one is small.
        const SMALL_SHARE: f64 = 1.0 / 3.0;
        if self.center.is_none() && self.half_size.is_none() {
            return;
        }
        let frame = &tracer.scene().frame;
        let Some(warning) = viewpoint::check_headbox(tracer, headbox) else {
            let usual_m = viewpoint::suggest_headbox(tracer).half_size_m;
            if self.half_size.is_none() && headbox.half_size_m < SMALL_SHARE * usual_m {
                let [fitting, usual] = [headbox.half_size_m, usual_m]
                    .map(|half_size_m| figure(half_size_m / frame.unit_m));
                eprintln!(
                    "note: surfaces near --center leave room for a half-size of only {fitting}; {usual} fits where the \
                     default headbox is (--half-size chooses another)"
                );
            }
            return;
        };
        eprintln!("warning: {}", warning.sentence(frame));
        if let Some(center) = self.center.filter(|_| is_good_in_metres(tracer, headbox)) {
            let [metres, in_units] = [center, center / frame.unit_m].map(triple);
            eprintln!(
                "  a unit of this file is {} m: if {metres} are metres, give --center {in_units}",
                frame.unit_m
            );
        }
    }
}

/// Returns true if a headbox has no flaw once the numbers of its centre are read as metres instead
/// of units of the file.
fn is_good_in_metres(tracer: &Tracer, headbox: &Headbox) -> bool {
    let unit_m = tracer.scene().frame.unit_m;
    let scene = Arc::clone(tracer.scene());
    let in_metres = viewpoint::place_headbox(&scene, Some(headbox.centre / unit_m), None);
    unit_m != 1.0 && in_metres.is_ok_and(|it| viewpoint::check_headbox(tracer, &it).is_none())
}

/// Places the headbox: as requested, in the file's axes and unit, else as the scene suggests, else
/// in free space.
pub(crate) fn place_headbox(
    scene: &Arc<Scene>,
    center: Option<DVec3>,
    half_size: Option<f64>,
) -> Result<Headbox, UsageError> {
    let centre = center.map(|center| scene.frame.world_from_file(center));
    let half_size_m = half_size.map(|half_size| half_size * scene.frame.unit_m);
    viewpoint::place_headbox(scene, centre, half_size_m)
        .map_err(|error| UsageError(in_file_units(&error, &scene.frame)))
}

/// Formats an error in the file's axes and unit.
fn in_file_units(error: &HeadboxError, frame: &FileFrame) -> String {
    match *error {
        HeadboxError::TooFar { centre, low, high } => {
            let [centre, low, high] = [centre, low, high].map(|point| frame.file_from_world(point));
            format!(
                "a headbox about {} is so far from the scene that nothing is visible; choose a place near the scene, which reaches \
                 from {} to {} (in the file's axes and unit)",
                triple(centre),
                triple(low.min(high)),
                triple(low.max(high))
            )
        }
        HeadboxError::HalfSize(metres) => {
            let [half_size, least, most] =
                [metres, 1e-9, 1e9].map(|metres| figure(metres / frame.unit_m));
            format!(
                "a headbox of half-size {half_size}; choose one between {least} and {most} (in the file's unit)"
            )
        }
        HeadboxError::Centre(_) => error.to_string(),
    }
}
