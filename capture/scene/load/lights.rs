//! Lights of a scene: those of its file, or the default sun and sky.

use super::notes::Notes;
use crate::scene::{Lamp, Reach, Sky, Sun};
use glam::Vec3;
use headbox_core::color::luminance;

/// Sun, sky and lamps of a scene.
#[derive(Debug, Default)]
pub(super) struct FileLights {
    pub(super) sun: Option<Sun>,
    pub(super) sky: Option<Sky>,
    pub(super) lamps: Vec<Lamp>,
}

impl FileLights {
    /// Completes the lights with the default sky, and with the default sun if the file has no
    /// light. The strongest directional light becomes the sun; the sky is scaled like the sun
    /// relative to its default.
    pub(super) fn with_defaults(mut self, notes: &mut Notes) -> Self {
        let default = Sun::default();
        self.sky = Some(Sky::default());
        if self.lamps.is_empty() {
            self.sun = Some(default);
            return self;
        }
        let count = self.lamps.len();
        let lights = if count == 1 {
            "light of the file lights"
        } else {
            "lights of the file light"
        };
        notes.messages.push(format!(
            "{count} {lights} the scene instead of the default sun"
        ));
        let distant = |lamp: &Lamp| match lamp.reach {
            Reach::Distant { direction } => Some((direction, luminance(lamp.intensity))),
            Reach::Point { .. } | Reach::Spot { .. } => None,
        };
        let strongest = (0..count)
            .rev() // the first of equals
            .filter_map(|index| Some((index, distant(&self.lamps[index])?)))
            .max_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b));
        if let Some((index, (direction, level))) = strongest {
            self.sky = Some(Sky::default().times(level / luminance(default.irradiance)));
            self.sun = Some(Sun {
                direction,
                irradiance: self.lamps.remove(index).intensity,
                ..default
            });
        }
        self
    }

    /// Adds a lamp unless it is black. Returns false if its numbers are invalid.
    pub(super) fn push(&mut self, lamp: Lamp) -> bool {
        let is_light = lamp.intensity.iter().all(|c| c.is_finite() && *c >= 0.0);
        let is_unit = |direction: Vec3| (direction.length() - 1.0).abs() < 1e-3;
        let is_sane = is_light
            && match lamp.reach {
                Reach::Distant { direction } => is_unit(direction),
                Reach::Point { position, range_m } => position.is_finite() && range_m > 0.0,
                Reach::Spot {
                    position,
                    range_m,
                    axis,
                    cosines: [inner, outer],
                } => {
                    position.is_finite()
                        && range_m > 0.0
                        && is_unit(axis)
                        && inner.is_finite()
                        && outer.is_finite()
                }
            };
        if is_sane && lamp.intensity != [0.0; 3] {
            self.lamps.push(lamp);
        }
        is_sane
    }
}
