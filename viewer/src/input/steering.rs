//! State steered by the user: the eye, and the values of the source's settings.

use crate::input::flight::Flight;
use crate::input::motion::Motion;
use crate::input::pose::Pose;
use glam::DVec3;
use headbox_core::view::SettingValues;
use std::sync::Arc;

/// The eye and its steering state.
pub(crate) struct Eye {
    pub pose: Pose,
    pub motion: Motion,
    pub speed_m_per_s: f64,
    pub grab_scene: bool,
    /// Point about which the user orbits, world metres; `None` moves as the source says.
    pub orbit: Option<DVec3>,
    /// Flight to another pose, which ends with any input.
    pub flight: Option<Flight>,
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

impl SettingSets {
    /// Returns the values that the panel edits; `compare` is true if both sets are shown.
    pub(crate) fn edited(&mut self, compare: bool) -> &mut SettingValues {
        Arc::make_mut(if compare && self.edits_b {
            &mut self.b
        } else {
            &mut self.a
        })
    }
}
