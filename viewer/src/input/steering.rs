//! State steered by the user: the eye, and the values of the source's settings.

use crate::input::motion::Motion;
use crate::input::pose::Pose;
use headbox_core::view::SettingValues;
use std::sync::Arc;

/// The eye and its steering state.
pub(crate) struct Eye {
    pub pose: Pose,
    pub motion: Motion,
    pub speed_m_per_s: f64,
    pub grab_scene: bool,
    /// Time of the last movement on the window's clock, seconds.
    pub moved_s: f64,
}

/// Values of the source's settings: A, and B for comparison.
#[derive(Clone, Default)]
pub(crate) struct SettingSets {
    pub a: Arc<SettingValues>,
    pub b: Arc<SettingValues>,
    /// True if the panel edits B while both are on the screen.
    pub edits_b: bool,
}
