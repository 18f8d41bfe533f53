//! State steered by the user: the eye, and the values of the source's settings.

use crate::input::motion::Motion;
use crate::input::pose::Pose;
use headbox_core::view::SettingValues;
use std::sync::Arc;

/// The eye and how it is steered.
pub(crate) struct Eye {
    pub pose: Pose,
    pub motion: Motion,
    pub speed_m_per_s: f64,
    pub grab_scene: bool,
    /// When it last moved, on the window's clock.
    pub moved_s: f64,
}

/// The values of the source's settings: A, and B to compare with.
#[derive(Clone, Default)]
pub(crate) struct Sets {
    pub a: Arc<SettingValues>,
    pub b: Arc<SettingValues>,
    /// Settings that the panel shows while both are on the screen.
    pub edits_b: bool,
}
