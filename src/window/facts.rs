//! Facts that several sources report with their frames.

use headbox_core::file_frame::FileFrame;
use headbox_core::simd;
use headbox_viewer::Fact;

/// SIMD level of the frames.
pub(super) fn simd_fact() -> Fact {
    Fact {
        name: "SIMD level",
        text: simd::name(simd::level()).into(),
    }
}

/// Axes and unit assumed for the file.
pub(super) fn axes_fact(frame: &FileFrame) -> Fact {
    Fact {
        name: "in the file",
        text: format!(
            "{} is up, 1 is {} m (view --up, --unit)",
            frame.up, frame.unit_m
        ),
    }
}
