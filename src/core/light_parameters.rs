//! Light of a scene as specified by the user; embedded in scene sources, headers of files, and the
//! command line.

use crate::color::exposure::Exposure;
use crate::color::tone::ToneMap;
use crate::file_frame::FileFrame;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Light that replaces a scene's own. By default only the tone curve [`ToneMap::Neutral`] is
/// specified.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightParameters {
    /// Sky: an equirectangular .hdr or .exr image, centred on north (-Z; +Y where Z is up), that
    /// replaces the scene's sky and sun. A sun in the image acts as a light source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky: Option<PathBuf>,
    /// Rotation of the sky's image about the up axis, degrees from north to east.
    #[serde(skip_serializing_if = "is_default")]
    pub sky_turn: f64,
    /// Factor on the radiance of the sky, and of the sun in the image `sky`.
    #[serde(skip_serializing_if = "is_one")]
    pub sky_strength: f32,
    /// Sun: the direction toward it, X,Y,Z in the file's axes; or azimuth,elevation in degrees,
    /// from north to east and up from the horizon; or off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun: Option<SunPosition>,
    /// Luminance of the sun's irradiance on surfaces that face it, in the unit of the sky's
    /// radiance; 3 for the default sun.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_strength: Option<f32>,
    /// Exposure: auto, auto with additional stops such as auto+1, or a number of stops by which
    /// linear radiance is scaled up before it is stored.
    #[serde(skip_serializing_if = "is_default")]
    pub exposure: Exposure,
    /// Tone curve. Older files have `hdr: true` for [`ToneMap::SrgbCompressed`], or nothing.
    #[serde(
        alias = "hdr",
        default = "ToneMap::default",
        deserialize_with = "tone_or_hdr"
    )]
    pub tone: ToneMap,
}

/// Reads a tone curve, or true or false for one with or without light above white.
fn tone_or_hdr<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ToneMap, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum ToneOrHdr {
        Hdr(bool),
        Tone(ToneMap),
    }
    Ok(match ToneOrHdr::deserialize(deserializer)? {
        ToneOrHdr::Hdr(false) => ToneMap::SrgbClipped,
        ToneOrHdr::Hdr(true) => ToneMap::SrgbCompressed,
        ToneOrHdr::Tone(tone) => tone,
    })
}

impl Default for LightParameters {
    fn default() -> Self {
        Self {
            tone: ToneMap::Neutral,
            ..Self::unspecified()
        }
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes fields by reference"
)]
fn is_one(factor: &f32) -> bool {
    *factor == 1.0
}

/// Position of the sun, or none. Written as on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum SunPosition {
    /// No sun.
    Off,
    /// Direction toward the sun, in the axes of the scene's file; any length but 0.
    Toward(DVec3),
    /// Degrees from north to east, and up from the horizon.
    Angles {
        /// 0 is north: -Z of the world.
        azimuth: f64,
        /// From -90 to 90.
        elevation: f64,
    },
}

impl SunPosition {
    /// Returns the unit vector toward the sun, world axes; `None` if there is no sun.
    pub fn direction(self, frame: &FileFrame) -> Option<Vec3> {
        match self {
            Self::Off => None,
            Self::Toward(direction) => Some(
                frame
                    .world_direction_from_file(direction)
                    .normalize()
                    .as_vec3(),
            ),
            Self::Angles { azimuth, elevation } => {
                let [(east, north), (up, level)] =
                    [azimuth, elevation].map(|angle| angle.to_radians().sin_cos());
                Some(DVec3::new(level * east, up, -level * north).as_vec3())
            }
        }
    }
}

impl FromStr for SunPosition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> =
            text.split(',').map(|part| part.trim().parse()).collect();
        match numbers.as_deref() {
            _ if text == "off" => Ok(Self::Off),
            Ok(&[x, y, z]) if (1e-9..1e9).contains(&DVec3::new(x, y, z).length()) => {
                Ok(Self::Toward(DVec3::new(x, y, z)))
            }
            Ok(&[azimuth, elevation]) if azimuth.abs() <= 360.0 && elevation.abs() <= 90.0 => {
                Ok(Self::Angles { azimuth, elevation })
            }
            _ => {
                Err("give X,Y,Z toward the sun, azimuth,elevation in degrees (elevation from -90 to 90), or off".into())
            }
        }
    }
}

impl fmt::Display for SunPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Toward(DVec3 { x, y, z }) => write!(f, "{x},{y},{z}"),
            Self::Angles { azimuth, elevation } => write!(f, "{azimuth},{elevation}"),
        }
    }
}

impl TryFrom<String> for SunPosition {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<SunPosition> for String {
    fn from(place: SunPosition) -> Self {
        place.to_string()
    }
}

impl LightParameters {
    /// Returns the parameters of files that are older than these parameters.
    pub fn unspecified() -> Self {
        Self {
            sky: None,
            sky_turn: 0.0,
            sky_strength: 1.0,
            sun: None,
            sun_strength: None,
            exposure: Exposure::default(),
            tone: ToneMap::default(),
        }
    }

    /// Describes the specified light in a few words; `None` if nothing is specified.
    pub fn describe(&self) -> Option<String> {
        let sky = self.sky.as_ref().map(|path| match self.sky_turn {
            0.0 => format!("sky {}", path.display()),
            turn => format!("sky {}, turned by {turn} degrees", path.display()),
        });
        let sky_strength =
            (self.sky_strength != 1.0).then(|| format!("sky's strength {}", self.sky_strength));
        let sun = self.sun.map(|place| format!("sun {place}"));
        let strength = self
            .sun_strength
            .map(|strength| format!("sun's strength {strength}"));
        let words: Vec<String> = [sky, sky_strength, sun, strength]
            .into_iter()
            .flatten()
            .collect();
        (!words.is_empty()).then(|| words.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file_frame::UpAxis;

    fn direction(text: &str, up: UpAxis) -> Option<Vec3> {
        let place: SunPosition = text.parse().expect("a place");
        assert_eq!(place.to_string().parse(), Ok(place));
        place.direction(&FileFrame { up, unit_m: 0.01 })
    }

    #[test]
    fn sun_direction_matches_parameters() {
        let close = |a: Option<Vec3>, b: Vec3| a.is_some_and(|a| (a - b).length() < 1e-6);
        assert!(close(direction("0,0", UpAxis::Y), Vec3::NEG_Z), "north");
        assert!(close(direction("90,0", UpAxis::Y), Vec3::X), "east");
        assert!(
            close(direction("-90,0", UpAxis::Z), Vec3::NEG_X),
            "west, in whatever axes"
        );
        assert!(close(direction("123,90", UpAxis::Y), Vec3::Y), "the zenith");
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!(close(
            direction("180,45", UpAxis::Y),
            Vec3::new(0.0, half, half)
        ));
        // North of a file whose Z points up is its +Y.
        assert!(close(direction("0,7,0", UpAxis::Z), Vec3::NEG_Z));
        assert!(close(direction("0,0,2", UpAxis::Z), Vec3::Y));
        assert_eq!(direction("off", UpAxis::Y), None);
        for wrong in [
            "", "0,0,0", "nan,0", "10,91", "361,0", "1", "1,2,3,4", "inf,0,0", "on",
        ] {
            assert!(wrong.parse::<SunPosition>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn defaults_are_not_serialised() {
        assert_eq!(
            serde_json::to_string(&LightParameters::default()).expect("json"),
            r#"{"tone":"neutral"}"#
        );
        for (text, tone) in [
            ("{}", ToneMap::SrgbClipped),
            (r#"{"hdr":true}"#, ToneMap::SrgbCompressed),
        ] {
            let read: LightParameters = serde_json::from_str(text).expect("older files");
            assert_eq!(read.tone, tone, "{text}");
        }
        let asked = LightParameters {
            sky: Some("a.hdr".into()),
            sky_turn: 30.0,
            sky_strength: 0.5,
            sun: Some("12,34".parse().expect("a place")),
            sun_strength: Some(2.0),
            exposure: Exposure::Auto(1.0),
            tone: ToneMap::SrgbCompressed,
        };
        let text = serde_json::to_string(&asked).expect("json");
        assert_eq!(
            serde_json::from_str::<LightParameters>(&text).expect("read"),
            asked
        );
        assert_eq!(
            asked.describe().as_deref(),
            Some(
                "sky a.hdr, turned by 30 degrees, sky's strength 0.5, sun 12,34, sun's strength 2"
            )
        );
    }
}
