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

    /// Returns the name of the unit, if it has one.
    pub fn unit_name(&self) -> Option<&'static str> {
        const NAMES: [(f64, &str); 6] = [
            (1.0, "m"),
            (0.1, "dm"),
            (0.01, "cm"),
            (0.001, "mm"),
            (0.0254, "in"),
            (0.3048, "ft"),
        ];
        let is_unit = |(unit_m, _): &&(f64, &str)| (self.unit_m / unit_m - 1.0).abs() < 1e-6;
        NAMES.iter().find(is_unit).map(|(_, name)| *name)
    }

    /// Returns a warning about an eye (world metres) that is farther from a scene's bounding box than
    /// the box is large: it was probably given in other axes or another unit than the file's.
    pub fn distant_eye_warning(&self, bounds: [DVec3; 2], eye: DVec3) -> Option<String> {
        let [low, high] = bounds;
        let distance_m = (eye - eye.clamp(low, high)).length();
        let [a, b] = bounds.map(|corner| self.file_from_world(corner));
        (distance_m > (high - low).length()).then(|| {
            format!(
                "the eye is farther from the scene than the scene is large: it reaches from {} to {} (in the file's axes \
                 and unit)",
                triple(a.min(b)),
                triple(a.max(b))
            )
        })
    }

    /// Returns the number of decimals with which positions in the file's unit are exact to a
    /// millimetre.
    pub fn millimetre_decimals(&self) -> usize {
        (self.unit_m * 1000.0).log10().ceil().clamp(0.0, 12.0) as usize
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

/// Rounds a length to four significant digits.
fn rounded(length: f64) -> f64 {
    let digits = (3.0 - length.abs().max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 12.0);
    let scale = 10_f64.powf(digits);
    // Adding zero drops the sign of -0.
    (length * scale).round() / scale + 0.0
}

/// Formats a length with four significant digits, and an exponent where there would be many zeros.
pub fn figure(length: f64) -> String {
    match length.abs() {
        1e7.. => format!("{length:.3e}").replace(".000e", "e"),
        size if size > 0.0 && size < 1e-5 => format!("{length:.3e}").replace(".000e", "e"),
        _ => rounded(length).to_string(),
    }
}

/// Formats a position as the command line takes it.
pub fn triple(position: DVec3) -> String {
    position.to_array().map(figure).join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distant_eyes_are_reported_in_the_files_axes() {
        let frame = FileFrame {
            unit_m: 0.01,
            up: UpAxis::Z,
        };
        let bounds = [DVec3::new(-2.0, 0.0, -3.0), DVec3::new(2.0, 2.5, 3.0)];
        let near = DVec3::new(0.0, 9.0, 0.0);
        assert_eq!(frame.distant_eye_warning(bounds, near), None);
        let far = DVec3::new(0.0, 1.0, -160.0);
        let warning = frame.distant_eye_warning(bounds, far).expect("far away");
        let reach = "reaches from -200,-300,0 to 200,300,250 (in the file's axes and unit)";
        assert!(warning.ends_with(reach), "{warning}");
    }

    #[test]
    fn units_have_names_and_millimetre_decimals() {
        let frame = |unit_m| FileFrame {
            unit_m,
            ..FileFrame::default()
        };
        let named = [1.0, 0.01, 0.001, 0.0254, 0.7, 1e-5].map(|unit_m| {
            let frame = frame(unit_m);
            (frame.unit_name(), frame.millimetre_decimals())
        });
        let expected = [
            (Some("m"), 3),
            (Some("cm"), 1),
            (Some("mm"), 0),
            (Some("in"), 2),
            (None, 3),
            (None, 0),
        ];
        assert_eq!(named, expected);
    }
}
