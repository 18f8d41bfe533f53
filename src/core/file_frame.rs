//! Axes and unit of a scene file.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Up axis of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "bool", into = "bool")]
pub enum UpAxis {
    /// Y up, as in the world.
    #[default]
    Y,
    /// Z up: (x, y, z) of the file is (x, z, -y) of the world.
    Z,
}

/// Serialised as true if Z points up.
impl From<bool> for UpAxis {
    fn from(z_up: bool) -> Self {
        if z_up { Self::Z } else { Self::Y }
    }
}

impl From<UpAxis> for bool {
    fn from(up: UpAxis) -> Self {
        up == UpAxis::Z
    }
}

impl fmt::Display for UpAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Z { "Z" } else { "Y" })
    }
}

/// Mapping from positions of the scene's file to the world (metres, Y up). Positions on the command
/// line are in the file's own axes and unit. Our own files contain it, flattened to `unit_m` and
/// `z_up`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FileFrame {
    /// Metres per unit of the file.
    pub unit_m: f64,
    /// The axis that points up in the file.
    #[serde(rename = "z_up")]
    pub up: UpAxis,
}

impl Default for FileFrame {
    fn default() -> Self {
        Self {
            up: UpAxis::Y,
            unit_m: 1.0,
        }
    }
}

impl FileFrame {
    /// Converts a position of the file to world metres.
    pub fn world_from_file(&self, p: DVec3) -> DVec3 {
        self.world_direction_from_file(p) * self.unit_m
    }

    /// Converts a direction of the file to world axes.
    pub fn world_direction_from_file(&self, p: DVec3) -> DVec3 {
        match self.up {
            UpAxis::Y => p,
            UpAxis::Z => DVec3::new(p.x, p.z, -p.y),
        }
    }

    /// Returns true if the unit is in a range that keeps positions finite and exact enough: 1e-9 to
    /// 1e9 m.
    pub fn is_sane(&self) -> bool {
        (1e-9..=1e9).contains(&self.unit_m)
    }

    /// Inverse of [`Self::world_from_file`].
    pub fn file_from_world(&self, p: DVec3) -> DVec3 {
        let p = p / self.unit_m;
        match self.up {
            UpAxis::Y => p,
            UpAxis::Z => DVec3::new(p.x, -p.z, p.y),
        }
    }
}
